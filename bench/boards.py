"""Board poses from marker corners: errors against the Cramer-Rao bound, honesty, flips, and what is caught.

python bench/boards.py --scenes 4000

Corners are drawn, not rendered: a board of the lab with 36 or 40 mm markers before the lab's camera, about 1.1 m away,
tilted 0, 7 or 15 degrees (+- 0.3) towards anywhere, five photographs with 0.3 px of noise a coordinate unless a row
says otherwise. Errors are root mean squares of the four holes (mm) and of the board's turn (deg) over all scenes; each
is divided by its bound over the same scenes (noise that all photographs share is in the bound).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from arm.board import Board
from arm.poses import hole_poses
from arm.se3 import Array, frozen, rotation, rotation_vector, transform
from board_scenes import lab_board, lab_camera, random_pose, seen_corners, twist_between
from vision.board_fit import Corners, fit_weighted, planar_poses, pose_jacobian
from vision.board_pose import assess_board
from vision.camera import Camera
from vision.markers import Marker

TILTS_DEG = (0.0, 7.0, 15.0)
FRAMES, NOISE_PX, BAD_PX = 5, 0.3, 8.0
FLIP, WRONG_MM, WRONG_DEG = np.radians(2.0), 2.0, 2.0
CHUNK = 50

Frames = list[list[Marker]]
Way = Callable[[Board, Frames, Camera], Array]


@dataclass(frozen=True)
class Conditions:
    """How the corners of a row are drawn.

    Attributes:
        noise_px, common_px: of each photograph, and shared by all of a scene.
        bad: part of the photographs with one corner 8 px off.
        sizes: of the markers, m, in turn.
        tilts_deg: in turn.
        frames: photographs.
    """

    noise_px: float = NOISE_PX
    common_px: float = 0.0
    bad: float = 0.0
    sizes: tuple[float, ...] = (0.036, 0.040)
    tilts_deg: tuple[float, ...] = TILTS_DEG
    frames: int = FRAMES


@dataclass(frozen=True)
class Scene:
    """One board, where it truly is, and what was seen of it."""

    board: Board
    T_base_board: Array
    frames: Frames


def drawn(seed: int, of: Conditions) -> Scene:
    """The scene of a seed."""
    rng = np.random.default_rng([seed, 5])
    board = lab_board(marker_size=of.sizes[seed % len(of.sizes)])
    tilt = of.tilts_deg[(seed // len(of.sizes)) % len(of.tilts_deg)] + rng.uniform(-0.3, 0.3)
    T = random_pose(rng, abs(tilt))
    frames = seen_corners(board, T, lab_camera(), rng, of.frames, of.noise_px, of.common_px)
    return Scene(board, T, [_spoiled(f, rng) if rng.random() < of.bad else f for f in frames])


def _spoiled(frame: list[Marker], rng: np.random.Generator) -> list[Marker]:
    marker, corner, angle = int(rng.integers(2)), int(rng.integers(4)), rng.uniform(0.0, 2.0 * np.pi)
    corners = frame[marker].corners_px.copy()
    corners[corner] += BAD_PX * np.array([np.cos(angle), np.sin(angle)])
    return [replace(m, corners_px=frozen(corners)) if i == marker else m for i, m in enumerate(frame)]


def bound(scene: Scene, of: Conditions, camera: Camera) -> Array:
    """Cramer-Rao bound of the twist, (6, 6): every corner of every photograph, the shared noise once."""
    points = scene.board.marker_corners().reshape(8, 3)
    J = pose_jacobian(camera.T_camera_base @ scene.T_base_board, points, camera).reshape(-1, 6)
    return np.asarray((of.noise_px**2 / of.frames + of.common_px**2) * np.linalg.inv(J.T @ J))


# -- the ways of the first seed's lessons, and ours


def one_marker(board: Board, frames: Frames, camera: Camera) -> list[Array]:
    """The better planar pose of the first marker in each photograph, T_camera_board."""
    points = board.marker_corners()[0]
    seen = (next(m for m in frame if m.id == board.marker_ids[0]) for frame in frames)
    return [planar_poses(marker.corners_px, points, camera)[0] for marker in seen]


def single(board: Board, frames: Frames, camera: Camera) -> Array:
    """One marker, one photograph."""
    return one_marker(board, frames[:1], camera)[0]


def vector_median(board: Board, frames: Frames, camera: Camera) -> Array:
    """One marker, median of translations and of rotation vectors: the first seed's first try."""
    poses = one_marker(board, frames, camera)
    vectors = np.median([rotation_vector(T[:3, :3]) for T in poses], axis=0)
    return transform(rotation(vectors), np.median([T[:3, 3] for T in poses], axis=0))


