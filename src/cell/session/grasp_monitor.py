"""A cube in the jaws: that it is one, by how wide they stand; and that it still is there: they stay where they are."""

from __future__ import annotations

from dataclasses import dataclass

from arm.errors import ExecutionStopped
from cell.config.cell import Cell

GRIP_CHANGE = 0.05  # of the stroke by which the jaws may move on a held cube
LOOKS = 2  # in a row that tell it: one may be a digit lost on the line


@dataclass(frozen=True)
class Grip:
    """How wide a cube holds the jaws open.

    Attributes:
        width: of a cube, m.
        tolerance: by how much the jaws may stand wider or narrower on one, m.
    """

    width: float
    tolerance: float

    def why_not(self, width: float) -> str:
        """Empty if jaws that stand `width` m apart hold a cube; else what is wrong."""
        if abs(width - self.width) <= self.tolerance:
            return ""
        usual = f"{1e3 * self.width:g} +- {1e3 * self.tolerance:g} mm"
        told = f"the jaws stopped {1e3 * width:.1f} mm apart, a cube is {usual} wide"
        if width > self.width:
            return f"{told}: something else is between them"
        return f"{told}: they hold something else, or a cube by its edge"


def grip_of(cell: Cell) -> Grip:
    """Of the cell's cubes, whose edges differ too."""
    return Grip(cell.cube_size, cell.grip_tolerance + cell.cube_tolerance)


@dataclass
class Held:
    """What the jaws hold.

    Attributes:
        cube: its name.
        grip: how far the jaws are closed on it, 0 open to 1 closed.
        away: looks in a row at which they were not.
    """

    cube: str
    grip: float
    away: int = 0

    def require(self, jaws: float, looks: int = LOOKS) -> None:
        """Take a look at the jaws into account.

        Raises:
            ExecutionStopped: `looks` looks in a row say that the jaws have moved; with reason ``lost``.
        """
        self.away = self.away + 1 if abs(jaws - self.grip) > GRIP_CHANGE else 0
        if self.away >= looks:
            raise ExecutionStopped(
                f"{self.cube} was lost on the way: the jaws were {100 * self.grip:.0f} % closed on it and are "
                f"{100 * jaws:.0f} % closed now; it lies where nothing sees it",
                fraction_closed=jaws,
                reason="lost",
            )
