"""Recordings of a collection."""

from __future__ import annotations

import numpy as np

from arm.se3 import Array
from cell.collect.record import HandRecord


def taken(record: HandRecord, number: int) -> tuple[tuple[int, ...], Array]:
    corners = len(record.hand.target.points())
    return (100 * number,) * 6, np.random.default_rng(number).uniform(10.0, 900.0, (corners, 2))
