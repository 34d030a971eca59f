"""Boards of the hoop before the lab's camera, as reality has them: their outlines are not square, their print is not as
designed, they lie on foam on a table in use, a wire hides part of them, the image's edge cuts them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.board import TOLERANCE_SDS, Board, Plate
from arm.io.node import Node
from arm.io.storage import data_file
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, inverse, rot_z, rotation, transform
from cell.config.bodies import read_body
from cell.config.plain_board import read_board
from pictures.boards import lab_camera, window
from render.light import Light
from render.plate import PlateSolid
from render.rays import PixelRays, bundle_in
from render.renderer import Exposure, exposed, render, with_noise
from render.solids import BodySolid, Cast, Solid
from render.surface import TOP_FACE, Print, Texture, TexturedSolid
from vision.camera.model import Camera, Image

PUZZLE = read_board(data_file("scenes/hoop/boards/puzzle_01-02.toml"), 0.040)
FOOT = np.array([0.0375, -0.0375, 0.0025])  # the top of a wire's foot on the board, m
FOAM = (0.145, 0.145)  # m
FOAM_GREY, WIRE_GREY = 190.0, 140.0
DICTIONARY = "DICT_4X4_50"


@dataclass(frozen=True)
class Made:
    """A board as it was made: corners of its outline, (4, 2) m, and how its markers were printed."""

    board: Board
    outline: Array
    prints: tuple[Print, Print]


def as_designed(board: Board = PUZZLE) -> Made:
    """A board without any error."""
    if board.outline is None:
        raise ValueError("the board has no outline")
    return Made(board, np.array(board.outline.corners), (Print(), Print()))


def made(board: Board, rng: np.random.Generator, warp: float = 4e-5) -> Made:
    """Draw a board from its tolerances; corners of its print are off by `warp` m besides."""
    ideal = as_designed(board)
    outline = ideal.outline + _tolerance_sd(board) * rng.standard_normal((4, 2))
    sd = board.tolerance / TOLERANCE_SDS
    black, same = rng.uniform(60.0, 110.0), 1.0 + 2.0 * sd / board.marker_size * rng.standard_normal()
    reach = board.marker_size / 2**0.5
    border = 3.5e-5 * rng.standard_normal()  # 0.15 px, of both markers
    prints = tuple(
        Print(
            black=black,
            spread=float(rng.uniform(0.0, 5e-5)),
            border=max(border, 0.0),
            scale=float(
                same + 0.2 * sd / board.marker_size * rng.standard_normal() + 2 * min(border, 0.0) / 0.04
            ),
            shift=(float(sd * rng.standard_normal()), float(sd * rng.standard_normal())),
            turn=float(sd / reach * rng.standard_normal()),
            warp=warp,
            seed=(int(rng.integers(2**31)),),
        )
        for _ in range(2)
    )
    return Made(board, outline, (prints[0], prints[1]))


def _tolerance_sd(board: Board) -> float:
    return 0.0 if board.outline is None else board.outline.tolerance / TOLERANCE_SDS


class TrimmedPlate:
    """A white plate whose top is any quadrilateral, with printed markers."""

    def __init__(self, made_board: Made, T_base_board: Array, light: Light) -> None:
        board, wider = made_board.board, Plate((0.14, 0.14, 0.003), made_board.board.plate.centre)
        self._plate = PlateSolid(
            replace(board, plate=wider), T_base_board, DICTIONARY, light, made_board.prints
        )
        self.T_base_solid, self.half_extent = self._plate.T_base_solid, self._plate.half_extent
        self._T_base_board, self._outline = T_base_board, made_board.outline
        self._white = made_board.prints[0].white * light.lambert(
            float(T_base_board[:3, 2] @ light.towards(T_base_board[:3, 3]))
        )

    def cast(self, T_base_camera: Array, rays: PixelRays) -> Cast:
        """Cast the rays of a camera at the plate; those beyond its outline miss it."""
        shape = rays.x.shape
        flat = PixelRays(rays.x.reshape(-1), rays.y.reshape(-1))
        cast = self._plate.cast(T_base_camera, flat)
        bundle = bundle_in(inverse(self._T_base_board) @ T_base_camera, flat)
        hit = np.isfinite(cast.depth)
        depth = np.where(hit, cast.depth, 0.0)
        x = bundle.origin[0] + depth * bundle.dx
        y = bundle.origin[1] + depth * bundle.dy
        on = hit & (np.abs(bundle.origin[2] + depth * bundle.dz) < 1e-5)
        for a, b in zip(self._outline, np.roll(self._outline, -1, axis=0), strict=True):
            on &= (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) <= 0.0  # corners go clockwise
        bare = cast.region == TOP_FACE
        grey = np.where(bare, np.float32(self._white), cast.grey).astype(np.float32)
        far = np.where(on, cast.depth, np.inf).astype(np.float32)
        return Cast(far.reshape(shape), grey.reshape(shape), cast.region.reshape(shape))


def wire(letter: str, T_base_board: Array) -> list[Body]:
    """Bodies of a wire that stands on a board."""
    node = Node.of_toml(data_file(f"scenes/hoop/wires/{letter}.toml"))
    bodies = [read_body(one, "wire") for one in node["bodies"].items()]
    T = T_base_board @ transform(t=FOOT)
    return [replace(b, name=f"{letter} {b.name}", T_base_body=T @ b.T_base_body) for b in bodies]


def lying(
    middle: Sequence[float], yaw_deg: float, tilt_deg: float, azimuth_deg: float, board: Board = PUZZLE
) -> Array:
    """T_base_board of a board whose middle is at `middle` (3,) m and whose top leans towards `azimuth_deg`."""
    yaw, tilt, azimuth = np.radians([yaw_deg, tilt_deg, azimuth_deg])
    R = rotation(tilt * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])) @ rot_z(yaw)
    return transform(R, np.array(middle) - R @ (*board.plate.centre, 0.0))


@dataclass(frozen=True)
class Look:
    """How an image is taken."""

    exposure: Exposure
    blur_px: float
    table: Texture
    light: Light
    noise_grey: float = 2.0


PLAIN = Look(Exposure(), 0.8, Texture(), Light())


def real_look(rng: np.random.Generator) -> Look:
    """Light, lens and table as different as in photographs of a real cell; white saturates in half of them."""
    return Look(
        Exposure(
            float(rng.uniform(0.85, 1.25)), float(rng.uniform(0.7, 1.0)), tuple(rng.uniform(-0.08, 0.08, 2))
        ),
        float(rng.uniform(0.7, 1.1)),
        Texture(3.0, 4.0, 500.0, 400.0, int(rng.integers(2))),
        Light(lamp=(float(rng.uniform(0.2, 1.2)), float(rng.uniform(-0.8, 0.8)), 2.6)),
    )


def view_of(points_base: Array, margin_px: float = 20.0, camera: Camera | None = None) -> Camera:
    """The part of the lab's camera that shows these points (n, 3) m, clipped to its image."""
    camera = lab_camera() if camera is None else camera
    px = camera.project_base(points_base)
    size = np.array(camera.size)
    low = np.clip(np.floor(px.min(axis=0) - margin_px), 0, size - 64)
    high = np.clip(np.ceil(px.max(axis=0) + margin_px), low + 64, size)
    width, height = (high - low).astype(int)
    return window(camera, low, (int(width), int(height)))


