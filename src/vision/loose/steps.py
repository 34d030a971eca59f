"""Locate the first step of a profile across a side of a top, in case a second step beyond it disturbs it.

Beyond a top there may be a narrow face of the cube, a dark gap to a pocket's wall, or another edge, within a few px:
less than what the lens resolves. So a profile is modelled by two blurred steps and a slope beyond them. All levels are
eliminated (they are linear), and the place of the first step is integrated over the distance of the second and over the
blur, which opposite sides share. A second step that is not resolved makes the place uncertain, and so it is reported.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, ndtr

from arm.se3 import Array, Indices

BESIDE = 3.0  # px inside the expected step where a profile begins,
BEYOND = 5.5  # and px beyond it, where it ends
STEP_PX = 0.5  # between samples
OFFSETS: Array = np.arange(-BESIDE, BEYOND + STEP_PX / 2.0, STEP_PX)
PLACES: Array = np.arange(-2.2, 1.61, 0.04)  # px of the first step
GAPS = (0.7, 1.0, 1.4, 1.8, 2.2, 2.7, 3.3, 4.0, 5.0, 6.2)  # px from the first step to the second
BLURS: Array = np.arange(0.7, 1.81, 0.06)  # px, standard deviations
SECOND = 0.7  # standard deviation of the second step, in first ones
SLOPE = 0.03  # of the slope beyond, in first steps per px
NOISE = 0.01  # of a sample, in first steps: the model, and correlation between samples
ALONE = 0.98  # prior probability of no second step


class _Models(NamedTuple):
    """Models of profiles, by blur, gap (the first: no second step) and place.

    Attributes:
        basis: of the space of each model's profiles, orthonormal, (n + 3, b g p 4); three rows for the priors.
        volume: log of each model's prior volume, (b, g, p).
    """

    basis: Array
    volume: Array


@lru_cache(maxsize=1)
def _models() -> _Models:
    x = OFFSETS - PLACES[:, None]
    designs = []
    for blur in BLURS:
        for gap in (np.inf, *GAPS):
            first, last = ndtr(x / blur), ndtr((x - gap) / blur)
            slope = np.maximum(x, 0.0)
            columns = np.stack([np.ones_like(x), first, SECOND * last, SLOPE * slope], axis=-1) / NOISE
            prior = np.broadcast_to(np.eye(4)[1:] * [0.0, 0.3, 1.0, 1.0], (len(x), 3, 4))
            designs.append(np.concatenate([columns, prior], axis=1))
    stack = np.reshape(designs, (len(BLURS), len(GAPS) + 1, len(PLACES), len(OFFSETS) + 3, 4))
    basis, upper = np.linalg.qr(stack)
    volume = -np.log(np.abs(np.diagonal(upper, axis1=-2, axis2=-1))).sum(axis=-1)
    weight = np.full(len(GAPS) + 1, np.log((1.0 - ALONE) / len(GAPS)))
    weight[0] = np.log(ALONE)
    return _Models(
        np.ascontiguousarray(np.moveaxis(basis, -2, 0).reshape(len(OFFSETS) + 3, -1)),
        volume + weight[:, None],
    )


def first_steps(profiles: Array, group: Indices) -> tuple[Array, Array]:
    """Return the place of the first step of each profile and its standard deviation, px, (k,) each.

    Args:
        profiles: grey levels at `OFFSETS` from where a step is expected, (k, n).
        group: number of each profile's group, (k,); a group has one blur. Images that sway have another along x than
            along y.
    """
    models = _models()
    level = profiles[:, :3].mean(axis=1, keepdims=True)
    scale = np.abs(profiles - level).max(axis=1, keepdims=True)
    y = np.concatenate([(profiles - level) / (scale * NOISE), np.zeros((len(profiles), 3))], axis=1)
    explained = ((y @ models.basis) ** 2).reshape(len(y), *models.volume.shape, 4).sum(axis=-1)
    log = models.volume - 0.5 * ((y**2).sum(axis=1)[:, None, None, None] - explained)
    by_place = logsumexp(log, axis=2)  # (k, b, p)
    own = logsumexp(by_place, axis=2)
    of_blur = (group[:, None] == group) @ own
    total = logsumexp(by_place + (of_blur - own)[:, :, None], axis=1)
    weights = np.exp(total - logsumexp(total, axis=1, keepdims=True))
    mean = weights @ PLACES
    std = np.sqrt(np.maximum(weights @ PLACES**2 - mean**2, 0.0))
    return np.asarray(mean), np.asarray(std)
