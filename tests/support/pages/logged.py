"""Pages of logs."""

from __future__ import annotations

from arm.controller.segments import CountPath
from arm.plan_file import Move


def move(name: str, path: CountPath) -> Move:
    return Move(name, "transit", None, path, None, 0.06, 0.02, ("palm", "table"))
