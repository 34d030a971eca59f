"""Two lens calibrations from stereo pairs of one checkerboard against each other: python bench/stereo_pairs.py FOLDER.

FOLDER has left01.jpg, right01.jpg, ..., such as /usr/share/doc/opencv-doc/examples/data of Debian's opencv-doc (13
pairs, 640 x 480, 9 x 6 inner corners); none of them belongs to the project. Both cameras see the same board at
the same moment. So a lens that is right has to agree with the other camera, whatever found the corners:

- each camera alone, and both with one relative pose; the board flat, or bent by three unknown bulges;
- without any board: how far corners are from their epipolar lines, for the lenses of each fit.

Corners of ours (`TargetFinder`) and of OpenCV: SB is findChessboardCornersSB with CALIB_CB_ACCURACY, w5 and w11 are
findChessboardCorners with cornerSubPix in windows of half width 5 and 11 px.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares

from arm.se3 import Array, inverse, moved, rotation
from calib.camera.bundle_adjustment import View, adjust
from calib.camera.initial_guess import initial_guess
from calib.model.intrinsics import COUNT, camera_of, vector_of
from calib.model.least_squares import inverse_scaled, solve_scaled
from vision.camera.frame_source import Image, read_grey
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.targets.target import Target, TargetFinder

TARGET = Target("checkerboard", 10, 7, 0.025, 0.0, "")
POINTS = TARGET.points()
SIDES = ("left", "right")
FINDERS = ("ours", "SB", "w5", "w11")
_HALF = np.array(TARGET.size) / 2.0
_STEPS, _DONE = 30, 1e-10
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)


def corners_of(image: Image, finder: str) -> Array | None:
    """Inner corners (54, 2) px by one of the finders, in either order; None if it does not find them."""
    if finder == "ours":
        view = TargetFinder(TARGET).find(image)
        return None if view is None else view.corners_px
    inner = (TARGET.columns - 1, TARGET.rows - 1)
    if finder == "SB":
        found, corners = cv2.findChessboardCornersSB(image, inner, flags=cv2.CALIB_CB_ACCURACY)
    else:
        found, corners = cv2.findChessboardCorners(image, inner)
        if found:
            corners = cv2.cornerSubPix(image, corners, (int(finder[1:]),) * 2, (-1, -1), _STOP)
    return np.asarray(corners, dtype=float).reshape(-1, 2) if found else None


def in_order(corners: Array, other: Array) -> Array:
    """Return the corners in the order that differs from `other` by the most even shift: pairs differ by a disparity."""
    spread = [float(np.std(c - other, axis=0).sum()) for c in (corners, corners[::-1])]
    return corners if spread[0] <= spread[1] else corners[::-1].copy()


@dataclass(frozen=True, eq=False)
class Rig:
    """One or two cameras before a board: poses of the board in the first camera, the second camera behind `T`.

    Attributes:
        cameras: one or two.
        T: T_second_first, 4x4.
        poses: T_first_board of every view.
        bulges: heights of x^2, xy and y^2 over half the print, (3,) m.
    """

    cameras: tuple[Camera, ...]
    T: Array
    poses: tuple[Array, ...]
    bulges: Array

    @property
    def points(self) -> Array:
        """Of the bent board, (54, 3) m."""
        bent = POINTS.copy()
        bent[:, 2] += _shapes() @ self.bulges
        return bent

    def moved(self, step: Array) -> Rig:
        """Step (n,): intrinsics of all cameras, twist of `T`, bulges, twists of the poses."""
        n = COUNT * len(self.cameras)
        own = step[:n].reshape(-1, COUNT)
        cameras = tuple(camera_of(vector_of(c) + d, c.size) for c, d in zip(self.cameras, own, strict=True))
        twists = step[n + 9 :].reshape(-1, 6)
        poses = tuple(moved(T, twist) for T, twist in zip(self.poses, twists, strict=True))
        return Rig(cameras, moved(self.T, step[n : n + 6]), poses, self.bulges + step[n + 6 : n + 9])

    def equations(self, pixels: Sequence[Array]) -> tuple[Array, Array]:
        """Residuals (m,) px and their negative derivative (m, n) by the step."""
        n, rows, residuals = COUNT * len(self.cameras), [], []
        for view, T in enumerate(self.poses):
            in_first = self.points @ T[:3, :3].T + T[:3, 3]
            for number, camera in enumerate(self.cameras):
                p = Projection(camera, self.T @ T if number else T, self.points)
                J = np.zeros((*p.pixels.shape, n + 9 + 6 * len(self.poses)))
                J[..., COUNT * number : COUNT * (number + 1)] = p.by_intrinsics
                if number:
                    J[..., n : n + 6] = Projection(camera, self.T, in_first).by_target
                J[..., n + 6 : n + 9] = p.by_point[..., 2:] * _shapes()[:, None]
                J[..., n + 9 + 6 * view : n + 15 + 6 * view] = p.by_target
                rows.append(J.reshape(-1, J.shape[-1]))
                residuals.append((pixels[number][view] - p.pixels).ravel())
        return np.concatenate(residuals), np.concatenate(rows)


def _shapes() -> Array:
    x, y = (POINTS[:, :2] / _HALF - 1.0).T
    return np.stack([x * x, x * y, y * y], axis=-1)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A rig fitted to corners; covariance (n, n) of the step, and the corner error, px."""

    rig: Rig
    covariance: Array
    sigma: float

    def words(self) -> str:
        """Focal lengths, corner error, and the bend of the print."""
        sd = np.sqrt(np.diag(self.covariance))
        n = COUNT * len(self.rig.cameras)
        focal = ", ".join(f"{c.K[0, 0]:.2f} +- {sd[COUNT * k]:.2f}" for k, c in enumerate(self.rig.cameras))
        free = sd[n + 6] > 0.0
        bend = ", ".join(
            f"{1e3 * b:+.2f} +- {1e3 * s:.2f}"
            for b, s in zip(self.rig.bulges, sd[n + 6 : n + 9], strict=True)
        )
        return f"{focal} | {self.sigma:.3f} | {bend if free else 'flat'}"


