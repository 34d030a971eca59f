"""What may be wrong with a scene: the board's file, its markers, or the cell that did not stand still."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from arm.board import Board
from arm.se3 import Array, frozen
from boards_bench.scenes import Frames, Scene
from pictures.boards import lab_camera


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


def _hidden_corner(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    """One corner is 2 to 10 px off in all photographs."""
    marker, corner, angle = int(rng.integers(2)), int(rng.integers(4)), rng.uniform(0.0, 2.0 * np.pi)
    off = np.zeros((2, 4, 2))
    off[marker, corner] = rng.uniform(2.0, 10.0) * np.array([np.cos(angle), np.sin(angle)])
    return scene.board, _shifted(scene, off)


def _hidden_side(scene: Scene, rng: np.random.Generator) -> tuple[Board, Frames]:
    """One side of a marker is 1 to 6 px off in all photographs, towards or away from the opposite side."""
    marker, side = int(rng.integers(2)), int(rng.integers(4))
    corners = scene.frames[0][marker].corners_px
    ends = [side, (side + 1) % 4]
    towards = _unit(corners[(side + 2) % 4] - corners[ends[1]])
    off = np.zeros((2, 4, 2))
    off[marker, ends] = rng.uniform(1.0, 6.0) * rng.choice((-1.0, 1.0)) * towards
    return scene.board, _shifted(scene, off)


def _shifted(scene: Scene, off: Array) -> Frames:
    return [
        [replace(m, corners_px=frozen(m.corners_px + o)) for m, o in zip(frame, off, strict=True)]
        for frame in scene.frames
    ]


SPOILS: dict[str, Callable[[Scene, np.random.Generator], tuple[Board, Frames]]] = {
    "": _as_it_is,
    "marker size 1 mm wrong": _other_size,
    "markers swapped": _swapped,
    "one marker turned by 90, 180 or 270 deg": _turned,
    "second marker 5 to 40 mm from its place": _elsewhere,
    "moves 1 to 5 mm between photographs": _moved,
    "a corner hidden, 2 to 10 px off in all": _hidden_corner,
    "a side hidden, 1 to 6 px off in all": _hidden_side,
}
