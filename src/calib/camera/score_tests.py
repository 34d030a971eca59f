"""Score tests for model errors: how much each would explain of the residuals, and how it would change the intrinsics.

A score (Lagrange multiplier) test takes one linear step: the residuals of the finished adjustment are projected on the
effect of each model error on the corners, with all fitted parameters left free (C. R. Rao, 1948). The estimate comes
with its standard deviation, so a board is reported as bent by 0.5 mm rather than as suspicious.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array
from calib.camera.bundle_adjustment import Bundle, View, inverse_scaled, solve_scaled
from calib.model.intrinsics import COUNT, lens_parameter_jacobian, vector_of
from vision.boards.pose_fit import pose_jacobian
from vision.targets.target import Target

SURE = 5.0  # standard deviations from which a model error counts as present


@dataclass(frozen=True, eq=False)
class ErrorHypothesis:
    """A model error and the evidence for it in the residuals.

    Attributes:
        name: bent target, stretched target, changed focus.
        amount: its estimate.
        sigma: standard deviation of `amount`.
        unit: of both.
        sigmas: significance of all its parameters together, in standard deviations.
        lens_change: (9,) change of the intrinsics if the model included it; for a changed focus, the change between
            the middle of the views and their end.
    """

    name: str
    amount: float
    sigma: float
    unit: str
    sigmas: float
    lens_change: Array

    @property
    def sure(self) -> bool:
        """Whether it is present; poorly determined parameters may be significant with an amount near zero."""
        return self.sigmas > SURE and abs(self.amount) > SURE * self.sigma


@dataclass(frozen=True)
class _ModelError:
    name: str
    unit: str
    columns: Callable[[int], Array]  # derivative of the corners of a view by its m parameters, (n, 2, m)
    amount: Callable[[Array], float]  # from the m parameters
    slope: Callable[[Array], Array]  # derivative of the amount, (m,)
    range: Array  # (9, m) change of the intrinsics from the middle of the views to the last


def error_hypotheses(bundle: Bundle, views: Sequence[View], target: Target) -> list[ErrorHypothesis]:
    """Test every known model error, the most significant first.

    Args:
        bundle: a finished adjustment of `views`.
        views: of `target`, in the order in which they were taken.
    """
    errors = (_bent(bundle, views, target), _stretched(bundle, views), _refocused(bundle, views))
    found = [s for s in (_tested(bundle, views, error) for error in errors) if s is not None]
    return sorted(found, key=lambda s: -s.sigmas)


def _at(bundle: Bundle, views: Sequence[View], i: int) -> Array:
    T = bundle.poses[i]
    return np.asarray(views[i].points @ T[:3, :3].T + T[:3, 3])


def _bent(bundle: Bundle, views: Sequence[View], target: Target) -> _ModelError:
    """z = a X^2 + b X Y + c Y^2, with X and Y from -1 to 1 over the target."""
    half = np.array(target.size) / 2.0
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)

    def shape(xy: Array) -> Array:
        return np.stack([xy[:, 0] ** 2, xy[:, 0] * xy[:, 1], xy[:, 1] ** 2], axis=-1)

    def columns(i: int) -> Array:
        by_z = bundle.camera.projection_jacobian(_at(bundle, views, i)) @ bundle.poses[i][:3, 2]
        return np.asarray(by_z[:, :, None] * shape(views[i].points[:, :2] / half - 1.0)[:, None])

    bulge = shape(grid)  # no plane to subtract: the shapes are even, a plane through the middle is odd

    def ends(numbers: Array) -> tuple[int, int]:
        height = bulge @ numbers
        return int(np.argmax(height)), int(np.argmin(height))

    def amount(numbers: Array) -> float:
        top, bottom = ends(numbers)
        return float((bulge[top] - bulge[bottom]) @ numbers)

    def slope(numbers: Array) -> Array:
        top, bottom = ends(numbers)
        return np.asarray(bulge[top] - bulge[bottom])

    return _ModelError("bent target", "m", columns, amount, slope, np.zeros((COUNT, 3)))


def _stretched(bundle: Bundle, views: Sequence[View]) -> _ModelError:
    """Rows are further apart than columns by a relative amount, as some printers make them."""

    def columns(i: int) -> Array:
        by_y = bundle.camera.projection_jacobian(_at(bundle, views, i)) @ bundle.poses[i][:3, 1]
        return np.asarray((by_y * views[i].points[:, 1, None])[..., None])

    return _ModelError(
        "stretched target", "", columns, lambda n: float(n[0]), lambda n: np.ones(1), np.zeros((COUNT, 1))
    )


def _refocused(bundle: Bundle, views: Sequence[View]) -> _ModelError:
    """The focal length changes linearly from the first view to the last, by a relative amount."""
    when = np.linspace(-0.5, 0.5, len(views))

    def columns(i: int) -> Array:
        by_lens = lens_parameter_jacobian(bundle.camera, _at(bundle, views, i))
        return np.asarray((when[i] * (by_lens[..., :2] @ np.diag(bundle.camera.K)[:2]))[..., None])

    to_the_end = np.zeros((COUNT, 1))
    to_the_end[:2, 0] = 0.5 * np.diag(bundle.camera.K)[:2]
    return _ModelError("changed focus", "", columns, lambda n: float(n[0]), lambda n: np.ones(1), to_the_end)


def _tested(bundle: Bundle, views: Sequence[View], error: _ModelError) -> ErrorHypothesis | None:
    m = error.columns(0).shape[-1]
    weight = bundle.prior.weight
    S = np.diag(np.concatenate([weight, np.zeros(m)]))
    g = np.concatenate([weight * (bundle.prior.mean - vector_of(bundle.camera)), np.zeros(m)])
    for i, (T, view, residual) in enumerate(zip(bundle.poses, views, bundle.residuals, strict=True)):
        extra = error.columns(i).reshape(-1, m)
        by_lens = lens_parameter_jacobian(bundle.camera, _at(bundle, views, i)).reshape(-1, COUNT)
        J = np.concatenate([by_lens, extra], axis=1)
        P = pose_jacobian(T, view.points, bundle.camera).reshape(-1, 6)
        r = residual.reshape(-1)
        by_pose = np.linalg.solve(P.T @ P, np.column_stack([P.T @ J, P.T @ r]))
        S += J.T @ J - J.T @ P @ by_pose[:, :-1]
        g += J.T @ r - J.T @ P @ by_pose[:, -1]
    kept = np.concatenate([bundle.free, np.ones(m, dtype=bool)])
    S, g = S[np.ix_(kept, kept)], g[kept]
    step = solve_scaled(S, g)
    explained = float(g @ step)
    left = max(bundle.squares - explained, 0.0) / max(bundle.degrees_of_freedom - m, 1)
    if left <= 0.0:
        return None
    covariance = left * inverse_scaled(S)
    numbers, own = step[-m:], covariance[-m:, -m:]
    slope = error.slope(numbers)
    change = np.zeros(COUNT)
    change[bundle.free] = step[:-m]
    change += error.range @ numbers
    return ErrorHypothesis(
        error.name,
        error.amount(numbers),
        float(np.sqrt(slope @ own @ slope)),
        error.unit,
        float(np.sqrt(max(explained, 0.0) / left)),
        change,
    )
