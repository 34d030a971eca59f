"""Present defects of the unit, apart from power, axis errors and axes that do not follow."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Defects:
    """Numbers of coming defects.

    Attributes:
        queue: number of segments that the unit holds; None is the normal number.
        drop_segments: number of segments that will be silently dropped.
        miss_grasps: number of times that the jaws will close without gripping anything.
        early_ready: number of waits that will be answered ``R!`` at once.
        fail_replies: number of waits that will be answered ``FAIL!``.
    """

    queue: int | None = None
    drop_segments: int = 0
    miss_grasps: int = 0
    early_ready: int = 0
    fail_replies: int = 0
