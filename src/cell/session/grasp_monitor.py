"""Monitor a cube in the jaws by their opening: the cube's width, and unchanged while it is carried."""

from __future__ import annotations

from dataclasses import dataclass

from arm.errors import ExecutionStopped
from cell.config.cell import Cell

GRIP_CHANGE = 0.05  # fraction of the stroke that the jaws may move on a held cube
LOOKS = 2  # consecutive readings; a single one may have a digit lost on the line


@dataclass(frozen=True)
class Grip:
    """The jaw opening expected on a cube.

    Attributes:
        width: of a cube, m.
        tolerance: permitted deviation of the opening, m.
    """

    width: float
    tolerance: float

    def why_not(self, width: float) -> str:
        """Empty if jaws `width` m apart hold a cube; otherwise the reason why not."""
        if abs(width - self.width) <= self.tolerance:
            return ""
        usual = f"{1e3 * self.width:g} +- {1e3 * self.tolerance:g} mm"
        found = f"the jaws stopped {1e3 * width:.1f} mm apart, a cube is {usual} wide"
        if width > self.width:
            return f"{found}: something else is between them"
        return f"{found}: they hold something else, or a cube by its edge"


def grip_of(cell: Cell) -> Grip:
    """The grip of the cell's cubes, with their size tolerance."""
    return Grip(cell.cube_size, cell.grip_tolerance + cell.cube_tolerance)


@dataclass
class GraspMonitor:
    """Detects the loss of a held cube.

    Attributes:
        cube: its name.
        grip: closing of the jaws on it, 0 open to 1 closed.
        away: consecutive readings with another closing.
    """

    cube: str
    grip: float
    away: int = 0

    def require(self, jaws: float, looks: int = LOOKS) -> None:
        """Check one reading of the jaws.

        Raises:
            ExecutionStopped: the jaws moved in `looks` consecutive readings; with reason ``lost``.
        """
        self.away = self.away + 1 if abs(jaws - self.grip) > GRIP_CHANGE else 0
        if self.away >= looks:
            raise ExecutionStopped(
                f"{self.cube} was lost: the jaws were {100 * self.grip:.0f} % closed on it and are "
                f"{100 * jaws:.0f} % closed now; its position is unknown",
                fraction_closed=jaws,
                reason="lost",
            )
