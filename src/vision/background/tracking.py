"""Find features of the background in a later image: a search for each patch, then Lucas-Kanade with gain and offset.

B. Lucas, T. Kanade, An iterative image registration technique with an application to stereo vision, IJCAI 1981; in its
inverse compositional form (S. Baker, I. Matthews, IJCV 56, 2004), where the patch's own gradients are used throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from vision.background.features import HALF, Background, Floats, patch_at

NEAR = 12  # px, searched about the expected position
FAR = 120  # px, searched if too few features are near: a camera that was knocked
ALIKE = 0.6  # smallest correlation of a patch with its place in the image
FAR_FEATURES = 80  # that are searched for far away, the first of each part of the image
SHARED = 4.0  # times the variance that independent pixels would give: the band-pass makes neighbours share their noise
_STEPS, _SMALL = 12, 1e-3  # iterations, and px of the last step
_LEAST_GAIN = 0.3


@dataclass(frozen=True, eq=False)
class Tracks:
    """Features found in an image.

    Attributes:
        index: (m,) of the features.
        shifts: (m, 2) px from a feature's point to its place in the image.
        covariances: (m, 2, 2) px^2, of the image's noise and of what changed about the feature.
    """

    index: npt.NDArray[np.intp]
    shifts: Array
    covariances: Array


def track(background: Background, passed: Floats, guess: npt.ArrayLike = (0.0, 0.0)) -> Tracks:
    """Find the features within `NEAR` of where they are expected.

    Args:
        background: features.
        passed: band-passed image.
        guess: expected shift of all, (2,) or of each, (n, 2), px.
    """
    guesses = np.broadcast_to(np.asarray(guess, dtype=float), background.points.shape)
    found = [
        (i, *one)
        for i, (point, patch) in enumerate(zip(background.points, background.patches, strict=True))
        if (one := _tracked(patch, passed, point, guesses[i])) is not None
    ]
    if not found:
        return Tracks(np.zeros(0, np.intp), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    index, shifts, covariances = zip(*found, strict=True)
    return Tracks(np.array(index), np.array(shifts), np.array(covariances))


def far_shift(background: Background, passed: Floats) -> Array | None:
    """Return the common shift of the background, (2,) px, if it is up to `FAR`; None if features disagree."""
    chosen = np.unique(np.linspace(0, len(background.points) - 1, FAR_FEATURES).astype(int))
    shifts = []
    for i in chosen:
        area = patch_at(passed, background.points[i], HALF + FAR)
        best, place = _best(area, background.patches[i])
        if best >= ALIKE:
            shifts.append(place - FAR)
    if not shifts:
        return None
    found = np.array(shifts)
    near = np.linalg.norm(found[:, None] - found[None], axis=-1) <= NEAR / 2.0
    votes = near.sum(axis=1)
    leader = int(np.argmax(votes))
    return None if votes[leader] < max(6, len(chosen) // 10) else found[near[leader]].mean(axis=0)


def _best(area: Floats, patch: Floats) -> tuple[float, Array]:
    """Return the largest correlation of a patch in an area, and its place (x, y)."""
    _, peak, _, place = cv2.minMaxLoc(cv2.matchTemplate(area, patch, cv2.TM_CCOEFF_NORMED))
    return float(peak), np.array(place, dtype=float)


def _tracked(patch: Floats, passed: Floats, point: Array, guess: Array) -> tuple[Array, Array] | None:
    peak, place = _best(patch_at(passed, point + guess, HALF + NEAR), patch)
    if peak < ALIKE:
        return None
    shift = guess + place - NEAR
    gy, gx = np.gradient(patch)
    A = np.stack([gx.ravel(), gy.ravel(), patch.ravel(), np.ones(patch.size)], axis=1).astype(float)
    inverse = np.linalg.inv(A.T @ A)
    for _ in range(_STEPS):
        residual = (patch_at(passed, point + shift) - patch).ravel().astype(float)
        change = inverse @ (A.T @ residual)
        step = change[:2] / max(1.0 + change[2], _LEAST_GAIN)
        shift = shift - step
        if float(np.hypot(*step)) < _SMALL:
            left = residual - A @ change
            variance = float(left @ left) / (patch.size - A.shape[1])
            return shift, inverse[:2, :2] * (SHARED * variance)
    return None
