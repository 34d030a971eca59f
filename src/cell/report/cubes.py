"""The cubes of a run's report, one row each; with ground truth if the cell is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from arm.plan_file import Move, Step
from arm.se3 import Array, inverse, transform
from cell.console import Console
from cell.files.task import Task
from cell.sim.grip import angle_to_square

if TYPE_CHECKING:
    from cell.sim.cell import CellEvent, SimulatedCell

UNDECIDED = "-"  # target of a cube that could not be taken
RELEASED = ("placed", "unseated", "set down", "fallen")  # events of a cube that is released
HEADER = ("cube", "from", "to", "placed", "planned s", "clearance mm", "error mm", "tilt deg")


@dataclass
class CubeRow:
    """Result of one cube.

    Attributes:
        source, target: names of the places; the target may be `UNDECIDED`.
        placed: whether a look has confirmed it at its target.
        at: where it was at the end, as far as that is known: a place, or beside one.
        motion_s: duration of its planned motions, s.
        min_clearance: smallest clearance of its moves, m.
        error: distance of its axis from that of the place of its last release when the jaws opened, m; ground truth,
            simulated cell only.
        tilt_error: tilt of its axis then, rad; ground truth, simulated cell only.
        faults: what went wrong, in order: "not gripped", "not confirmed", "not located", "stays" or "put back".
        remarks: further results, as text.
    """

    source: str
    target: str
    placed: bool = False
    at: str = "unknown"
    motion_s: float = 0.0
    min_clearance: float | None = None
    error: float | None = None
    tilt_error: float | None = None
    faults: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def way(self) -> str:
        """Its source and, if that was decided, its target, in words."""
        return self.source if self.target == UNDECIDED else f"{self.source} to {self.target}"

    def add_fault(self, fault: str, remark: str) -> None:
        """Add what went wrong, and a remark about it."""
        self.faults.append(fault)
        self.remarks.append(remark)

    def add_motion(self, steps: Sequence[Step]) -> None:
        """Add the moves among some steps to the duration and the clearance."""
        moves = [s for s in steps if isinstance(s, Move)]
        self.motion_s += sum(m.path.duration_s for m in moves)
        clearances = [m.clearance for m in moves] + (
            [] if self.min_clearance is None else [self.min_clearance]
        )
        self.min_clearance = min(clearances, default=None)

    def to_json(self) -> dict[str, Any]:
        """Return the row for ``a465 run --json``."""
        motion_s, clearance, error, tilt = self.figures()
        return {
            "from": self.source,
            "to": self.target,
            "placed": self.placed,
            "at": self.at,
            "error_mm": error,
            "tilt_error_deg": tilt,
            "motion_s": round(motion_s, 3),
            "min_clearance_mm": clearance,
            "faults": self.faults,
            "remarks": self.remarks,
        }

    def figures(self) -> tuple[float, float | None, float | None, float | None]:
        """Return duration, s, least clearance and error, mm, and tilt error, deg; None if not known."""
        scaled = ((self.min_clearance, 1e3), (self.error, 1e3), (self.tilt_error, 180.0 / np.pi))
        clearance, error, tilt = (None if v is None else float(v * factor) for v, factor in scaled)
        return self.motion_s, clearance, error, tilt


def print_rows(console: Console, rows: Sequence[CubeRow]) -> None:
    """Print the table at the end of a run."""
    console.say()
    console.table(
        HEADER, [(n, r.source, r.target, r.placed, *r.figures()) for n, r in enumerate(rows, start=1)]
    )
    for number, row in enumerate(rows, start=1):
        for remark in row.remarks:
            console.say(f"cube {number}: {remark}")


def judge_release(
    task: Task, simulated: SimulatedCell, row: CubeRow, place: str, events: Sequence[CellEvent]
) -> None:
    """Compare the true pose of a cube with the place of its release, at the moment when the jaws opened.

    Args:
        task, simulated: the task and its cell.
        row: of the cube.
        place: where it was to be released: its target or, if it is put back, its hole.
        events: of the cell since the jaws closed on the cube; none of them is a release if they held nothing.
    """
    event = next((e for e in reversed(events) if e.what in RELEASED), None)
    if event is None or event.T_base_cube is None:
        row.error = row.tilt_error = None
        return
    T_base_place, on_table = _true_place(task, simulated, place), place.startswith("table/")
    T_place_cube = inverse(T_base_place) @ event.T_base_cube
    row.error = float(np.hypot(T_place_cube[0, 3], T_place_cube[1, 3]))
    row.tilt_error = float(np.arccos(np.clip(T_place_cube[2, 2], -1.0, 1.0)))
    if on_table:  # on the table nothing aligns the cube, so its rotation counts too
        row.tilt_error = angle_to_square(T_place_cube[:3, :3])
    wanted = "set down" if on_table else "placed"
    if event.what != wanted:
        row.remarks.append(event.message)


def _true_place(task: Task, simulated: SimulatedCell, place: str) -> Array:
    board_name, _, number = place.partition("/")
    if board_name == "table" and task.places is not None:
        x, y = task.places.centres[int(number) - 1]
        return transform(t=(x, y, task.cell.table_z))
    for b in simulated.world.boards:
        if b.board.name == board_name:
            return np.asarray(b.T_base_board @ b.board.T_board_hole(int(number) - 1))
    return transform()
