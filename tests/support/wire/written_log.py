"""Wire logs written by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

OPEN = {"t": 0.0, "kind": "open", "time_scale": 1.0}


def write(path: Path, *records: dict[str, Any]) -> Path:
    path.write_text("".join(json.dumps(r) + "\n" for r in (OPEN, *records)))
    return path
