"""What the shape of a print leaves open in single photographs of the real cell: python bench/print_shape.py FOLDER.

The wire board of bench/real_cell.py is the same print in each photograph. A joint fit to photographs of seven places
finds the shape of its two markers and the board's poses; single photographs, which do not know the shape, are compared
with these poses. Twins are boards in the pose of a photograph, made within the tolerance, with corners displaced by
as much as the found shape, and with the photograph's own noise and sides: what do they say of themselves, how far are
they off, how many are accepted?
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from real_cell import Photos, assumed_camera, table, versions, wire_board

from arm.poses import BoardPose
from arm.se3 import Array, inverse, moved, rotation_vector
from pictures.made_boards import made
from vision.boards.pose import BoardAssessment, assess_board
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.markers.border_shift import moved_outwards
from vision.markers.detect import Marker, detect_markers

NAMES = (
    *(f"image_{k:03d}" for k in (3, 5, 6, 9, 10, 11)),
    "data_05",
)  # both markers whole, each another place
CORNER_PX, SHAPE_MM = 0.07, 0.06  # expected of a corner in a photograph, and of the print
BOARD = wire_board()
POINTS = BOARD.marker_corners().reshape(8, 3)
STEPS = np.array([1e-3] * 3 + [1e-2] * 3)  # m and rad of a unit of the fit


@dataclass(frozen=True)
class Shot:
    """A photograph's markers by id, and what is said of its board."""

    name: str
    markers: dict[int, Marker]
    verdict: BoardAssessment

    @property
    def pose(self) -> BoardPose:
        """The estimate, accepted or not."""
        if self.verdict.pose is None:
            sys.exit(f"{self.name}: no pose")
        return self.verdict.pose


@dataclass(frozen=True)
class Joint:
    """The print's shape, (8, 2) mm; of each photograph the pose, its rotation's covariance, rad^2, and residual px."""

    shape: Array
    poses: list[Array]
    covariances: list[Array]
    residuals: list[float]


def joint(shots: Sequence[Shot], camera: Camera) -> Joint:
    """Fit the shape and all poses."""
    seen = [np.concatenate([s.markers[i].corners_px for i in BOARD.marker_ids]) for s in shots]

    def parts(x: Array) -> tuple[Array, list[Array]]:
        points = POINTS + np.hstack([1e-3 * x[:16].reshape(8, 2), np.zeros((8, 1))])
        twists = x[16:].reshape(-1, 6) * STEPS
        return points, [moved(s.pose.T_base_board, xi) for s, xi in zip(shots, twists, strict=True)]

    def off(x: Array) -> list[Array]:
        points, poses = parts(x)
        return [px - Projection(camera, T, points).pixels for px, T in zip(seen, poses, strict=True)]

    fit = least_squares(
        lambda x: np.concatenate([np.ravel(off(x)) / CORNER_PX, x[:16] / SHAPE_MM]),
        np.zeros(16 + 6 * len(shots)),
    )
    C = np.linalg.inv(fit.jac.T @ fit.jac)
    turns = [slice(19 + 6 * k, 22 + 6 * k) for k in range(len(shots))]
    rms = [float(np.sqrt(np.mean(r**2))) for r in off(fit.x)]
    return Joint(fit.x[:16].reshape(8, 2), parts(fit.x)[1], [STEPS[3] ** 2 * C[t, t] for t in turns], rms)


def worst(covariance: Array) -> tuple[float, Array]:
    """Standard deviation of a rotation about its least certain axis, deg, and the axis."""
    values, axes = np.linalg.eigh(covariance)
    return float(np.degrees(np.sqrt(values[-1]))), axes[:, -1]


def turn(T: Array, pose: BoardPose) -> Array:
    """Rotation from one pose to another, rad."""
    return np.asarray(rotation_vector((inverse(T) @ pose.T_base_board)[:3, :3]))


def twin(shot: Shot, shape: float, camera: Camera, rng: np.random.Generator) -> BoardAssessment:
    """Assess a board in the photograph's pose with a print of its own, whose corners are off by `shape` m."""
    corners = made(BOARD, rng)
    corners[..., :2] += shape * rng.standard_normal((2, 4, 2))
    frame = []
    for marker_id, outline in zip(BOARD.marker_ids, corners, strict=True):
        like = shot.markers[marker_id]
        if like.noise is None or like.side_sigma_px is None:
            sys.exit(f"{shot.name}: marker {marker_id} has no border lines")
        pixels = Projection(camera, shot.pose.T_base_board, outline).pixels
        pixels = pixels + rng.multivariate_normal(np.zeros(8), like.noise).reshape(4, 2)
        pixels = moved_outwards(pixels, like.side_sigma_px * rng.standard_normal(4))
        frame.append(replace(like, corners_px=pixels))
    return assess_board(BOARD, [frame], camera)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of bench/real_cell.py")
    parser.add_argument("--twins", type=int, default=300, help="of each photograph")
    options = parser.parse_args()
    photos, camera, shots = Photos(options.folder), assumed_camera(), []
    for name in NAMES:
        found = detect_markers(photos.image(f"hoop_arm/{name}.png"), camera)
        shots.append(Shot(name, {m.id: m for m in found}, assess_board(BOARD, [found], camera)))
    print(f"# Shape of a print\n\n{versions()}; {options.twins} twins a photograph")
    together = joint(shots, camera)
    rms = float(np.sqrt(np.mean(together.shape**2)))
    table(
        "Single photographs against the joint fit",
        "photograph",
        "accepted",
        "residual px, joint",
        "told deg, least certain axis",
        "off deg about it, and told with that of the joint fit",
        "NEES per degree of freedom",
    )
    every = []
    for shot, T, C, left in zip(shots, together.poses, together.covariances, together.residuals, strict=True):
        of = shot.pose.covariance[3:, 3:]
        sd, axis = worst(of)
        off = turn(T, shot.pose)
        both = np.degrees(np.sqrt(axis @ (of + C) @ axis))
        every.append(float(off @ np.linalg.solve(of + C, off)) / 3.0)
        said = "yes" if shot.verdict.accepted else "no"
        cells = f"{shot.pose.residual_px:.2f}, {left:.2f} | {sd:.2f} | {abs(np.degrees(off @ axis)):.2f}, {both:.2f}"
        print(f"| {shot.name} | {said} | {cells} | {every[-1]:.2f} |")
    print(f"\nshape of the print: {rms:.3f} mm rms of a corner's coordinate; mean NEES {np.mean(every):.2f}")
    table(
        "Twins",
        "photograph",
        "corners off mm",
        "told deg rms",
        "off deg rms about the axis",
        "NEES",
        "accepted",
    )
    for shot in shots:
        for shape in (rms, rms / 2.0):
            rng = np.random.default_rng([7, round(1e6 * shape)])
            twins = [twin(shot, 1e-3 * shape, camera, rng) for _ in range(options.twins)]
            poses = [v.pose for v in twins if v.pose is not None]
            C = np.array([p.covariance[3:, 3:] for p in poses])
            off = np.array([turn(shot.pose.T_base_board, p) for p in poses])
            sd, axis = worst(C.mean(axis=0))
            nees = np.mean([e @ np.linalg.solve(c, e) / 3.0 for e, c in zip(off, C, strict=True)])
            about = np.degrees(np.sqrt(np.mean((off @ axis) ** 2)))
            share = 100.0 * np.mean([v.accepted for v in twins])
            print(
                f"| {shot.name} | {shape:.3f} | {sd:.2f} | {about:.2f} | {nees:.2f} | {share:.0f} % |",
                flush=True,
            )


if __name__ == "__main__":
    main()
