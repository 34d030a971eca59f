"""A cube that is not seated, in photographs of the simulated cell: beside its hole, on the rim, leaning, too high."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from arm.board import PLATE_CENTRE, PLATE_SIZE, Board, seat_depth
from arm.io.storage import data_file
from arm.se3 import Array, apply, frozen, inverse, moved, rot_x, rot_z, rotation, transform
from cell.files.world import World, read_world
from cell.scene.bodies import T_hole_cube, cube_body, plate_body, stand_body
from cell.sim.camera import TrueCamera
from cell.sim.made import made_board
from cell.sim.release_faults import T_hole_released
from pictures.boards import CUBE, MARKER, TABLE, lab_camera, leaning, twist_between, window
from render.renderer import PlacedBoard
from vision.camera.model import Camera, Image
from vision.loose.rests import Rest, possible
from vision.occupancy.cube_top import EmptyPlace
from vision.occupancy.seated import CubeWidth

KINDS = ("aside", "rim", "half", "high", "table")
TRAPS = ("odd", "gone", "seated")  # at no known rest; no cube; properly seated
WORLDS = {"ideal": "scenes/task2.world.toml", "realistic": "scenes/realistic/task2.world.toml"}
WITHIN = 0.060  # m
PLACE_STD = np.array([1e-4, 1e-4, 3e-4, 2e-3, 2e-3, 5e-4])  # of the given place's twist, m and rad
SEEN = 0.115  # m around the place that is drawn
NEIGHBOURS = 0.5  # probability of a seated cube in each other hole
PHOTOGRAPHS = 3


@dataclass(frozen=True, eq=False)
class LooseScene:
    """Photographs of a loose cube, and what `locate_cube` is told about them.

    Attributes:
        images, camera: as taken; the camera is what is known of it, a part of the whole image.
        T_base_place: measured pose of the hole or place.
        width: what is known of the cube's width.
        pocket: nominal widths of mouth and floor, or None on the table.
        others: poses of seated neighbours.
        empty: the place before.
        T_base_cube: true pose.
    """

    images: list[Image]
    camera: Camera
    T_base_place: Array
    width: CubeWidth
    pocket: tuple[float, float] | None
    others: list[Array]
    empty: EmptyPlace | None
    T_base_cube: Array


@lru_cache
def _world(name: str) -> World:
    return read_world(data_file(WORLDS[name]), MARKER)


def loose_scene(
    seed: int,
    kind: str,
    world_name: str = "realistic",
    exact: bool = False,
    width_std: float = 1.2e-5,
    with_empty: bool = False,
    whole: bool = True,
) -> LooseScene:
    """Draw a scene.

    Args:
        seed: of everything that is drawn.
        kind: one of `KINDS` or `TRAPS`.
        world_name: one of `WORLDS`: errors of image, table, print and boards.
        exact: poses of `cell.sim.release_faults`, without more offset, rotation or tilt.
        width_std: of what is known of the cube's width, m.
        with_empty: whether there are photographs of the empty place.
        whole: whether the cube is wholly in view, and the place at most 40 mm from the image's edge.
    """
    rng = np.random.default_rng([seed, 31])
    world, camera = _world(world_name), lab_camera()
    size = CUBE + (world.made.cube if world.made.cube else 0.0) * float(rng.standard_normal())
    while True:
        nominal = world.boards[int(rng.integers(len(world.boards)))]
        centre = (rng.uniform(0.38, 0.54), rng.uniform(-0.18, 0.14), rng.uniform(0.035, 0.09))
        T_base_board = leaning(centre, rng.uniform(-180, 180), rng.uniform(0.0, 15.0), rng.uniform(-180, 180))
        true = made_board(world, replace(nominal, T_base_board=T_base_board), nominal.board.pocket)
        hole = int(rng.integers(4))
        T_base_hole = T_base_board @ nominal.board.T_board_hole(hole)
        neighbours = [i for i in range(4) if i != hole and rng.random() < NEIGHBOURS]
        seated = [
            T_base_board @ true.board.T_board_hole(i) @ T_hole_cube(CUBE, seat_depth(CUBE, true.board.pocket))
            for i in neighbours
        ]
        if kind == "table":
            T_base_place = transform(
                rot_z(rng.uniform(-np.pi, np.pi)), (rng.uniform(0.36, 0.56), rng.uniform(-0.2, 0.16), 0.0)
            )
            T_place_cube = _flat(rng, size, 0.045, np.pi)
            if _under_board(T_base_place @ T_place_cube, T_base_board):
                continue
        else:
            T_base_place = T_base_board @ true.board.T_board_hole(hole)
            T_place_cube = _on_board(rng, kind, size, true.board, hole, exact)
        T_base_cube = T_base_place @ T_place_cube
        if whole and not _wholly_seen(camera, T_base_cube, size, T_base_place):
            continue
        if any(np.linalg.norm(T_base_cube[:3, 3] - other[:3, 3]) < 1.5 * size for other in seated):
            continue
        break
    T_measured = moved(T_base_hole if kind != "table" else T_base_place, PLACE_STD * rng.standard_normal(6))
    part = _part(camera, T_base_place)
    bodies = [TABLE, plate_body(true.board.name, T_base_board)]
    stand = stand_body(true.board.name, T_base_board, (0.16, 0.12), 0.0)
    bodies += [] if stand is None else [stand]
    bodies += [cube_body(f"seated {i}", CUBE, T) for i, T in zip(neighbours, seated, strict=True)]
    placed = [PlacedBoard(true.board, T_base_board, true.prints)]

    def taken(cube: bool, number: int) -> list[Image]:
        true_camera = TrueCamera(
            part, replace(world, seed=1000 * seed + number, image=replace(world.image, drift=0.0))
        )
        there = [cube_body("cube", size, T_base_cube)] if cube else []
        return true_camera.images(PHOTOGRAPHS, 0, [*bodies, *there], placed, "DICT_4X4_50", [])

    empty = EmptyPlace(taken(False, 2), part, T_measured) if with_empty else None
    width = CubeWidth(size + width_std * float(rng.standard_normal()), width_std)
    pocket = None if kind == "table" else nominal.board.pocket
    return LooseScene(
        taken(kind != "gone", 1), part, frozen(T_measured), width, pocket, seated, empty, frozen(T_base_cube)
    )


def error_of(T_base_found: Array, T_base_true: Array) -> Array:
    """The twist (6,) from a found cube to the true one, which looks the same after quarter turns about its normal."""
    quarters = (transform(rot_z(k * np.pi / 2.0)) for k in range(4))
    twists = [twist_between(T_base_found, T_base_true @ quarter) for quarter in quarters]
    return min(twists, key=lambda twist: float(np.linalg.norm(twist[3:])))


def _flat(rng: np.random.Generator, size: float, far: float, turn: float) -> Array:
    """A cube on a plane, up to `far` m from the place, rotated by up to `turn` rad."""
    angle, distance = rng.uniform(-np.pi, np.pi), far * np.sqrt(rng.random())
    at = (distance * np.cos(angle), distance * np.sin(angle), size / 2.0)
    return transform(rot_z(rng.uniform(-turn, turn)), at)


def _on_board(
    rng: np.random.Generator, kind: str, size: float, board: Board, hole: int, exact: bool
) -> Array:
    """T_hole_cube of a cube on a plate or in a pocket."""
    quarter = transform(rot_z(int(rng.integers(4)) * np.pi / 2.0))
    depth = seat_depth(size, board.pocket)
    if exact:
        released = T_hole_released(kind, size, depth)
        return released if kind == "aside" else quarter @ released
    while kind in ("aside", "rim"):
        T = _flat(rng, size, 0.045, np.pi) if kind == "aside" else _flat(rng, size, 0.012, np.pi)
        R, t = T[:2, :2], T[:2, 3]
        corners = (size / 2.0) * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) @ R.T + t
        on_plate = np.abs(corners + board.holes[hole, :2] - PLATE_CENTRE) < np.array(PLATE_SIZE[:2]) / 2.0
        stable = all(
            possible(
                Rest("flat"),
                transform(t=-(h - board.holes[hole])) @ T,
                size,
                (board.pocket[0] + 1e-3, board.pocket[1]),
            )
            for h in board.holes
        )
        if on_plate.all() and stable:
            return T
    if kind == "odd":
        azimuth, tilt = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(4.0, 20.0))
        R = rotation(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])) @ rot_z(
            rng.uniform(-np.pi, np.pi)
        )
        lowest = float(np.abs(R[2]).sum() * size / 2.0)
        return transform(R, (*rng.uniform(-0.015, 0.015, 2), lowest - rng.uniform(0.0, 6e-3)))
    if kind in ("seated", "gone"):
        return T_hole_cube(size, depth)
    play = 0.3e-3 * rng.standard_normal(3)
    yaw = rng.uniform(-np.radians(1.5), np.radians(1.5))
    if kind == "high":
        lift = rng.uniform(1e-3, 4e-3)
        aside = 0.2 * lift * rng.uniform(-1.0, 1.0, 2)
        return transform(rot_z(yaw), (*aside, size / 2.0 - depth + lift))
    edge = transform(t=(0.0, size / 2.0, -depth))
    tilt = np.radians(rng.uniform(6.0, 10.0))
    half = edge @ transform(rot_x(-tilt)) @ transform(t=(0.0, -size / 2.0, size / 2.0))
    return quarter @ transform(rot_z(yaw), play) @ half


def _under_board(T_base_cube: Array, T_base_board: Array) -> bool:
    at = apply(inverse(T_base_board), T_base_cube[:3, 3])
    return bool((np.abs(at[:2] - PLATE_CENTRE) < np.array(PLATE_SIZE[:2]) / 2.0 + 0.045).all())


def _wholly_seen(camera: Camera, T_base_cube: Array, size: float, T_base_place: Array) -> bool:
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    pixels = camera.project_base(apply(T_base_cube, signs * (size / 2.0 + 2e-3)))
    inside = bool(((pixels > 2.0) & (pixels < np.array(camera.size) - 3.0)).all())
    angles = np.linspace(0.0, 2.0 * np.pi, 72)
    around = np.stack([0.06 * np.cos(angles), 0.06 * np.sin(angles), 0.0 * angles], axis=-1)
    ring = camera.project_base(apply(T_base_place, around))
    seen = ((ring > 0.0) & (ring < np.array(camera.size))).all(axis=1)
    return inside and bool(seen.mean() >= 0.5)


def _part(camera: Camera, T_base_place: Array) -> Camera:
    """The part of the image within `SEEN` of a place, and what stands there."""
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (0.0, 0.45)])
    pixels = camera.project_base(apply(T_base_place, SEEN * signs))
    low = np.maximum(np.floor(pixels.min(axis=0)), 0.0)
    high = np.minimum(np.ceil(pixels.max(axis=0)), np.array(camera.size))
    return window(camera, low, (int(high[0] - low[0]), int(high[1] - low[1])))
