"""Is what a page shows what was said, but for figures?"""

from __future__ import annotations

import re
from collections.abc import Iterable


def unlike(shown: str, said: str) -> list[str]:
    """Lines that a page shows and nobody said; figures may be others, and ``...`` stands for anything."""
    heard = _without_figures(said)
    lines = (line for line in shown.splitlines() if re.search(r"[^\s\-.]", line))
    return [line for line in lines if not all(part in heard for part in _parts(line))]


def _parts(line: str) -> Iterable[str]:
    return (_without_figures(part) for part in line.split("...") if part.strip())


def _without_figures(text: str) -> str:
    text = re.sub(r"\b(?=[0-9a-f]*\d)[0-9a-f]{8,}\b", "#", text.replace("cubes", "cube"))
    return " ".join(re.sub(r"[-+]?\d+(?:\.\d+)?", "#", text).split())
