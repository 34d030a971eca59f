"""The world file: ground truth of the simulated cell. Nothing else reads it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from arm.board import PLATE_CENTRE, Board, read_board_csv
from arm.io.toml_reader import TomlTable
from arm.numerics.products import mul
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array, frozen, rot_z, rotation, transform
from vision.camera.model import Camera, read_camera

RELEASES = ("seated", "high", "half", "rim", "aside", "pushed")


@dataclass(frozen=True)
class TrueBoard:
    """A board, its true pose, and the holes (0 to 3) that hold a cube."""

    board: Board
    T_base_board: Array
    cubes: tuple[int, ...]


@dataclass(frozen=True)
class World:
    """Ground truth of the simulated cell.

    Attributes:
        file: world file.
        boards: boards that stand in the cell.
        noise_grey: standard deviation of the image noise, grey levels.
        seed: seed of the noise and of the arm's configuration at power-up.
        joint_offsets: true joint zeros minus the nominal ones, (6,), rad.
        links: link errors of the true arm.
        camera: true camera if it differs from the cell's, else None.
        releases: how the first cubes released over a hole come to rest, in order, of `RELEASES`; later ones are seated.
    """

    file: Path
    boards: tuple[TrueBoard, ...]
    noise_grey: float
    seed: int
    joint_offsets: Array
    links: LinkErrors
    camera: Camera | None
    releases: tuple[str, ...] = ()


def board_placement(centre: npt.ArrayLike, yaw: float, tilt: float, lean_azimuth: float) -> Array:
    """Return T_base_board of a plate whose top is centred at `centre` (3,), m.

    The plate is rotated by `yaw` about the vertical, then tilted by `tilt` so that its normal leans towards
    `lean_azimuth`; all in rad and in the base frame.
    """
    axis = np.array([-np.sin(lean_azimuth), np.cos(lean_azimuth), 0.0])
    R = mul(rotation(tilt * axis), rot_z(yaw))
    return transform(R, np.asarray(centre, dtype=float) - mul(R, np.array([*PLATE_CENTRE, 0.0])))


def read_world(path: Path, marker_size: float) -> World:
    """Read a world file.

    Args:
        path: the file.
        marker_size: true edge of the markers' black squares, m.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    root = TomlTable.read(path)
    boards = tuple(_true_board(table, marker_size) for table in root.tables("boards", required=True))
    world = World(
        file=path,
        boards=boards,
        noise_grey=root.number("noise_grey", "grey levels", 0, 50, default=2.0),
        seed=root.integer("seed", 0, 2**31 - 1, default=0),
        joint_offsets=frozen(
            np.radians(root.numbers("joint_offsets_deg", 6, "deg", -5, 5, default=[0.0] * 6))
        ),
        links=LinkErrors(
            frozen(root.numbers("dh_d_error_mm", 6, "mm", -20, 20, default=[0.0] * 6) / 1e3),
            frozen(root.numbers("dh_a_error_mm", 6, "mm", -20, 20, default=[0.0] * 6) / 1e3),
            frozen(np.radians(root.numbers("dh_alpha_error_deg", 6, "deg", -2, 2, default=[0.0] * 6))),
        ),
        camera=read_camera(root.path("camera")) if "camera" in root else None,
        releases=_releases(root),
    )
    root.finish()
    return world


def _releases(root: TomlTable) -> tuple[str, ...]:
    rule = f"a list of {', '.join(RELEASES)}"
    value = root.value("releases", rule) if "releases" in root else []
    if not isinstance(value, list) or not all(one in RELEASES for one in value):
        raise root.error("releases", f"must be {rule}")
    return tuple(value)


def _true_board(table: TomlTable, marker_size: float) -> TrueBoard:
    board = read_board_csv(table.path("file"), marker_size)
    T_base_board = board_placement(
        table.numbers("centre_mm", 3, "mm", -2000, 2000) / 1e3,
        float(np.radians(table.number("yaw_deg", "deg", -360, 360))),
        float(np.radians(table.number("tilt_deg", "deg", 0, 60))),
        float(np.radians(table.number("lean_azimuth_deg", "deg", -360, 360, default=0.0))),
    )
    holes = table.value("cubes", "a list of hole numbers from 1 to 4")
    if (
        not isinstance(holes, list)
        or not all(isinstance(h, int) and 1 <= h <= 4 for h in holes)
        or len(set(holes)) != len(holes)
    ):
        raise table.error("cubes", "must be a list of different hole numbers from 1 to 4")
    table.finish()
    return TrueBoard(board, T_base_board, tuple(h - 1 for h in holes))
