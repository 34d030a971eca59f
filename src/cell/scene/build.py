"""Build the planner's scene and stations from an observation.

In a grip the tool's z axis points into the plate, and the jaws move along its y axis. A cube has four grip yaws.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, plate_name
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.poses import BoardPose, HolePose
from arm.robot.shapes import Body
from arm.se3 import Array, apply, frozen, inverse, rot_x, rot_z, transform
from cell.config.cell import Cell
from cell.files.task import Task
from cell.scene.bodies import T_hole_cube, cube_body, plate_body, stand_body
from plan.scene import Pair, Scene, Station
from vision.observation import Observation

_STAND_SHARE = 1.5  # least padding of a stand, relative to that of its plate, see `board_bodies`
RELEASE_GAP = 1e-3  # a cube is released this far above its seat, m


def cube_name(place: str) -> str:
    """Name of the cube at a hole or place."""
    return f"cube {place}"


def grips_over(T_base_place: Array, height: float) -> tuple[Array, ...]:
    """The four tool poses over a place, finger tips `height` m above it."""
    turned = (mul(rot_x(np.pi), rot_z(k * np.pi / 2.0)) for k in range(4))
    return tuple(frozen(mul(T_base_place, transform(R, (0.0, 0.0, height)))) for R in turned)


def hole_station(cell: Cell, hole: HolePose, gap: float = 0.0) -> Station:
    """A hole as a station, finger tips at grip height, plus `gap` m for release."""
    grips = grips_over(hole.T_base_hole, cell.grip_height + gap)
    return Station(hole.name, grips, frozenset((plate_name(hole.board),)))


def table_station(task: Task, place: str) -> Station:
    """A place on the table as a station; the cube is released with its bottom just above the table.

    Raises:
        ImpossibleError: the task has no such place.
    """
    grip_above_bottom = task.cell.grip_height + CUBE_SEAT_DEPTH
    grips = grips_over(T_base_on_table(task, place), grip_above_bottom + RELEASE_GAP)
    return Station(place, grips, frozenset(("table",)))


def T_base_on_table(task: Task, place: str, height: float = 0.0) -> Array:
    """Pose of a place on the table, such as ``table/1``, or of the point `height` m above it.

    Raises:
        ImpossibleError: the task has no such place.
    """
    number = int(place.rsplit("/", 1)[1])
    if task.places is None or number > len(task.places.centres):
        raise ImpossibleError(f"place {place!r} is not one of the task's", place=place)
    x, y = task.places.centres[number - 1]
    return transform(rot_z(task.places.yaw), (x, y, task.cell.table_z + height))


def T_base_cube_on_table(task: Task, place: str) -> Array:
    """Pose of a cube on a place on the table; see `T_base_on_table`."""
    return T_base_on_table(task, place, task.cell.cube_size / 2.0)


def second_look_before(cell: Cell) -> float:
    """Length of the approach that is left where the arm rests for a second look, m."""
    return CUBE_SEAT_DEPTH - RELEASE_GAP + cell.second_look_height


def board_bodies(cell: Cell, poses: Iterable[BoardPose]) -> list[Body]:
    """Plates and stands of the observed boards, padded by the distance t that a board may move unnoticed: `Cell.moved`.

    No point of a plate moves further than t unnoticed (`cell.files.board_shift`). A stand is a box below the plate,
    with the same yaw, whose edges are at most k times those of the plate. Let the plate's centre shift by c, and two
    opposite corners by c + d and c - d. Both are at most t long, so |c|^2 + |d|^2 <= t^2. A corner of the stand shifts
    by at most |c| + k |d| <= sqrt(1 + k^2) t: its displacement is c and a combination of the d of two corners of the
    plate, with weights whose sizes add up to k.
    """
    bodies = []
    for pose in poses:
        plate = plate_body(pose.board.name, pose.T_base_board, pose.board.plate)
        bodies.append(replace(plate, padding=cell.moved))
        larger = max(a / b for a, b in zip(cell.stand_size, pose.board.plate.size[:2], strict=True))
        share = max(_STAND_SHARE, math.sqrt(1.0 + larger**2))
        stand = stand_body(
            pose.board.name,
            pose.T_base_board,
            cell.stand_size,
            cell.table_z,
            share * cell.moved,
            pose.board.plate,
        )
        bodies += [stand] if stand else []
    return bodies


def padded_cube(cell: Cell, name: str, T_base_cube: Array) -> Body:
    """A cube on a board, or gripped there, padded by the distance that its board may move unnoticed."""
    return replace(cube_body(name, cell.cube_size, T_base_cube), padding=cell.moved)


def build_scene(
    cell: Cell, observation: Observation, cubes_on_table: Mapping[str, Array] | None = None
) -> Scene:
    """The planner's scene, with a cube in every hole that is not certainly empty.

    Args:
        cell: the cell.
        observation: boards and the occupancy of their holes.
        cubes_on_table: pose of the centre of each cube set down before, by its name; observations do not contain them.
    """
    cubes: list[Body] = []
    allowed: set[Pair] = set()
    for board in observation.boards:
        for hole in board.holes("cube", "unsure"):
            name = cube_name(hole.name)
            T_base_cube = mul(hole.T_base_hole, T_hole_cube(cell.cube_size))
            cubes.append(padded_cube(cell, name, T_base_cube))
            allowed.add(frozenset((name, plate_name(board.name))))
    for name, T_base_cube in (cubes_on_table or {}).items():
        cubes.append(padded_cube(cell, name, T_base_cube))
        allowed.add(frozenset((name, "table")))
    return Scene(
        robot_open=cell.robot(),
        robot_holding=cell.robot_holding(),
        bodies=(*cell.fixed, *board_bodies(cell, observation.poses)),
        cubes=tuple(cubes),
        allowed=frozenset(allowed),
    )


def unseen_scene(cell: Cell) -> Scene:
    """The scene before any look: the whole zone for boards counts as occupied."""
    return Scene(cell.robot(), cell.robot_holding(), (*cell.fixed, cell.zone), ())


def free_table_stations(task: Task, poses: Iterable[BoardPose]) -> list[Station]:
    """The task's places on the table that no board covers, in order of preference."""
    covered = covering_boards(task, poses)
    return [table_station(task, f"table/{n}") for n, board in enumerate(covered, start=1) if board is None]


def covering_boards(task: Task, poses: Iterable[BoardPose]) -> list[str | None]:
    """For each of the task's places on the table the board that covers it or is too near to it, or None."""
    if task.places is None:
        return []
    cell = task.cell
    reach = cell.gripper.opening / 2.0 + 0.025  # half an open gripper, m
    plates = [(p.board.name, plate_body(p.board.name, p.T_base_board, p.board.plate)) for p in poses]
    return [
        next((name for name, plate in plates if _covers(plate, x, y, reach)), None)
        for x, y in task.places.centres
    ]


def _covers(plate: Body, x: float, y: float, margin: float) -> bool:
    local = apply(inverse(plate.T_base_body), (x, y, plate.T_base_body[2, 3]))
    half = np.array(plate.shape.size[:2]) / 2.0  # type: ignore[union-attr]
    return bool(np.all(np.abs(local[:2]) < half + margin))
