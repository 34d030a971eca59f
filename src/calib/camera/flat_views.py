"""Intrinsics from views of a target that lies flat, whose geometry hardly separates focal length from distance.

Such views hold little information, and the covariance of least squares is too small: each view's tilt has an error, and
these errors look like tilts that would determine the focal length. Here all small effects are unknowns with a prior:
the print is not to scale, paper is not flat, corners have errors common to all views, a lens has its principal point
near the middle, and the tilts scatter about a mean by an amount that is found as well. The focal length has the
marginal likelihood of all others (Laplace's approximation) over a grid, so its interval may be wide and asymmetric. If
views are on a box of known height, the distances of the planes are observations: they determine the focal length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array, frozen, moved
from calib.camera.bundle_adjustment import View
from calib.camera.initial_guess import pose_of
from calib.camera.score_tests import bulges
from calib.model.intrinsics import COUNT, camera_of, pinhole, vector_of
from calib.model.least_squares import Step, inverse_scaled, levenberg_marquardt, solve_scaled
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.targets.target import Target

# standard deviations of what is not exact
PAPER = 0.3e-3  # m, bulges of a sheet, common to all views and again of each view
NOMINAL = 2.5
"""Focal length, image widths, at which `PAPER` holds; elsewhere it is in proportion, or it would act as a ruler."""
STRETCH = 2e-3  # relative, rows against columns, and shear
CORNERS_PX = 0.15  # of each corner, common to all views
PRINCIPAL = 0.03  # of the image's width
ASPECT = 1e-3  # of fy / fx
LENS = (0.10, 0.03, 1e-3, 1e-3, 0.01)  # k1 k2 p1 p2 k3: how far each moves the image's corner, relative
LIES = 0.3e-3  # m: how exactly a sheet lies on the plane that carries it
TILTS = tuple(np.radians((0.1, 0.7, 5.0)))  # scatter of the normals
RANGE = (0.5, 10.0)  # focal lengths, in image widths
COARSE, FINE, WIDTH = 9, 7, 3.0  # points of the grids; half width of the fine one, standard deviations
LEAST_NOISE_PX = 0.02
FAR = 100.0  # m: the plane is nearer
_CLOSE = 0.02  # of the cost, which is in units of variances
_STEPS = 12
_ZOOMS, _UNLIKELY = 3, 6.0


@dataclass(frozen=True, eq=False)
class Lift:
    """A height at which the target lies, above the plane of the views that have none.

    Attributes:
        height: m.
        within: its standard deviation, m.
    """

    height: float
    within: float = 0.2e-3


@dataclass(frozen=True, eq=False)
class FlatCalibration:
    """Intrinsics from flat views.

    Attributes:
        camera: at the mean of the logarithm of the focal length.
        poses: T_camera_target of every view.
        covariance: of the nine intrinsics, (9, 9).
        interval: 95 % of the focal length, px.
    """

    camera: Camera
    poses: tuple[Array, ...]
    covariance: Array
    interval: tuple[float, float]


@dataclass(frozen=True, eq=False)
class _State:
    camera: Camera
    poses: tuple[Array, ...]
    normal: Array  # of the carrying plane, in the camera frame
    depth: float  # of that plane, m
    shared: Array  # stretch, shear, three bulges, then the corners, each in standard deviations
    bulges: Array  # of every view, (n, 3), in standard deviations
    cost: float = np.inf


class FlatViews:
    """The problem: views of one target that lies flat on a plane, or on boxes of known height on it.

    Args:
        views: of the target.
        target: its size scales the bulges.
        size: of the images, px.
        lifts: of each view; None where views lie on the plane. All None: nothing is known of where they lie.
        noise: of a corner's coordinate, px.
    """

    def __init__(
        self,
        views: Sequence[View],
        target: Target,
        size: tuple[int, int],
        lifts: Sequence[Lift | None] = (),
        noise: float = 0.1,
    ) -> None:
        self._views, self._size, self._noise = views, size, noise
        known = any(lift is not None for lift in lifts)
        self._lifts = tuple(lift or Lift(0.0, 0.0) for lift in lifts) if known else ()
        self._half = np.array(target.size) / 2.0
        corners = target.points()
        order = {tuple(p): i for i, p in enumerate(corners.round(9).tolist())}
        self._ids = [np.array([order[tuple(p)] for p in v.points.round(9).tolist()]) for v in views]
        self._corners = len(corners)

    def solve(self) -> FlatCalibration:
        """Estimate the focal length over a grid, and all else at its mean.

        Raises:
            CalibrationRefused: no focal length fits.
        """
        least, most = np.log(np.multiply(RANGE, self._size[0]))
        grid = np.linspace(least, most, COARSE)
        tilts = TILTS[:1] if self._lifts else TILTS  # what lies on a box is parallel to the table
        for _ in range(2):  # of expectation maximisation
            middle = max((self._at(f, tilts[0]) for f in grid[1::3]), key=lambda one: one[1])[0]
            if not np.isfinite(middle.cost):
                raise CalibrationRefused("no focal length fits the flat views", reason="start")
            self._noise = self._residual_noise(middle, tilts[0])
        tried = self._tried(grid, tilts)
        for _ in range(_ZOOMS):  # the coarse grid may be far wider than the likelihood
            likeliest = max(one[3] for one in tried)
            mean, sd = _moments(tried)
            step = grid[1] - grid[0]
            if sd > 0.7 * step:
                break
            width = WIDTH * max(sd, 0.4 * step)
            grid = np.linspace(max(mean - width, least), mean + width, FINE)
            tried = self._tried(grid, sorted({one[1] for one in tried if one[3] > likeliest - _UNLIKELY}))
        mean, sd = _moments(tried)
        best = max(tried, key=lambda one: one[3])
        state, _ = self._at(mean, best[1])
        covariance, slope = self._others(state, best[1])
        total = covariance + sd**2 * np.outer(slope, slope)
        return FlatCalibration(state.camera, state.poses, frozen(total), _interval(tried))

    def _tried(self, grid: Array, tilts: Sequence[float]) -> list[tuple[float, float, _State, float]]:
        found = []
        for tilt in tilts:
            state: _State | None = None
            for f in map(float, grid):
                state, likelihood = self._at(f, tilt, state)
                found.append((f, tilt, state, likelihood))
                state = state if np.isfinite(likelihood) else None
        return found

    def _start(self, log_f: float) -> _State:
        camera = pinhole(float(np.exp(log_f)), self._size)
        starts = tuple(pose_of(view, camera) for view in self._views)
        normal = np.median([T[:3, 2] for T in starts], axis=0)
        normal /= np.linalg.norm(normal)
        lift = [x.height for x in self._lifts] or [0.0] * len(starts)
        depth = float(np.median([normal @ T[:3, 3] + h for T, h in zip(starts, lift, strict=True)]))
        shared = np.zeros(5 + 2 * self._corners)
        return _State(camera, starts, normal, depth, shared, np.zeros((len(starts), 3)))

    def _at(self, log_f: float, tilt: float, near: _State | None = None) -> tuple[_State, float]:
        """The best state at a focal length, and its log marginal likelihood; `near` is that at another one."""
        start = self._start(log_f) if near is None else _rescaled(near, float(np.exp(log_f)))
        start = replace(start, cost=float((self._rows(start, tilt)[0] ** 2).sum()))
        if not np.isfinite(start.cost):
            return start, -np.inf

        def linearise(now: _State) -> Step[_State]:
            r, J = self._rows(now, tilt, derive=True)
            J = J[:, 1:]  # the focal length stays
            H, g = J.T @ J, J.T @ r

            def step(damping: float) -> tuple[_State, bool]:
                try:
                    x = np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
                except np.linalg.LinAlgError:
                    return now, False
                with np.errstate(all="ignore"):
                    then = self._moved(now, np.append(0.0, x))
                    then = replace(then, cost=float((self._rows(then, tilt)[0] ** 2).sum()))
                return then, now.cost - then.cost < _CLOSE

            return step

        state, _ = levenberg_marquardt(start, lambda s: s.cost, linearise, _STEPS)
        J = self._rows(state, tilt, derive=True)[1][:, 1:]
        log_det = float(np.linalg.slogdet(J.T @ J)[1])
        return state, -0.5 * state.cost - 0.5 * log_det - self._norm(state, tilt)

    def _norm(self, s: _State, tilt: float) -> float:
        """Logarithm of the widths of the priors that depend on the grid: tilts, lens, and distances, all alike."""
        depths = np.array([s.depth] if self._lifts else [T[2, 3] for T in s.poses])
        lens = self._prior(vector_of(s.camera))[1]
        return float(2.0 * len(s.poses) * np.log(tilt) + np.log(lens).sum() + np.log(depths).sum())

    def _moved(self, s: _State, x: Array) -> _State:
        lens, rest = x[:COUNT], x[COUNT:]
        v = vector_of(s.camera)
        f = v[0] * np.exp(lens[0])
        ratio = v[1] / v[0] * np.exp(lens[1])
        camera = camera_of(np.array([f, f * ratio, *(v[2:] + lens[2:])]), self._size)
        shared = len(s.shared)
        poses = rest[3 + shared :].reshape(-1, 9)
        normal = s.normal + _across(s.normal) @ rest[:2]
        return _State(
            camera,
            tuple(moved(T, p[:6]) for T, p in zip(s.poses, poses, strict=True)),
            normal / np.linalg.norm(normal),
            s.depth + rest[2],
            s.shared + rest[3 : 3 + shared],
            s.bulges + poses[:, 6:],
        )

    def _rows(self, s: _State, tilt: float, derive: bool = False) -> tuple[Array, Array]:
        """Whitened residuals, measured minus predicted, and the derivatives of the prediction."""
        n, shared = len(self._views), len(s.shared)
        first = COUNT + 3 + shared
        count = first + 9 * n
        E, v = _across(s.normal), vector_of(s.camera)
        paper = PAPER * v[0] / (NOMINAL * self._size[0])
        residuals, rows = [], []
        for i, (view, T, ids) in enumerate(zip(self._views, s.poses, self._ids, strict=True)):
            by_shared = self._by_shared(view.points, ids, shared, v[0] / max(T[2, 3], 1e-6), paper)
            bulge = np.zeros((len(ids), 3, 3))
            bulge[:, 2] = paper * bulges(view.points[:, :2] / self._half - 1.0)
            p = Projection(s.camera, T, view.points + by_shared @ s.shared + bulge @ s.bulges[i])
            residuals.append(((view.pixels - p.pixels) / self._noise).ravel())
            normal, offset = T[:3, 2], float(s.normal @ T[:3, 3])
            residuals.append(-(E.T @ (normal - s.normal)) / tilt)
            if self._lifts:
                within = float(np.hypot(LIES, self._lifts[i].within))
                residuals.append(np.array([-(offset - s.depth + self._lifts[i].height) / within]))
            if not derive:
                continue
            J = np.zeros((len(ids), 2, count))
            by = p.by_intrinsics
            J[..., 0] = by[..., 0] * v[0] + by[..., 1] * v[1]
            J[..., 1] = by[..., 1] * v[1]
            J[..., 2:COUNT] = by[..., 2:]
            J[..., COUNT + 3 : first] = p.by_point @ by_shared
            own = first + 9 * i
            J[..., own : own + 6] = p.by_target
            J[..., own + 6 : own + 9] = p.by_point @ bulge
            rows.append(J.reshape(-1, count) / self._noise)
            of_tilt = np.zeros((2, count))
            turn = T[:3, :3] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
            of_tilt[:, own + 3 : own + 6] = E.T @ turn / tilt
            of_tilt[:, COUNT : COUNT + 2] = -np.eye(2) / tilt
            rows.append(of_tilt)
            if self._lifts:
                of_plane = np.zeros((1, count))
                of_plane[0, own : own + 3] = s.normal @ T[:3, :3] / within
                of_plane[0, COUNT : COUNT + 2] = T[:3, 3] @ E / within
                of_plane[0, COUNT + 2] = -1.0 / within
                rows.append(of_plane)
        prior, lens = self._prior(v)
        residuals += [prior, -s.shared, -s.bulges.ravel(), np.array([-s.depth / FAR])]
        if not derive:
            return np.concatenate(residuals), np.empty((0, count))
        of_prior = np.zeros((COUNT + shared + 3 * n, count))
        of_prior[-1, COUNT + 2] = 1.0 / FAR
        of_prior[: COUNT - 1, 1:COUNT] = np.diag(1.0 / lens)
        of_prior[COUNT - 1 : COUNT - 1 + shared, COUNT + 3 : first] = np.eye(shared)
        for i in range(n):
            place = COUNT - 1 + shared + 3 * i
            of_prior[place : place + 3, first + 9 * i + 6 : first + 9 * i + 9] = np.eye(3)
        return np.concatenate(residuals), np.concatenate([*rows, of_prior])

    def _by_shared(self, points: Array, ids: Array, shared: int, px_per_m: float, paper: float) -> Array:
        """Derivatives of the points by the shared effects, (m, 3, shared)."""
        centred = points[:, :2] - self._half
        by = np.zeros((len(points), 3, shared))
        by[:, 1, 0] = STRETCH * centred[:, 1]
        by[:, 0, 1] = STRETCH * centred[:, 1]
        by[:, 2, 2:5] = paper * bulges(centred / self._half)
        each = np.arange(len(points))
        for axis in range(2):
            by[each, axis, 5 + 2 * ids + axis] = CORNERS_PX / px_per_m
        return by

    def _prior(self, v: Array) -> tuple[Array, Array]:
        """Residuals (8,) of the prior on aspect, principal point and distortion, and its standard deviations."""
        middle = (np.array(self._size) - 1.0) / 2.0
        r = float(np.linalg.norm(middle / v[0]))
        powers = np.array([r**-2, r**-4, 1.0 / r, 1.0 / r, r**-6])
        sigma = np.array([ASPECT, *[PRINCIPAL * self._size[0]] * 2, *(np.array(LENS) * powers)])
        off = np.array([np.log(v[1] / v[0]), *(v[2:4] - middle), *v[4:]])
        return -off / sigma, sigma

    def _residual_noise(self, s: _State, tilt: float) -> float:
        """Noise that explains the corners' residuals: one step of expectation maximisation, repeated by the caller."""
        r, J = self._rows(s, tilt, derive=True)
        H = inverse_scaled(J[:, 1:].T @ J[:, 1:])
        squares, used, row = 0.0, 0.0, 0
        step = 3 if self._lifts else 2
        measured = 0
        for view in self._views:
            part = slice(row, row + 2 * len(view.points))
            own = J[part, 1:]
            squares += float((r[part] ** 2).sum())
            used += float(np.einsum("ij,jk,ik->", own, H, own))
            measured += 2 * len(view.points)
            row = part.stop + step
        return max(self._noise * float(np.sqrt(squares / max(measured - used, 1.0))), LEAST_NOISE_PX)

    def _others(self, s: _State, tilt: float) -> tuple[Array, Array]:
        """Covariance of the intrinsics at a fixed focal length, and their change with its logarithm, (9,)."""
        J = self._rows(s, tilt, derive=True)[1]
        H = J.T @ J
        inner = inverse_scaled(H[1:, 1:])
        by_log = np.append(1.0, -solve_scaled(H[1:, 1:], H[1:, 0]))[:COUNT]
        covariance = np.zeros((COUNT, COUNT))
        covariance[1:, 1:] = inner[: COUNT - 1, : COUNT - 1]
        v = vector_of(s.camera)
        to_vector = np.eye(COUNT)
        to_vector[0, 0], to_vector[1, 0], to_vector[1, 1] = v[0], v[1], v[1]
        return to_vector @ covariance @ to_vector.T, to_vector @ by_log


