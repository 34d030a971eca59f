"""What is wrong with the unit itself at the moment, apart from power, errors and axes that do not follow."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Defects:
    """Counts of what goes wrong next.

    Attributes:
        queue: segments that the unit holds instead of its normal number; None is normal.
        drop_segments: so many of the next are lost in silence.
        miss_grasps: so often the jaws close on nothing.
        early_ready: so many of the next waits are answered ``R!`` at once.
        fail_replies: so many of the next waits are answered ``FAIL!``.
    """

    queue: int | None = None
    drop_segments: int = 0
    miss_grasps: int = 0
    early_ready: int = 0
    fail_replies: int = 0
