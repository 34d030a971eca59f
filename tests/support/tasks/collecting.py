"""A collection of poses, fast, and what it says."""

from __future__ import annotations

import numpy as np

from arm.se3 import Array
from cell.collect.record import HandRecord
from cell.session.connection import WhichCell

FAST = WhichCell(speed=1.0, time_scale=100.0)


def taken(record: HandRecord, number: int) -> tuple[tuple[int, ...], Array]:
    corners = len(record.hand.target.points())
    return (100 * number,) * 6, np.random.default_rng(number).uniform(10.0, 900.0, (corners, 2))
