"""Build the planner's scene and the transfers from a look.

Grip frames: the tool's z points into the plate, its jaws move along y; a cube can be gripped at four yaws.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, plate_name
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.poses import BoardPose
from arm.robot.shapes import Body
from arm.se3 import Array, apply, frozen, inverse, rot_x, rot_z, transform
from cell.config.cell import Cell
from cell.files.task import Task
from cell.scene.bodies import T_hole_cube, cube_body, plate_body, stand_body
from plan.scene import Pair, Scene, Station, Transfer

CLEAR = "clear the target board, or give the task file more places"
STAND_SHARE = 1.5  # a stand moves at most this many times as far as its plate
RELEASE_GAP = 1e-3  # a cube is released this far above its seat, m


def cube_name(place: str) -> str:
    """Name of the cube at a hole or place."""
    return f"cube {place}"


def T_place_tool(height: float) -> tuple[Array, ...]:
    """The four tool poses over a place, finger tips `height` m above it."""
    return tuple(transform(mul(rot_x(np.pi), rot_z(k * np.pi / 2.0)), (0.0, 0.0, height)) for k in range(4))


def hole_station(cell: Cell, board: str, name: str, T_base_hole: Array, gap: float = 0.0) -> Station:
    """A hole as a station, finger tips at grip height, plus `gap` m for release."""
    return Station(
        name,
        tuple(frozen(mul(T_base_hole, T)) for T in T_place_tool(cell.grip_height + gap)),
        frozenset((plate_name(board),)),
    )


def table_station(cell: Cell, name: str, x: float, y: float, yaw: float) -> Station:
    """A place on the table as a station; the cube is released with its bottom just above the table."""
    grip_above_bottom = cell.grip_height + CUBE_SEAT_DEPTH
    T_base_place = transform(rot_z(yaw), (x, y, cell.table_z))
    return Station(
        name,
        tuple(frozen(mul(T_base_place, T)) for T in T_place_tool(grip_above_bottom + RELEASE_GAP)),
        frozenset(("table",)),
    )


def T_base_cube_on_table(task: Task, name: str) -> Array:
    """Pose of a cube on the table place of that name.

    Raises:
        ImpossibleError: the task has no such place.
    """
    number = int(name.rsplit("/", 1)[1])
    if task.places is None or number > len(task.places.centres):
        raise ImpossibleError(f"place {name!r} is not one of the task's", place=name)
    x, y = task.places.centres[number - 1]
    height = task.cell.table_z + task.cell.cube_size / 2.0
    return transform(rot_z(task.places.yaw), (x, y, height))


def board_bodies(cell: Cell, poses: Iterable[BoardPose]) -> list[Body]:
    """Plates and stands of the boards seen, padded by the distance a board may move unnoticed (`Cell.moved`).

    No point of a plate moves further than that unnoticed (`cell.files.board_shift`). A stand is a box below
    the plate with the same yaw. Let the plate's centre shift by c, and opposite corners by c + d and
    c - d. Neither is longer than the tolerance t, so |c|^2 + |d|^2 <= t^2, and a corner of the stand shifts
    by no more than |c| + |d| <= sqrt(2) t.
    """
    bodies = []
    for pose in poses:
        plate = plate_body(pose.board.name, pose.T_base_board)
        bodies.append(replace(plate, padding=cell.moved))
        stand = stand_body(
            pose.board.name, pose.T_base_board, cell.stand_size, cell.table_z, STAND_SHARE * cell.moved
        )
        bodies += [stand] if stand else []
    return bodies


def padded_cube(cell: Cell, name: str, T_base_cube: Array) -> Body:
    """A cube on a board, or gripped there, padded by the distance its board may move unnoticed."""
    return replace(cube_body(name, cell.cube_size, T_base_cube), padding=cell.moved)


def build_scene(
    cell: Cell,
    poses: Iterable[BoardPose],
    cubes_in: Mapping[str, Iterable[int]],
    cubes_on_table: Mapping[str, Array] | None = None,
) -> Scene:
    """The planner's scene.

    Args:
        cell: the cell.
        poses: of the boards seen.
        cubes_in: holes (0 to 3) that hold a cube, by board name.
        cubes_on_table: pose of the centre of cubes set down before, by name.
    """
    poses = tuple(poses)
    cubes: list[Body] = []
    allowed: set[Pair] = set()
    for pose in poses:
        for hole in pose.holes:
            if hole.index in set(cubes_in.get(pose.board.name, ())):
                name = cube_name(hole.name)
                T_base_cube = mul(hole.T_base_hole, T_hole_cube(cell.cube_size))
                cubes.append(padded_cube(cell, name, T_base_cube))
                allowed.add(frozenset((name, plate_name(pose.board.name))))
    for name, T_base_cube in (cubes_on_table or {}).items():
        cubes.append(padded_cube(cell, name, T_base_cube))
        allowed.add(frozenset((name, "table")))
    return Scene(
        robot_open=cell.robot(),
        robot_holding=cell.robot(cell.cube_size),
        bodies=(*cell.fixed, *board_bodies(cell, poses)),
        cubes=tuple(cubes),
        allowed=frozenset(allowed),
    )


def unseen_scene(cell: Cell) -> Scene:
    """The scene before any look: the whole zone for boards counts as occupied."""
    return Scene(cell.robot(), cell.robot(cell.cube_size), (*cell.fixed, cell.zone), ())


@dataclass(frozen=True)
class Work:
    """The transfers of a task.

    Attributes:
        transfers: one per cube, in the order of the holes, to the first free places.
        spare: the remaining free places.
    """

    transfers: tuple[Transfer, ...]
    spare: tuple[Station, ...]


def work(
    task: Task,
    poses: Iterable[BoardPose],
    holding: Iterable[int],
    occupied: Iterable[int] = (),
    taken_places: Iterable[str] = (),
    reachable_places: Iterable[str] | None = None,
    notes: Sequence[str] = (),
    cure: str = CLEAR,
) -> Work:
    """The transfers of a task, given a look.

    Args:
        task: the task.
        poses: of the boards seen.
        holding: holes (0 to 3) of the source board that hold a cube.
        occupied: holes of the target board that already hold a cube (Task 2).
        taken_places: names of table places in use (Task 1).
        reachable_places: names of the reachable table places, or None for all.
        notes: added to the message if there are too few places.
        cure: what would help then.

    Raises:
        ImpossibleError: more cubes than free places, or a board was not seen.
    """
    cell, by_name = task.cell, {pose.board.name: pose for pose in poses}
    for board in task.boards:
        if board.name not in by_name:
            raise ImpossibleError(
                f"board {board.name} was not seen, so its holes are not known", board=board.name
            )
    source = by_name[task.from_board.name]
    picks = [h for h in source.holes if h.index in set(holding)]
    if task.to_board is not None:
        target = by_name[task.to_board.name]
        goals = [
            hole_station(cell, target.board.name, h.name, h.T_base_hole, RELEASE_GAP)
            for h in target.holes
            if h.index not in set(occupied)
        ]
    else:
        served = None if reachable_places is None else set(reachable_places)
        goals = [
            s
            for s in free_table_stations(task, by_name.values())
            if s.name not in set(taken_places) and (served is None or s.name in served)
        ]
    if len(goals) < len(picks):
        raise ImpossibleError(
            f"{len(picks)} cubes to move but only {len(goals)} free and reachable places"
            + (f" ({'; '.join(notes)})" if notes else "")
            + f"; {cure}",
            cubes=len(picks),
            places=[g.name for g in goals],
        )
    return Work(
        tuple(
            Transfer(cube_name(h.name), hole_station(cell, source.board.name, h.name, h.T_base_hole), goal)
            for h, goal in zip(picks, goals, strict=False)
        ),
        tuple(goals[len(picks) :]),
    )


def free_table_stations(task: Task, poses: Iterable[BoardPose]) -> list[Station]:
    """The task's places on the table that no board covers, in order of preference."""
    if task.places is None:
        return []
    cell = task.cell
    reach = cell.jaw_opening / 2.0 + 0.025  # half an open gripper, m
    covered = [plate_body(p.board.name, p.T_base_board) for p in poses]
    stations = []
    for number, (x, y) in enumerate(task.places.centres, start=1):
        if not any(_covers(plate, x, y, reach) for plate in covered):
            stations.append(table_station(cell, f"table/{number}", x, y, task.places.yaw))
    return stations


def _covers(plate: Body, x: float, y: float, margin: float) -> bool:
    local = apply(inverse(plate.T_base_body), (x, y, plate.T_base_body[2, 3]))
    half = np.array(plate.shape.size[:2]) / 2.0  # type: ignore[union-attr]
    return bool(np.all(np.abs(local[:2]) < half + margin))
