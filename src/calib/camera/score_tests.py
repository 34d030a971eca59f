"""Score tests for model errors: how much of the residuals each one explains, and how it would change the intrinsics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.former import renamed_arguments
from arm.se3 import Array
from calib.camera.bundle_adjustment import Bundle, View
from calib.model.intrinsics import COUNT, vector_of
from calib.model.least_squares import eliminate, inverse_scaled
from calib.model.score_test import score_test
from vision.camera.projection import Projection
from vision.targets.target import Target

BIASED_CORNERS = "biased corners"
SURE = 5.0  # standard deviations from which a model error counts as present


@renamed_arguments(lens_change="intrinsics_change")
@dataclass(frozen=True, eq=False)
class ErrorHypothesis:
    """A model error and the evidence for it in the residuals.

    Attributes:
        name: bent target, stretched target, biased corners, changed focus.
        amount: its estimate.
        sigma: standard deviation of `amount`.
        unit: of both.
        sigmas: significance of all its parameters together, in standard deviations.
        intrinsics_change: change of the intrinsics if the model included the error, (9,); for a changed focus, their
            change from the middle of the views to the last.
    """

    name: str
    amount: float
    sigma: float
    unit: str
    sigmas: float
    intrinsics_change: Array

    @property
    def sure(self) -> bool:
        """Whether it is present; poorly determined parameters may be significant, but with an amount near zero."""
        return self.sigmas > SURE and abs(self.amount) > SURE * self.sigma


def error_hypotheses(bundle: Bundle, views: Sequence[View], target: Target) -> list[ErrorHypothesis]:
    """Test every known model error, the most significant first.

    Args:
        bundle: a finished adjustment of `views`.
        views: of `target`, in the order in which they were taken.
    """
    fitted = [Projection(bundle.camera, T, v.points) for T, v in zip(bundle.poses, views, strict=True)]
    focal, half = np.diag(bundle.camera.K)[:2], np.array(target.size) / 2.0
    # z = a X^2 + b X Y + c Y^2, with X and Y from -1 to 1 over the target
    bent = [p.by_point[..., 2:] * bulges(p.points[:, :2] / half - 1.0)[:, None] for p in fitted]
    # rows are further apart than columns by a relative amount, as some printers make them
    stretched = [p.by_point[..., 1:2] * p.points[:, 1, None, None] for p in fitted]
    # corners lie towards the middle of their view, as light, blur and ink may shift them
    biased = [inwards(p.pixels)[..., None] for p in fitted]
    # the focal length changes linearly from the first view to the last, by a relative amount
    times = np.linspace(-0.5, 0.5, len(views))
    refocused = [
        t * (p.by_intrinsics[..., :2] @ focal)[..., None] for t, p in zip(times, fitted, strict=True)
    ]
    to_the_end = np.append(0.5 * focal, np.zeros(COUNT - 2))
    found = (
        _tested(bundle, fitted, "bent target", "m", bent),
        _tested(bundle, fitted, "stretched target", "", stretched),
        _tested(bundle, fitted, BIASED_CORNERS, "px", biased),
        _tested(bundle, fitted, "changed focus", "", refocused, to_the_end),
    )
    return sorted((h for h in found if h is not None), key=lambda h: -h.sigmas)


def inwards(pixels: Array) -> Array:
    """Unit vectors from the points (..., n, 2) px of an image to their middle; shorter within 1 px of it."""
    towards = np.nanmean(pixels, axis=-2, keepdims=True) - pixels
    return np.asarray(towards / np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1.0))


def bulges(xy: Array) -> Array:
    """Return the shapes X^2, X Y and Y^2 of a sheet that bends, (n, 3), at points (n, 2) from -1 to 1."""
    return np.stack([xy[:, 0] ** 2, xy[:, 0] * xy[:, 1], xy[:, 1] ** 2], axis=-1)


def _height(amount: Array) -> Array:
    """Derivative of the height of a bent target by the amounts of its three bulges."""
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)
    shapes = bulges(grid)  # no plane to subtract: the shapes are even, a plane through the middle is odd
    z = shapes @ amount
    return np.asarray(shapes[np.argmax(z)] - shapes[np.argmin(z)])


def _tested(
    bundle: Bundle,
    projections: Sequence[Projection],
    name: str,
    unit: str,
    columns: Sequence[Array],
    to_the_end: Array | None = None,
) -> ErrorHypothesis | None:
    """Test a model error.

    Args:
        bundle: adjustment.
        projections: of its views.
        name, unit: of the error.
        columns: derivative of the corners of each view by the m parameters of the error, (n, 2, m).
        to_the_end: change of the intrinsics from the middle of the views to the last per unit of the error, (9,).
    """
    m, n = columns[0].shape[-1], int(bundle.free.sum())
    fitted = np.append(bundle.free, np.ones(m, dtype=bool))
    weight = np.append(bundle.prior.weight, np.zeros(m))
    S = np.diag(weight)
    g = weight * np.append(bundle.prior.mean - vector_of(bundle.camera), np.zeros(m))
    for p, more, residual in zip(projections, columns, bundle.residuals, strict=True):
        J = np.concatenate([p.by_intrinsics, more], axis=-1).reshape(-1, len(fitted))
        own = eliminate(J, p.by_target.reshape(-1, 6), residual.reshape(-1))
        S, g = S + own.S, g + own.g
    S, g = S[np.ix_(fitted, fitted)], g[fitted]
    test = score_test(inverse_scaled(S[:n, :n]), g[:n], S[:n, n:], S[n:, n:], g[n:])
    left = max(bundle.squares - test.drop, 0.0) / max(bundle.degrees_of_freedom - m, 1)
    if left <= 0.0:
        return None
    slope = _height(test.amount) if m > 1 else np.ones(1)
    change = np.zeros(COUNT) if to_the_end is None else test.amount[0] * to_the_end
    change[bundle.free] += test.others @ test.amount
    return ErrorHypothesis(
        name,
        float(slope @ test.amount),
        float(np.sqrt(left * slope @ test.covariance @ slope)),
        unit,
        float(np.sqrt(max(test.drop, 0.0) / left)),
        change,
    )
