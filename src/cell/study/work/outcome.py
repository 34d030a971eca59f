"""What became of one point of a study, as a row of its table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cell.files.study import RESULTS

_LONGEST = 200  # characters of a detail


@dataclass
class Outcome:
    """What became of a point.

    Attributes:
        stage: the last stage that was asked.
        ok: whether it passed.
        reason: of the refusal, one of few; "" if there is none.
        margin_deg: least distance of a joint from its limits at the best grasp of each hole.
        hole_std_mm: standard deviation of the position of the look's least certain hole, in its plate.
        clearance_mm: least proved clearance of the plan, with the arm's errors where they are known.
        motion_s: duration of the plan's motions.
        insertion: probability that the least certain cube enters its pocket; the last of the stages look and plan.
        detail: the refusal in words.
    """

    stage: str
    ok: bool = True
    reason: str = ""
    margin_deg: float | None = None
    hole_std_mm: float | None = None
    clearance_mm: float | None = None
    motion_s: float | None = None
    insertion: float | None = None
    detail: str = ""

    def refuse(self, reason: str, detail: str) -> None:
        """Say that the stage did not pass."""
        self.ok, self.reason = False, reason
        line = " ".join(detail.split())
        self.detail = line if len(line) <= _LONGEST else line[: _LONGEST - 3] + "..."

    def row(self) -> list[str]:
        """Return the cells of the table, those of `RESULTS`."""
        return [_cell(getattr(self, name)) for name in RESULTS]


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return repr(round(value, 6))
    return "" if value is None else str(value)