def corners_of(T_base_board: Array, board: Board = PUZZLE, wider: float = 0.012) -> Array:
    """Corners of a board and what is about it, (4, 3) m in the base frame."""
    half = np.array(board.plate.size[:2]) / 2.0 + wider
    square = half * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    return apply(T_base_board, np.pad(square + board.plate.centre, ((0, 0), (0, 1))))


def picture(
    camera: Camera,
    boards: Sequence[tuple[Made, Array]],
    look: Look,
    rng: np.random.Generator,
    bodies: Sequence[Body] = (),
    foam_grey: float = FOAM_GREY,
) -> Image:
    """Draw boards on foam, and other bodies, on a table."""
    light = look.light
    table = Body("table", Box((1.3, 1.5, 0.04)), transform(t=(0.35, 0.0, -0.02)), "table")
    solids: list[Solid] = [TexturedSolid(BodySolid(table, light, 150.0), look.table)]
    solids += [BodySolid(b, light, WIRE_GREY) for b in bodies]
    for n, (one, T) in enumerate(boards):
        centre = T @ transform(t=(*one.board.plate.centre, -0.003 - 0.0125))
        foam = Body(f"foam {n}", Box((*FOAM, 0.025)), centre, "stand")
        solids += [BodySolid(foam, light, foam_grey), TrimmedPlate(one, T, light)]
    clean = render(camera, [], [], DICTIONARY, look.blur_px, light, others=solids)
    return with_noise(exposed(clean, look.exposure), rng, look.noise_grey)
