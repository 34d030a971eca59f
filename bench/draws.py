"""Seeded random worlds of both tasks: boards anywhere in view and in reach, up to 0.15 m high."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from arm.board import PLATE_CENTRE, PLATE_SIZE, POCKET_MOUTH
from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.poses import BoardPose
from arm.robot.model import Robot
from arm.se3 import Array, apply, transform
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.files.task import Task, read_task
from cell.files.world import board_placement
from cell.scene.build import build_scene
from cell.scene.places import hole_stations, reach_of, reachable_places
from plan.cartesian.line import follow_line
from plan.cartesian.reachability import GraspCandidate
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from plan.scene import Station
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import HoleState, Occupancy

MARKER_MARGIN_PX = 3.0  # a marker's black square stays this far inside the image: nearer, a corner leaves it
MARGIN_PX = 6.0  # and cubes in the holes this far
CUBE_TOP = 0.032  # of a cube in its hole above the plate, m
GAP = 0.010  # between plates seen from above, m
LINE_CLEARANCE = 0.005  # that some approach line of every hole keeps from all that stands, m
TILTS_DEG = {"task1": (0.0,), "task2": (0.0, 7.0, 15.0)}
HIGHEST = 0.15  # centre of a plate's top, m
TRIES = 300_000
CUBES = 4  # of task 1, each with a free place on the table in view


@dataclass(frozen=True)
class Drawn:
    """A drawn world as files: the task, and the truth beside it."""

    task: Path
    world: Path
    rejected: int


@dataclass(frozen=True)
class _Placed:
    csv: str
    centre: Array
    yaw_deg: float
    tilt_deg: float
    azimuth_deg: float

    @property
    def T_base_board(self) -> Array:
        return board_placement(self.centre, *np.radians([self.yaw_deg, self.tilt_deg, self.azimuth_deg]))

    def corners(self) -> Array:
        half = np.array(PLATE_SIZE[:2]) / 2
        square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + PLATE_CENTRE
        return apply(self.T_base_board, np.column_stack([square, np.zeros(4)]))


def draw_world(name: str, seed: int, scenes: Path, folder: Path) -> Drawn:
    """Draw until the boards are seen, apart, above the table and every hole is in reach.

    Args:
        name: task1 or task2.
        seed: of the draw.
        scenes: folder of the cell file and boards.
        folder: gets the files.
    """
    cell = read_cell(scenes / "cell.toml")
    rng = np.random.default_rng([seed, 1 if name == "task1" else 2])
    files = sorted((scenes / "boards").glob("*.csv"))
    for attempt in range(TRIES):
        chosen = rng.permutation(len(files))[: 1 if name == "task1" else 2]
        sides = (0.0,) if name == "task1" else rng.permutation([-1.0, 1.0])
        sided = zip(chosen, sides, strict=True)
        placed = [_draw_visible(cell, rng, files[i].name, TILTS_DEG[name], side) for i, side in sided]
        if not _apart(placed):
            continue
        folder.mkdir(parents=True, exist_ok=True)
        drawn = _write(name, seed, scenes, folder, placed, attempt)
        task = read_task(drawn.task)
        seen = _truth(task, placed)
        if (name != "task1" or len(reachable_places(task, seen)) >= CUBES) and _served(task, seen):
            return drawn
    raise RuntimeError(f"{name}, seed {seed}: no feasible world in {TRIES} draws")


def _served(task: Task, seen: Observation) -> bool:
    """Whether every hole has a yaw and branch whose whole approach line is in limits and clear of what stands."""
    table = reach_of(task, seen)
    if not table.ok:
        return False
    cell = task.cell
    robot, limits = cell.robot(), cell.limits
    stations = {station.name: station for station in hole_stations(task, seen)}
    for board in seen.boards:
        for hole in board.pose.holes:
            free: dict[str, HoleState] = {
                h.name: "empty"
                for b in seen.boards
                for h in b.pose.holes
                if h is hole or b.name != task.from_board.name
            }
            scene = build_scene(cell, seen.with_states(free))
            world = World(robot, (*scene.bodies, *scene.cubes))
            if not any(
                _clear(robot, limits, world, stations[hole.name], c, cell.offset)
                for c in table[hole.name].feasible()
            ):
                return False
    return True


def _clear(
    robot: Robot, limits: Limits, world: World, station: Station, choice: GraspCandidate, offset: float
) -> bool:
    T_hole_tool = station.T_base_tool[choice.yaw]
    above = T_hole_tool @ transform(t=(0.0, 0.0, -offset))
    try:
        path = follow_line(robot, choice.q_hole, T_hole_tool, above, limits)
    except ImpossibleError:
        return False
    return certify_curve(world, curve_of_waypoints(path.q), LINE_CLEARANCE).proved


def _draw_visible(
    cell: Cell, rng: np.random.Generator, csv: str, tilts: tuple[float, ...], side: float
) -> _Placed:
    for _ in range(TRIES):
        placed = _draw_board(rng, csv, tilts, side)
        if _visible(cell, placed):
            return placed
    raise RuntimeError(f"no visible place for {csv} in {TRIES} draws")


def _draw_board(rng: np.random.Generator, csv: str, tilts: tuple[float, ...], side: float) -> _Placed:
    """One board anywhere; of two, each in its half of the view and roughly squared to it, or they hardly ever fit."""
    x, y = rng.uniform([0.34, -0.26], [0.64, 0.24])
    yaw_deg = rng.uniform(-180, 180)
    if side:
        y = -0.015 + side * rng.uniform(0.095, 0.135)
        yaw_deg = 90.0 * rng.integers(-2, 2) + rng.uniform(-12, 12)
    return _Placed(
        csv,
        np.round([x, y, rng.uniform(0.03, HIGHEST)], 4),
        float(np.round(yaw_deg, 1)),
        float(rng.choice(tilts)),
        float(np.round(rng.uniform(-180, 180), 1)),
    )


def _visible(cell: Cell, placed: _Placed) -> bool:
    corners = placed.corners()
    if (corners[:, 2] - PLATE_SIZE[2]).min() < cell.table_z + 0.003:
        return False
    board = next(b for b in cell.boards if placed.csv.endswith(f"{b.name}.csv"))
    marked = board.marker_corners().reshape(-1, 3)
    half = POCKET_MOUTH / 2.0
    square = np.array([[i * half, j * half, z] for i in (-1, 1) for j in (-1, 1) for z in (0.0, CUBE_TOP)])
    mouths = (board.holes[:, None] + square).reshape(-1, 3)
    return _within(cell, apply(placed.T_base_board, marked), MARKER_MARGIN_PX) and _within(
        cell, apply(placed.T_base_board, mouths), MARGIN_PX
    )


def _within(cell: Cell, points: Array, margin_px: float) -> bool:
    pixels = cell.camera.project_base(points)
    return bool((pixels > margin_px).all() and (pixels < np.array(cell.camera.size) - 1.0 - margin_px).all())


def _apart(placed: list[_Placed]) -> bool:
    if len(placed) < 2:
        return True
    outlines = []
    for p in placed:
        flat = p.corners()[:, :2]
        centre = flat.mean(axis=0)
        outlines.append((centre + (flat - centre) * (1.0 + GAP / 0.1)).astype(np.float32))
    area, _ = cv2.intersectConvexConvex(*outlines)
    return float(area) <= 0.0


def _truth(task: Task, placed: list[_Placed]) -> Observation:
    boards = []
    for board, p in zip(task.boards, placed, strict=True):
        pose = BoardPose(board, p.T_base_board, np.eye(6) * 1e-9, 0.1, 100.0)
        boards.append(ObservedBoard(pose, (Occupancy("cube"),) * 4))
    return Observation(tuple(boards))


def _write(name: str, seed: int, scenes: Path, folder: Path, placed: list[_Placed], rejected: int) -> Drawn:
    task, world = folder / f"{name}-{seed}.toml", folder / f"{name}-{seed}.world.toml"
    ids = [list(_ids(p.csv)) for p in placed]
    text = (scenes / f"{name}.toml").read_text().replace('"cell.toml"', f'"{scenes / "cell.toml"}"')
    text = text.replace("from_board = [1, 2]", f"from_board = {ids[0]}")
    if name == "task2":
        text = text.replace("to_board = [3, 4]", f"to_board = {ids[1]}")
    else:
        text = text.replace("board_height_mm = 60", f"board_height_mm = {1e3 * placed[0].centre[2]:.1f}")
    task.write_text(text.replace("seed = 0", f"seed = {seed}"))
    lines = [f"seed = {seed}", "noise_grey = 2.0"]
    for index, p in enumerate(placed):
        lines += [
            "[[boards]]",
            f'file = "{scenes / "boards" / p.csv}"',
            f"centre_mm = {[float(v) for v in np.round(1e3 * p.centre, 1)]}",
            f"yaw_deg = {p.yaw_deg}",
            f"tilt_deg = {p.tilt_deg}",
            f"lean_azimuth_deg = {p.azimuth_deg}",
            f"cubes = {[1, 2, 3, 4] if index == 0 else []}",
        ]
    world.write_text("\n".join(lines) + "\n")
    return Drawn(task, world, rejected)


def _ids(csv: str) -> tuple[int, int]:
    low, high = csv.removesuffix(".csv").rsplit("_", 1)[1].split("-")
    return int(low), int(high)
