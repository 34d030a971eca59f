"""Whether contact held the arm back where it put a cube into its pocket, by its counters at rest there.

A cube that stands on the rim of its pocket does not go down. The servos push, and their counters stay behind. This is
read at rest, before the jaws open: in motion every servo lags, and by how much is not known of a real unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.config.cell import Cell

MOST_COUNTS = 500  # by which a carried cube may hold an axis back beyond the rest tolerance: 4 mm at the tool
MOST_GRIPPED_COUNTS = 200  # by which jaws that close on a cube may push an axis off: 2 mm at the tool
LEAST_SIGMAS = 3.0  # standard deviations of the following error at rest that are not yet taken for contact


@dataclass(frozen=True)
class HeldBack:
    """The arm at rest at a release.

    Attributes:
        by: how far the tool is back from where it was sent, along its axis, m; negative if it is further in.
        expected: the most that it is off without contact, m.
    """

    by: float
    expected: float

    @property
    def by_contact(self) -> bool:
        """Whether something holds it back."""
        return self.by > self.expected

    def words(self) -> str:
        """Say by how much, as a reason."""
        return (
            f"the arm was held back by {1e3 * self.by:.1f} mm at the release, at most {1e3 * self.expected:.1f} mm are "
            "expected without contact"
        )


def held_back(cell: Cell, sent: Sequence[int], settled: Sequence[int]) -> HeldBack:
    """Compare where the arm rests with where it was sent, both in counts (6,).

    Without contact each joint is off by its following error at rest, `accuracy.following_deg`; if that is not known, by
    no more than the tolerance within which an arm counts as at rest.
    """
    unit = cell.unit
    q = unit.positions(sent)
    along = cell.robot_holding().jacobian(q)[2]
    by = -float(along @ (unit.positions(settled) - q))
    if cell.following_error > 0.0:
        sigmas = max(cell.sigmas, LEAST_SIGMAS)
        return HeldBack(by, float(sigmas * cell.following_error * np.sqrt((along**2).sum())))
    return HeldBack(by, float(np.abs(along) @ (unit.rest_tolerance / np.abs(unit.counts_per_rad))))