def _rescaled(s: _State, f: float) -> _State:
    """The same picture at another focal length: distances in proportion, distortion at the same pixels."""
    v = vector_of(s.camera)
    ratio = f / v[0]
    lens = np.array(
        [f, v[1] * ratio, *v[2:4], v[4] * ratio**2, v[5] * ratio**4, *v[6:8] * ratio, v[8] * ratio**6]
    )
    poses = []
    for T in s.poses:
        there = T.copy()
        there[2, 3] *= ratio
        poses.append(there)
    return replace(s, camera=camera_of(lens, s.camera.size), poses=tuple(poses), depth=s.depth * ratio)


def _across(normal: Array) -> Array:
    """Two directions across a normal, (3, 2)."""
    return np.asarray(np.linalg.svd(normal[None])[2][1:].T)


def _weights(tried: Sequence[tuple[float, float, _State, float]]) -> tuple[Array, Array]:
    fs = np.array(sorted({one[0] for one in tried}))
    most = max(one[3] for one in tried)
    weights = np.array([sum(np.exp(one[3] - most) for one in tried if one[0] == f) for f in fs])
    return fs, weights / weights.sum()


def _moments(tried: Sequence[tuple[float, float, _State, float]]) -> tuple[float, float]:
    fs, w = _weights(tried)
    mean = float(w @ fs)
    return mean, float(np.sqrt(w @ (fs - mean) ** 2))


def _interval(tried: Sequence[tuple[float, float, _State, float]]) -> tuple[float, float]:
    fs, w = _weights(tried)
    total = np.append(0.0, np.cumsum((w[1:] + w[:-1]) / 2.0))
    low, high = np.exp(np.interp((0.025, 0.975), total / total[-1], fs))
    return float(low), float(high)
