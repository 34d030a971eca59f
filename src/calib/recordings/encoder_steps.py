"""Estimate the resolution of encoders from their readings, which are whole steps apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.se3 import Array

_FINEST = np.radians(5e-3)  # rad; a finer step moves a target at 1 m by less than a tenth of a pixel
_COARSEST = np.radians(0.5)  # rad; a coarser grid comes from the commands, not from an encoder
_SAME = 1e-3  # of a step: how far a reading may be off the grid, from rounding in files
_FEWEST = 4  # different readings needed to accept a grid


def encoder_step(readings: Array) -> float:
    """Return the largest step, rad, that divides all differences of an encoder's readings (n,); 0 if there is none.

    Few readings may share too large a step by chance; the estimate is then too coarse.
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


def encoder_sigmas(chains: Sequence[Array], step: float | None = None) -> Array:
    """Standard deviation of each encoder's quantisation error, (readings,) rad: a step over the root of twelve.

    Encoders of one kind have the same step: the finest of any column, where it divides the others. If fewer than half
    of the columns have a grid, it comes from the commands, not from encoders.

    Args:
        chains: readings of each chain, (n, readings) rad, the same columns in all.
        step: of all encoders, rad, if it is known; default: estimated.
    """
    if step is not None:
        return np.full(chains[0].shape[1], step / np.sqrt(12.0))
    each = np.array([[encoder_step(column) for column in readings.T] for readings in chains])
    steps = each.max(axis=0)
    seen = each[each > 0.0]
    if (steps > 0.0).sum() < len(steps) / 2.0:
        return np.zeros(len(steps))
    if len(seen):
        finest = float(seen.min())
        whole = np.abs(steps / finest - np.rint(steps / finest)) < 0.01
        steps = np.where(whole & (steps > 0.0), finest, steps)
    return np.asarray(steps / np.sqrt(12.0))
