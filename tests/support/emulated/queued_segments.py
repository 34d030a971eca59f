"""Segments in the queue of an emulated path generator."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.controller.unit import load_unit
from driver.emulator.unit.path_generator import PathGenerator
from driver.emulator.unit.segment import QueuedSegment

UNIT = load_unit("crs93")

SPEED = [r / 256.0 for r in UNIT.speed_registers]

ACCELERATION = [r / 256.0 for r in UNIT.acceleration_registers]

Samples = npt.NDArray[np.int64]


def add(
    path: PathGenerator, rows: list[list[int]], least_ms: float = 0.0, steps: float = 5.0
) -> QueuedSegment:
    segment = QueuedSegment(path.end, rows, least_ms, SPEED, ACCELERATION, path.number + len(path.queue) + 1)
    path.append(segment, steps)
    return segment


def run(path: PathGenerator, ticks: int = 200_000) -> Samples:
    """Every ms until idle, the start included."""
    samples = [path.at]
    while path.queue and len(samples) < ticks:
        path.tick()
        samples.append(path.at)
    assert not path.queue
    return np.array(samples)
