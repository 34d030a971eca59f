"""The world file: ground truth of the simulated cell. Nothing else reads it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.board import PLATE, Board, Plate
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import integer, is_whole, number, numbers, path, rule_of, same, standing, tables, turn
from arm.numerics.products import mul
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array, frozen, inverse, rot_z, rotation, transform
from cell.config.plain_board import read_board
from cell.files.world_errors import (
    ArmKeys,
    ContactKeys,
    ImageKeys,
    MadeKeys,
    PrintKeys,
    TableKeys,
    ToolKeys,
    WorkKeys,
)
from render.surface import Print
from vision.camera.model import Camera, read_camera

RELEASES = ("seated", "high", "half", "rim", "aside", "pushed")
GRASPS = ("held", "missed", "high", "half", "rim", "aside")


@dataclass(frozen=True)
class TrueBoard:
    """A board, its true pose, and the holes (0 to 3) that hold a cube.

    Attributes:
        board: as its file says; in `cell.sim.cell.SimulatedCell`, as it was made.
        T_base_board: true pose.
        cubes: holes (0 to 3) that hold a cube.
        stand: footprint of what it stands on, m; None: that of the cell file.
        prints: how its markers were printed and glued.
        shift: by which it slides in its plane during the run, with its cubes: x and y in m, rotation about its middle
            in rad.
        shifts_after: number of grasps of the run after which it does.
    """

    board: Board
    T_base_board: Array
    cubes: tuple[int, ...]
    stand: tuple[float, float] | None = None
    prints: tuple[Print, Print] = (Print(), Print())
    shift: tuple[float, float, float] | None = None
    shifts_after: int = 1

    def shifted(self, T_shift: Array) -> TrueBoard:
        """Return the board after a motion T_shift (4, 4) in the base frame."""
        return replace(self, T_base_board=frozen(mul(T_shift, self.T_base_board)))

    @property
    def T_shift(self) -> Array:
        """Its motion after `shifts_after` grasps, (4, 4) in the base frame."""
        x, y, turn = self.shift or (0.0, 0.0, 0.0)
        T_base_middle = mul(self.T_base_board, transform(t=(*self.board.plate.centre, 0.0)))
        slid = mul(T_base_middle, transform(rot_z(turn), (x, y, 0.0)))
        return frozen(mul(slid, inverse(T_base_middle)))


class WorldValues(Keys):
    """Values of a world file that are used unchanged."""

    seed: int = key("seed", integer(0, 2**31 - 1), 0)
    noise_grey: float = key("noise_grey", number("grey levels", 0, 50), 2)
    joint_offsets: Array = key("joint_offsets_deg", numbers(6, "deg", -5, 5), [0] * 6)
    build_seed: int = key(
        "build_seed", integer(0, 2**31 - 1), 0
    )  # of what stays from one session to the next


class World(WorldValues):
    """Ground truth of the simulated cell.

    Attributes:
        file: world file.
        boards: boards that stand in the cell.
        links: link errors of the true arm.
        camera: true camera if it differs from the cell's, else None.
        releases: how the first cubes that are released over a hole come to rest, each one of `RELEASES`; later cubes
            are seated.
        grasps: how the first grasps of a cube in a pocket end, each one of `GRASPS`; later ones hold it.
        image, table, prints, made, arm, tool, work: errors of the cell, see `cell.files.world_errors`.
        contact: constants of contact physics, see there.
    """

    file: Path
    boards: tuple[TrueBoard, ...]
    links: LinkErrors
    camera: Camera | None
    releases: tuple[str, ...] = ()
    grasps: tuple[str, ...] = ()
    image: ImageKeys
    table: TableKeys
    prints: PrintKeys
    made: MadeKeys
    arm: ArmKeys
    tool: ToolKeys
    work: WorkKeys
    contact: ContactKeys


def board_placement(
    centre: npt.ArrayLike, yaw: float, tilt: float, lean_azimuth: float, plate: Plate = PLATE
) -> Array:
    """Return T_base_board of a plate whose top is centred at `centre` (3,), m.

    The plate is rotated by `yaw` about the vertical, then tilted by `tilt` so that its normal leans towards
    `lean_azimuth`; all in rad and in the base frame.
    """
    axis = np.array([-np.sin(lean_azimuth), np.cos(lean_azimuth), 0.0])
    R = mul(rotation(tilt * axis), rot_z(yaw))
    return transform(R, np.asarray(centre, dtype=float) - mul(R, np.array([*plate.centre, 0.0])))


def _words(known: tuple[str, ...]) -> Rule[list[str]]:
    """Rule of a list of known words."""
    means = f"a list of {', '.join(known)}"
    return rule_of(means, lambda v: isinstance(v, list) and all(one in known for one in v), same)


def _is_holes(value: Any) -> bool:
    return isinstance(value, list) and all(is_whole(h, 1, 4) for h in value) and len(set(value)) == len(value)


class TrueBoardKeys(Keys):
    """Keys of a board of the world file."""

    file: Path = key("file", path())
    centre: Array = key("centre_mm", standing(3, -2000, 2000))
    yaw: float = key("yaw_deg", turn())
    tilt: float = key("tilt_deg", number("deg", 0, 60))
    lean_azimuth: float = key("lean_azimuth_deg", turn(), 0)
    stand: Array | None = key("stand_mm", numbers(2, "mm", 10, 1000), None)
    shift: Array = key("shifts_mm", numbers(2, "mm", -100, 100), [0, 0])
    shift_turn: float = key("shifts_deg", number("deg", -45, 45), 0)
    shifts_after: int = key("shifts_after", integer(1, 1000), 1)
    cubes: list[int] = key("cubes", rule_of("a list of different hole numbers from 1 to 4", _is_holes, same))


class WorldKeys(
    ImageKeys,
    TableKeys,
    PrintKeys,
    MadeKeys,
    ArmKeys,
    ToolKeys,
    WorkKeys,
    ContactKeys,
    WorldValues,
    file="a world file",
):
    """Keys of a world file."""

    camera: Path | None = key("camera", path(), None)
    d: Array = key("dh_d_error_mm", numbers(6, "mm", -20, 20), [0] * 6)
    a: Array = key("dh_a_error_mm", numbers(6, "mm", -20, 20), [0] * 6)
    alpha: Array = key("dh_alpha_error_deg", numbers(6, "deg", -2, 2), [0] * 6)
    releases: list[str] = key("releases", _words(RELEASES), [])
    grasps: list[str] = key("grasps", _words(GRASPS), [])
    boards: tuple[TrueBoardKeys, ...] = key(
        "boards", tables(lambda node: TrueBoardKeys.read(node), TrueBoardKeys)
    )


def read_world(path: Path, marker_size: float) -> World:
    """Read a world file.

    Args:
        path: the file.
        marker_size: true edge of the markers' black squares, m.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    root = Node.of_toml(path, "world")
    keys = WorldKeys.read(root)
    if keys.ring is not None and keys.ring[0] >= keys.ring[1]:
        raise root.error_at(
            "tool.ring_mm", "must be inner diameter, outer diameter, which is larger, and thickness"
        )
    boards = tuple(_true_board(board, marker_size) for board in keys.boards)
    for index, true in enumerate(boards):
        node = root["boards"].items()[index]
        if shared := sorted(
            set(true.board.marker_ids) & {i for b in boards[:index] for i in b.board.marker_ids}
        ):
            raise node.error_at(
                "file", f"has the marker {shared[0]} of a board before it", "name each board once"
            )
        if max(true.cubes, default=-1) >= len(true.board.holes):
            raise node.error_at(
                "cubes", f"must be empty: {keys.boards[index].file.name} is a board without holes"
            )
    return World(
        file=path,
        boards=boards,
        **keys.values_of(WorldValues),
        links=LinkErrors(keys.d, keys.a, keys.alpha),
        camera=None if keys.camera is None else read_camera(keys.camera),
        releases=tuple(keys.releases),
        grasps=tuple(keys.grasps),
        image=ImageKeys(**keys.values_of(ImageKeys)),
        table=TableKeys(**keys.values_of(TableKeys)),
        prints=PrintKeys(**keys.values_of(PrintKeys)),
        made=MadeKeys(**keys.values_of(MadeKeys)),
        arm=ArmKeys(**keys.values_of(ArmKeys)),
        tool=ToolKeys(**keys.values_of(ToolKeys)),
        work=WorkKeys(**keys.values_of(WorkKeys)),
        contact=ContactKeys(**keys.values_of(ContactKeys)),
    )


def _true_board(keys: TrueBoardKeys, marker_size: float) -> TrueBoard:
    board = read_board(keys.file, marker_size)
    T_base_board = board_placement(keys.centre, keys.yaw, keys.tilt, keys.lean_azimuth, board.plate)
    stand = None if keys.stand is None else (float(keys.stand[0]), float(keys.stand[1]))
    x, y = keys.shift.tolist()
    shift = (x, y, keys.shift_turn) if x or y or keys.shift_turn else None
    cubes = tuple(hole - 1 for hole in keys.cubes)
    return TrueBoard(board, T_base_board, cubes, stand, shift=shift, shifts_after=keys.shifts_after)