def fit(start: Rig, pixels: Sequence[Array], bent: bool) -> Fitted:
    """Least squares from a start; with one camera `T` is held, and the bulges unless `bent`."""
    n = COUNT * len(start.cameras)
    free = np.ones(n + 9 + 6 * len(start.poses), dtype=bool)
    free[n : n + 6], free[n + 6 : n + 9] = len(start.cameras) > 1, bent
    rig, (r, J) = start, start.equations(pixels)
    for _ in range(_STEPS):
        step = np.zeros(len(free))
        step[free] = solve_scaled(J[:, free].T @ J[:, free], J[:, free].T @ r)
        rig, before = rig.moved(step), r @ r
        r, J = rig.equations(pixels)
        if abs(before - r @ r) < _DONE * before:
            break
    variance = float(r @ r) / (len(r) - int(free.sum()))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = variance * inverse_scaled(J[:, free].T @ J[:, free])
    return Fitted(rig, covariance, float(np.sqrt(variance)))


def alone(pixels: Array, size: tuple[int, int]) -> Rig:
    """One camera as `calibrate camera` fits it, a flat board."""
    views = [View(POINTS, p) for p in pixels]
    start = initial_guess(views, size)
    bundle = adjust(views, start.camera, start.poses, np.ones(COUNT, dtype=bool), start.prior)
    return Rig((bundle.camera,), np.eye(4), bundle.poses, np.zeros(3))


def together(left: Rig, right: Rig) -> Rig:
    """Both cameras with the relative pose of their first views."""
    T = right.poses[0] @ inverse(left.poses[0])
    return Rig((*left.cameras, *right.cameras), T, left.poses, np.zeros(3))


def epipolar_px(pixels: Sequence[Array], cameras: Sequence[Camera]) -> float:
    """Rms distance of corners from their epipolar lines (Sampson), px, with the best relative pose for these lenses."""
    rays = [
        np.append(flat := camera.normalised(p.reshape(-1, 2)), np.ones((len(flat), 1)), axis=1)
        for camera, p in zip(cameras, pixels, strict=True)
    ]
    focal = float(np.mean([c.K[0, 0] for c in cameras]))

    def distance(x: Array) -> Array:
        t = np.array([-1.0, x[3], x[4]])
        E = np.cross(np.eye(3), t / np.linalg.norm(t)).T @ rotation(x[:3])
        a, b = rays[0] @ E.T, rays[1] @ E
        return np.asarray(focal * (rays[1] * a).sum(axis=1) / np.sqrt((a**2 + b**2)[:, :2].sum(axis=1)))

    return float(np.sqrt(np.mean(least_squares(distance, np.zeros(5), x_scale=0.01).fun ** 2)))


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    names = [
        p.name[4:] for p in sorted(folder.glob("left[0-9]*.*")) if (folder / f"right{p.name[4:]}").exists()
    ]
    if not names:
        sys.exit(f"{folder}: has no pairs left01.jpg, right01.jpg, ...")
    images = [[read_grey(folder / f"{side}{name}") for name in names] for side in SIDES]
    size = (images[0][0].shape[1], images[0][0].shape[0])
    print(f"{len(names)} pairs of {size[0]} x {size[1]} px, {TARGET.label()}\n")
    print(
        "| corners | cameras | fx of each, px | corner error px | bulges x2, xy, y2 mm |\n|---|---|---|---|---|"
    )
    seen: dict[str, list[Array]] = {}
    lenses: dict[str, list[Camera]] = {}
    for finder in FINDERS:
        found = [[corners_of(image, finder) for image in side] for side in images]
        pairs = [(a, b) for a, b in zip(*found, strict=True) if a is not None and b is not None]
        seen[finder] = [np.array([a for a, _ in pairs]), np.array([in_order(b, a) for a, b in pairs])]
        rigs = [alone(pixels, size) for pixels in seen[finder]]
        both = fit(together(*rigs), seen[finder], bent=False).rig
        for bent in (False, True):
            single = [fit(rig, [pixels], bent) for rig, pixels in zip(rigs, seen[finder], strict=True)]
            joint = fit(both, seen[finder], bent)
            rows = (*zip(SIDES, single, strict=True), ("both", joint))
            for name, fitted in rows:
                print(f"| {finder} | {name} | {fitted.words()} |")
            lenses[f"{finder}, {'bent' if bent else 'flat'}"] = [f.rig.cameras[0] for f in single]
            lenses[f"{finder}, both, {'bent' if bent else 'flat'}"] = list(joint.rig.cameras)
    print("\nRms distance from epipolar lines, px, by corners (columns) and lenses (rows)\n")
    print(f"| lenses | {' | '.join(FINDERS)} |\n|{'---|' * (len(FINDERS) + 1)}")
    for name, cameras in lenses.items():
        print(f"| {name} | {' | '.join(f'{epipolar_px(seen[f], cameras):.4f}' for f in FINDERS)} |")


if __name__ == "__main__":
    main()