def element_median(board: Board, frames: Frames, camera: Camera) -> Array:
    """One marker, median of every element of the matrix, made a rotation again."""
    middle = np.median(one_marker(board, frames, camera), axis=0)
    U, _, V = np.linalg.svd(middle[:3, :3])
    return transform(U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V, middle[:3, 3])


def corner_median(board: Board, frames: Frames, camera: Camera) -> Array:
    """Both markers, median of every corner, then one pose: the first seed's final recipe."""
    corners = np.median([[m.corners_px for m in frame] for frame in frames], axis=0).reshape(1, 8, 2)
    points = board.marker_corners().reshape(8, 3)
    start = planar_poses(corners[0], points, camera)[0]
    return fit_weighted(Corners(corners, points), np.ones((1, 8)), start, camera).T_camera_board


def joint(board: Board, frames: Frames, camera: Camera) -> Array:
    """All corners of all photographs in one robust estimate: `vision.board_pose`."""
    seen = assess_board(board, frames, camera)
    return np.full((4, 4), np.nan) if seen.pose is None else camera.T_camera_base @ seen.pose.T_base_board


WAYS: dict[str, Way] = {
    "one marker, one photograph": single,
    "one marker, rotation-vector median": vector_median,
    "one marker, element median": element_median,
    "two markers, corner median": corner_median,
    "two markers, joint (ours)": joint,
}


@dataclass(frozen=True)
class Error:
    """Of one scene: squares of the holes' mean error (m^2) and of the turn (rad^2), and their bounds."""

    hole: float
    turn: float
    hole_bound: float
    turn_bound: float


def error_of(T_camera_board: Array, scene: Scene, of: Conditions, camera: Camera) -> Error:
    """How far a pose is from the truth."""
    T = camera.T_base_camera @ T_camera_board
    holes = np.concatenate([scene.board.holes, np.ones((4, 1))], axis=1)
    off = (holes @ (T - scene.T_base_board).T)[:, :3]
    turn = float(np.linalg.norm(rotation_vector(T[:3, :3].T @ scene.T_base_board[:3, :3])))
    C = bound(scene, of, camera)
    spread = np.mean([np.trace(J @ C @ J.T) for J in map(_lever, scene.board.holes)])
    return Error(float((off**2).sum(axis=1).mean()), turn**2, float(spread), float(np.trace(C[3:, 3:])))


def _lever(point: Array) -> Array:
    x, y, z = point
    return np.concatenate([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]], axis=1)


def compared(seeds: range, of: Conditions, way: str) -> list[Error]:
    """Errors of one way over scenes."""
    camera = lab_camera()
    scenes = [drawn(seed, of) for seed in seeds]
    return [error_of(WAYS[way](s.board, s.frames, camera), s, of, camera) for s in scenes]


@dataclass(frozen=True)
class Judged:
    """What the estimate said of itself in one scene, and what is true.

    Attributes:
        nees: squared error of the twist in its own covariance, per degree of freedom.
        predicted, actual: variance of the holes, and their squared error, m^2.
        accepted: whether the pose may be used.
        wrong: whether it is more than 2 mm or 2 deg off.
        flipped: whether the turn is more than 2 deg off.
        told: the first doubt.
    """

    nees: float
    predicted: float
    actual: float
    accepted: bool
    wrong: bool
    flipped: bool
    told: str


