"""The values of each point of a study, from its number alone."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from cell.files.study import Study

_DIGITS = 6  # after the point, or as many of a narrow range, so that files can state a value exactly


def points_of(study: Study, first: int, count: int) -> list[tuple[Any, ...]]:
    """Return the values of some points, one per varied value.

    The first of the grids varies slowest, the samples fastest.
    """
    grids, samples = _places(study, first, count)
    columns = [
        [one.grid[k] for k in grids[:, at].tolist()] if one.grid else samples[:, at].tolist()
        for at, one in enumerate(study.vary)
    ]
    return list(zip(*columns, strict=True))


def scaled_points(study: Study, first: int, count: int) -> Array:
    """Return where some points are (count, d), each range or grid scaled to 0 to 1."""
    grids, samples = _places(study, first, count)
    scaled = np.zeros((count, len(study.vary)))
    for k, one in enumerate(study.vary):
        if one.grid:
            scaled[:, k] = grids[:, k] / (len(one.grid) - 1)
        elif one.low is not None and one.high is not None:
            scaled[:, k] = (samples[:, k] - one.low) / (one.high - one.low)
    return scaled


def _places(study: Study, first: int, count: int) -> tuple[npt.NDArray[np.int64], Array]:
    """Places in the grids (count, d), and values in the ranges (count, d)."""
    cell, sample = np.divmod(np.arange(first, first + count), study.samples)
    grids, samples = np.zeros((count, len(study.vary)), dtype=np.int64), np.zeros((count, len(study.vary)))
    for k in reversed(range(len(study.vary))):
        if grid := study.vary[k].grid:
            cell, grids[:, k] = np.divmod(cell, len(grid))
    ranges = [k for k, one in enumerate(study.vary) if not one.grid]
    if ranges and count:
        begin = first % study.samples
        whole = begin + count > study.samples  # more than one point of the grids
        drawn = _drawn(len(ranges), study.seed, *((0, study.samples) if whole else (begin, count)))
        for k, column in zip(ranges, drawn[sample if whole else slice(None)].T, strict=True):
            samples[:, k] = _stated(study.vary[k].low or 0.0, study.vary[k].high or 0.0, column)
    return grids, samples


def _stated(low: float, high: float, column: Array) -> Array:
    """Scale shares to a range, rounded."""
    digits = max(_DIGITS, _DIGITS - math.floor(math.log10(high - low)))
    return np.clip(np.round(low + column * (high - low), digits), low, high)


@lru_cache(maxsize=4)
def _drawn(dimensions: int, seed: int, first: int, count: int) -> Array:
    """Scrambled Sobol points (count, dimensions)."""
    from scipy.stats.qmc import Sobol

    sequence = Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    if first:
        sequence.fast_forward(first)
    one: Array = sequence.random(1)  # by itself: without it, a number that is no power of two is warned of
    return one if count == 1 else np.vstack([one, sequence.random(count - 1)])
