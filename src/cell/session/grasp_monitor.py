"""Monitor a cube in the jaws by their opening: it must be the cube's width, and stay constant during the carry."""

from __future__ import annotations

from dataclasses import dataclass

from arm.errors import ExecutionStopped
from arm.former import former_names
from cell.config.cell import Cell

GRIP_CHANGE = 0.05  # fraction of the stroke that the jaws may move on a held cube
READINGS = 2  # consecutive readings; a single one may have lost a digit on the line


def grip_fault(cell: Cell, width: float) -> str:
    """Return what is wrong with jaws `width` m apart on a cube of the cell; empty if they hold it."""
    cube, tolerance = cell.cube_size, cell.grip_tolerance + cell.cube_tolerance
    if abs(width - cube) <= tolerance:
        return ""
    usual = f"{1e3 * cube:g} +- {1e3 * tolerance:g} mm"
    found = f"the jaws stopped {1e3 * width:.1f} mm apart, a cube is {usual} wide"
    if width > cube:
        return f"{found}: something else is between them"
    return f"{found}: they hold something else, or a cube by its edge"


@dataclass
class GraspMonitor:
    """Detect the loss of a held cube.

    Attributes:
        cube: its name.
        grip: closing of the jaws on it, 0 open to 1 closed.
        away: number of consecutive readings that differ from `grip`.
    """

    cube: str
    grip: float
    away: int = 0

    def require(self, jaws: float, readings: int = READINGS) -> None:
        """Check one reading of the jaws.

        Raises:
            ExecutionStopped: the jaws moved in `readings` consecutive readings; with reason ``lost``.
        """
        self.away = self.away + 1 if abs(jaws - self.grip) > GRIP_CHANGE else 0
        if self.away >= readings:
            raise ExecutionStopped(
                f"{self.cube} was lost: the jaws were {100 * self.grip:.0f} % closed on it and are "
                f"{100 * jaws:.0f} % closed now; its position is unknown",
                fraction_closed=jaws,
                reason="lost",
            )


former_names(__name__, __name__, why_no_grip="grip_fault", LOOKS="READINGS")