def judged(seeds: range, of: Conditions, spoil: str = "") -> list[Judged]:
    """Assess scenes; `spoil` is what is wrong with them."""
    camera, found = lab_camera(), []
    for seed in seeds:
        scene = drawn(seed, of)
        board, frames = SPOILS[spoil](scene, np.random.default_rng([seed, 7]))
        seen = assess_board(board, frames, camera)
        told = str(seen.doubts[0]) if seen.doubts else ""
        if seen.pose is None:
            found.append(Judged(np.nan, np.nan, np.nan, False, True, True, told))
            continue
        e = error_of(camera.T_camera_base @ seen.pose.T_base_board, scene, of, camera)
        twist = twist_between(seen.pose.T_base_board, scene.T_base_board)
        predicted = float(np.mean([np.trace(h.covariance[:3, :3]) for h in hole_poses(seen.pose)]))
        wrong = e.hole > (WRONG_MM / 1e3) ** 2 or e.turn > np.radians(WRONG_DEG) ** 2
        nees = float(twist @ np.linalg.solve(seen.pose.covariance, twist)) / 6.0
        found.append(Judged(nees, predicted, e.hole, seen.accepted, wrong, e.turn > FLIP**2, told))
    return found


def _as_it_is(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    return scene.board, scene.frames


def _other_size(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    return replace(
        scene.board, marker_size=scene.board.marker_size + float(rng.choice((-1e-3, 1e-3)))
    ), scene.frames


def _swapped(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    low, high = scene.board.marker_ids
    return scene.board, [[replace(m, id=high if m.id == low else low) for m in f] for f in scene.frames]


def _turned(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    which, turns = int(rng.choice(scene.board.marker_ids)), int(rng.integers(1, 4))
    return scene.board, [
        [
            replace(m, corners_px=frozen(np.roll(m.corners_px, turns, axis=0))) if m.id == which else m
            for m in f
        ]
        for f in scene.frames
    ]


def _elsewhere(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    """The second marker stands 5 to 40 mm from its place: it is another board's."""
    camera, angle, far = lab_camera(), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.005, 0.04)
    shift = far * np.array([np.cos(angle), np.sin(angle), 0.0])
    T = scene.T_base_board
    there = [
        camera.project_base((c + s) @ T[:3, :3].T + T[:3, 3])
        for c, s in zip(scene.board.marker_corners(), (0.0 * shift, shift), strict=True)
    ]
    here = [camera.project_base(c @ T[:3, :3].T + T[:3, 3]) for c in scene.board.marker_corners()]
    return scene.board, [
        [replace(m, corners_px=frozen(m.corners_px + b - a)) for m, a, b in zip(f, here, there, strict=True)]
        for f in scene.frames
    ]


def _moved(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    """The board moves 1 to 5 mm between two of the photographs."""
    camera, T = lab_camera(), np.array(scene.T_base_board)
    T[:3, 3] += rng.uniform(0.001, 0.005) * _unit(rng.normal(size=3) * (1.0, 1.0, 0.0))
    late = int(rng.integers(1, len(scene.frames)))
    here = [
        camera.project_base(c @ scene.T_base_board[:3, :3].T + scene.T_base_board[:3, 3])
        for c in scene.board.marker_corners()
    ]
    there = [camera.project_base(c @ T[:3, :3].T + T[:3, 3]) for c in scene.board.marker_corners()]
    return scene.board, [
        f
        if i < late
        else [
            replace(m, corners_px=frozen(m.corners_px + b - a))
            for m, a, b in zip(f, here, there, strict=True)
        ]
        for i, f in enumerate(scene.frames)
    ]


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


SPOILS: dict[str, Callable[[Scene, np.random.Generator], tuple[Board, Frames]]] = {
    "": _as_it_is,
    "marker size 1 mm wrong": _other_size,
    "markers swapped": _swapped,
    "one marker turned by 90, 180 or 270 deg": _turned,
    "second marker 5 to 40 mm from its place": _elsewhere,
    "moves 1 to 5 mm between photographs": _moved,
}


def pooled(errors: Sequence[Error]) -> str:
    """One row: holes mm, p95, deg, times the bounds, more than 2 deg."""
    hole, turn, hole_bound, turn_bound = (
        np.array([getattr(e, n) for e in errors]) for n in Error.__annotations__
    )
    return (
        f"{1e3 * np.sqrt(hole.mean()):.3f} | {1e3 * np.percentile(np.sqrt(hole), 95):.2f} | "
        f"{np.degrees(np.sqrt(turn.mean())):.3f} | {np.sqrt(hole.mean() / hole_bound.mean()):.3f} | "
        f"{np.sqrt(turn.mean() / turn_bound.mean()):.3f} | {100 * np.mean(turn > FLIP**2):.2f}"
    )


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=4000)
    parser.add_argument("--spoilt", type=int, default=400, help="scenes of each thing that is wrong")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    began = time.monotonic()
    print(
        f"Python {platform.python_version()}, numpy {np.__version__}, {os.cpu_count()} processors, load "
        f"{os.getloadavg()[0]:.1f}; {options.scenes} scenes a row, {FRAMES} photographs, {NOISE_PX} px",
        flush=True,
    )
    out: dict[str, object] = {}
    with ProcessPoolExecutor(options.jobs) as pool:

        def over(count: int, work: Callable[..., list[object]], *rest: object) -> list[object]:
            seeds = [range(i, min(i + CHUNK, count)) for i in range(0, count, CHUNK)]
            return [e for part in pool.map(partial(work), seeds, *map(repeat, rest)) for e in part]

        print("\n| way | holes mm rms | p95 | turn deg rms | x bound, holes | x bound, turn | > 2 deg, % |")
        print("|---|---|---|---|---|---|---|")
        plain = Conditions()
        for way in WAYS:
            errors = over(options.scenes, compared, plain, way)
            print(f"| {way} | {pooled(errors)} |", flush=True)
        for name, of in {
            "ours, a bad corner in 20 % of photographs": Conditions(bad=0.2),
            "ours, 1 px": Conditions(noise_px=1.0),
            "ours, 0.3 px shared by all photographs": Conditions(common_px=0.3),
            "ours, 20 mm markers": Conditions(sizes=(0.020,)),
            "ours, one photograph": Conditions(frames=1),
        }.items():
            print(
                f"| {name} | {pooled(over(options.scenes, compared, of, 'two markers, joint (ours)'))} |",
                flush=True,
            )

        print(
            "\n| what it says of itself | n | predicted / actual std | NEES per dof | accepted % | wrong but accepted |"
        )
        print("|---|---|---|---|---|---|")
        for name, of in {
            "as above": plain,
            "0.3 px shared": Conditions(common_px=0.3),
            "a bad corner in 20 %": Conditions(bad=0.2),
            "36 to 40 mm, 4 to 15 deg: flips": Conditions(
                sizes=(0.036, 0.038, 0.040), tilts_deg=(4.3, 7.0, 11.0, 14.7)
            ),
        }.items():
            found = over(options.scenes, judged, of)
            out[name] = [asdict(j) for j in found]
            honest = np.sqrt(np.mean([j.predicted for j in found]) / np.mean([j.actual for j in found]))
            nees, accepted = np.mean([j.nees for j in found]), 100 * np.mean([j.accepted for j in found])
            print(
                f"| {name} | {len(found)} | {honest:.3f} | {nees:.2f} | {accepted:.2f} | "
                f"{sum(j.wrong and j.accepted for j in found)}; flipped {sum(j.flipped for j in found)} |",
                flush=True,
            )
        print("\n| what is wrong | n | refused | told as |")
        print("|---|---|---|---|")
        for name in list(SPOILS)[1:]:
            found = over(options.spoilt, judged, plain, name)
            words = [" ".join(j.told.split()[2:8]) for j in found if not j.accepted]
            most = max(set(words), key=words.count) if words else "-"
            print(f"| {name} | {len(found)} | {sum(not j.accepted for j in found)} | {most} |", flush=True)
    print(f"{time.monotonic() - began:.0f} s")
    if options.json:
        options.json.write_text(json.dumps(out) + "\n")


if __name__ == "__main__":
    main()
