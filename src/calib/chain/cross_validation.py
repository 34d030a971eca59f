"""Cross-validation of a chain's model: each part of the images is predicted from a fit to the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.chain.fit import fit_chains
from calib.chain.model_selection import Choice

FOLDS = 5


@dataclass(frozen=True)
class CrossValidation:
    """Prediction error of held-out images.

    Attributes:
        px: rms of the residuals' coordinates.
        metres: rms distance between the target's centre and its prediction, across the line of sight, m; inf if a
            target was predicted outside the camera's view, such as behind it.
    """

    px: float
    metres: float


def cross_validate(choice: Choice) -> CrossValidation:
    """Cross-validate: predict each part of the stances from a fit to the others."""
    problem, fit = choice.problem, choice.fit
    squares, count, metres, lost = 0.0, 0, [], False
    for fold in range(FOLDS):
        numbers = [np.unique(s.stances, return_inverse=True)[1] for s in problem.sightings]
        parts = [number % FOLDS == fold for number in numbers]
        weights = [np.where(part, 0.0, w) for part, w in zip(parts, fit.weights, strict=True)]
        known = fit_chains(problem, weights, fit)
        for s, part, w in zip(problem.sightings, parts, fit.weights, strict=True):
            images = np.flatnonzero(part & (w > 0.0))
            if not len(images):
                continue
            expected = s.projection(problem.camera, known.unknowns)
            r = (s.pixels - expected.pixels - s.shifts(known.unknowns))[images]
            depth = expected.in_camera[images, :, 2].mean(axis=1)
            squares += float(np.nansum(r**2))
            count += int(np.isfinite(r).sum())
            focal = np.diag(problem.camera.K)[:2]
            predicted, detected = (np.isfinite(v).any(axis=(1, 2)) for v in (r, s.pixels[images]))
            lost = lost or bool(np.any(detected & ~predicted))
            off = np.nanmean(r[predicted], axis=1) / focal * depth[predicted, None]
            metres.append(np.linalg.norm(off, axis=1))
    if not count:
        return CrossValidation(float("nan"), float("nan"))
    rms = float("inf") if lost else float(np.sqrt(np.mean(np.concatenate(metres) ** 2)))
    return CrossValidation(float(np.sqrt(squares / count)), rms)
