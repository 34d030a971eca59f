"""How coarse encoders are, seen from their readings alone: all of them are whole steps apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.se3 import Array

_FINEST = np.radians(5e-3)  # rad; what is finer moves a target at 1 m by less than a tenth of a pixel
_COARSEST = np.radians(
    0.5
)  # rad; angles further apart than this on a grid were commanded so: it is no encoder's
_SAME = 1e-3  # part of a step that a reading may be off the grid, from being written down and read again
_FEWEST = 4  # different readings from which a grid is believed


def reading_step(readings: Array) -> float:
    """Step of an encoder, rad, of which all its readings (n,) are whole ones apart; 0 where there is none to be seen.

    Few readings have large steps in common by chance; the larger step is then what they are known to.
    """
    values = np.unique(np.round(readings, 12))
    apart = np.diff(values)
    apart = apart[apart > _FINEST * _SAME]
    if len(apart) < _FEWEST - 1:
        return 0.0
    step = float(apart.min())
    for _ in range(20):  # Euclid's algorithm for the greatest common step
        if step < _FINEST:
            return 0.0
        off = np.abs(apart - np.rint(apart / step) * step)
        left = off[off > _SAME * step]
        if not len(left):
            return step if step < _COARSEST else 0.0
        step = float(left.min())
    return 0.0


def reading_sigmas(chains: Sequence[Array]) -> Array:
    """Standard deviation of each encoder's reading error, (readings,) rad: a step over the root of twelve.

    Encoders of one kind have one step: the finest that is seen in any column, where it divides the others. A grid that
    fewer than half of the columns have is that of the commands, not of encoders.

    Args:
        chains: readings of each chain, (n, readings) rad, the same columns in all.
    """
    each = np.array([[reading_step(column) for column in readings.T] for readings in chains])
    steps = each.max(axis=0)
    seen = each[each > 0.0]
    if (steps > 0.0).sum() < len(steps) / 2.0:
        return np.zeros(len(steps))
    if len(seen):
        finest = float(seen.min())
        whole = np.abs(steps / finest - np.rint(steps / finest)) < 0.01
        steps = np.where(whole & (steps > 0.0), finest, steps)
    return np.asarray(steps / np.sqrt(12.0))
