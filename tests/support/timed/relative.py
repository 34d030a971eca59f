"""Processor time in multiples of a reference operation: a bound on it holds on a slower machine and under load."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2


def interpreted() -> None:
    """A reference for work of the interpreter, about 5 ms on a core of 2020."""
    sum(i * i for i in range(100_000))


def cost_s(operation: Callable[[], object]) -> float:
    """Processor time of this process, s."""
    begin = time.process_time()
    operation()
    return time.process_time() - begin


def relative_cost(
    operation: Callable[[], object],
    reference: Callable[[], object] = interpreted,
    rounds: int = 5,
    enough: float = 0.0,
) -> float:
    """Processor time of an operation in multiples of the reference's.

    Both run in turn, in one thread of OpenCV; the least of each counts, so what disturbs single rounds does not.
    Other work on the same processor takes its caches, for longer than a few rounds: as long as the result is not below
    `enough`, up to 40 rounds are made.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        costs = [(cost_s(operation), cost_s(reference)) for _ in range(rounds)]
        while 0.0 < enough <= _ratio(costs) and len(costs) < 40:
            costs.append((cost_s(operation), cost_s(reference)))
    finally:
        cv2.setNumThreads(threads)
    return _ratio(costs)


def _ratio(costs: list[tuple[float, float]]) -> float:
    return min(cost for cost, _ in costs) / min(cost for _, cost in costs)
