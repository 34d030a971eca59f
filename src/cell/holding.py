"""A cube in the jaws, and how it is known that it still is: the jaws stay where they closed on it."""

from __future__ import annotations

from dataclasses import dataclass

from arm.errors import ExecutionStopped

GRIP_CHANGE = 0.05  # of the stroke by which the jaws may move on a held cube
LOOKS = 2  # in a row that tell it: one may be a digit lost on the line


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
