"""Is something else wrong? One linear step tells how much each known trouble would explain, and what it would change.

A score (Lagrange multiplier) test: the residuals of the finished adjustment are projected on what each trouble would do
to the corners, everything that was fitted left free (C. R. Rao, 1948). Its estimate comes with its standard
deviation, so that a board can be called bent by 0.5 mm and not just suspicious.
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

SURE = 5.0  # standard deviations from which a trouble is there


@dataclass(frozen=True, eq=False)
class Suspect:
    """A trouble, as far as the residuals speak of it.

    Attributes:
        name: bent target, stretched target, changed focus.
        amount: how much of it there seems to be.
        sigma: standard deviation of `amount`.
        unit: of both.
        sigmas: how many standard deviations the residuals lean towards it, all its numbers together.
        lens_change: (9,) by which the lens would change if it were allowed for, or does between the middle of the
            views and their end.
    """

    name: str
    amount: float
    sigma: float
    unit: str
    sigmas: float
    lens_change: Array

    @property
    def sure(self) -> bool:
        """Whether it is there; where views determine little, residuals may lean far towards an amount of nothing."""
        return self.sigmas > SURE and abs(self.amount) > SURE * self.sigma


@dataclass(frozen=True)
class _Trouble:
    name: str
    unit: str
    columns: Callable[[int], Array]  # of a view: (n, 2, m)
    amount: Callable[[Array], float]  # from the m numbers
    slope: Callable[[Array], Array]  # of the amount, (m,)
    range: Array  # (9, m) change of the lens itself, from the middle of the views to the last


def suspects(bundle: Bundle, views: Sequence[View], target: Target) -> list[Suspect]:
    """Every trouble that is known, the strongest first.

    Args:
        bundle: a finished adjustment of `views`, which stand in the order in which they were taken.
        views: of `target`.
    """
    troubles = (_bent(bundle, views, target), _stretched(bundle, views), _refocused(bundle, views))
    found = [s for s in (_tested(bundle, views, trouble) for trouble in troubles) if s is not None]
    return sorted(found, key=lambda s: -s.sigmas)


def _at(bundle: Bundle, views: Sequence[View], i: int) -> Array:
    T = bundle.poses[i]
    return np.asarray(views[i].points @ T[:3, :3].T + T[:3, 3])


def _bent(bundle: Bundle, views: Sequence[View], target: Target) -> _Trouble:
    """z = a X^2 + b X Y + c Y^2 with X, Y from -1 to 1 over the chessboard."""
    half = np.array(target.size) / 2.0
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)

    def shape(xy: Array) -> Array:
        return np.stack([xy[:, 0] ** 2, xy[:, 0] * xy[:, 1], xy[:, 1] ** 2], axis=-1)

    def columns(i: int) -> Array:
        by_z = bundle.camera.projection_jacobian(_at(bundle, views, i)) @ bundle.poses[i][:3, 2]
        return np.asarray(by_z[:, :, None] * shape(views[i].points[:, :2] / half - 1.0)[:, None])

    bulge = shape(grid)  # against any plane: the three shapes are even, a plane through the middle is odd

    def ends(numbers: Array) -> tuple[int, int]:
        height = bulge @ numbers
        return int(np.argmax(height)), int(np.argmin(height))

    def amount(numbers: Array) -> float:
        top, bottom = ends(numbers)
        return float((bulge[top] - bulge[bottom]) @ numbers)

    def slope(numbers: Array) -> Array:
        top, bottom = ends(numbers)
        return np.asarray(bulge[top] - bulge[bottom])

    return _Trouble("bent target", "m", columns, amount, slope, np.zeros((COUNT, 3)))


def _stretched(bundle: Bundle, views: Sequence[View]) -> _Trouble:
    """Rows are further apart than columns, as some printers make them, by a part of their distance."""

    def columns(i: int) -> Array:
        by_y = bundle.camera.projection_jacobian(_at(bundle, views, i)) @ bundle.poses[i][:3, 1]
        return np.asarray((by_y * views[i].points[:, 1, None])[..., None])

    return _Trouble(
        "stretched target", "", columns, lambda n: float(n[0]), lambda n: np.ones(1), np.zeros((COUNT, 1))
    )


def _refocused(bundle: Bundle, views: Sequence[View]) -> _Trouble:
    """The focal length changes evenly from the first view to the last, by a part of itself."""
    when = np.linspace(-0.5, 0.5, len(views))

    def columns(i: int) -> Array:
        by_lens = lens_parameter_jacobian(bundle.camera, _at(bundle, views, i))
        return np.asarray((when[i] * (by_lens[..., :2] @ np.diag(bundle.camera.K)[:2]))[..., None])

    to_the_end = np.zeros((COUNT, 1))
    to_the_end[:2, 0] = 0.5 * np.diag(bundle.camera.K)[:2]
    return _Trouble("changed focus", "", columns, lambda n: float(n[0]), lambda n: np.ones(1), to_the_end)


def _tested(bundle: Bundle, views: Sequence[View], trouble: _Trouble) -> Suspect | None:
    m = trouble.columns(0).shape[-1]
    weight = bundle.prior.weight
    S = np.diag(np.concatenate([weight, np.zeros(m)]))
    g = np.concatenate([weight * (bundle.prior.mean - vector_of(bundle.camera)), np.zeros(m)])
    for i, (T, view, residual) in enumerate(zip(bundle.poses, views, bundle.residuals, strict=True)):
        extra = trouble.columns(i).reshape(-1, m)
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
    slope = trouble.slope(numbers)
    change = np.zeros(COUNT)
    change[bundle.free] = step[:-m]
    change += trouble.range @ numbers
    return Suspect(
        trouble.name,
        trouble.amount(numbers),
        float(np.sqrt(slope @ own @ slope)),
        trouble.unit,
        float(np.sqrt(max(explained, 0.0) / left)),
        change,
    )
