"""Scenes to judge holes by: a board with cubes of any grey, things that lie across holes, and how they are lit.

A scene says what is true and how it is photographed; `photographs` renders it with our own renderer and
`pictures.holes_mujoco` with MuJoCo's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np

from arm.board import PLATE_CENTRE, PLATE_SIZE, POCKET_FLOOR, POCKET_MOUTH, Board
from arm.errors import A465Error
from arm.poses import BoardPose
from arm.robot.shapes import Body, Box, Capsule
from arm.se3 import Array, apply, rot_x, rot_y, rot_z, rotation, transform
from cell.scene.bodies import plate_body
from pictures.boards import CUBE, TABLE, lab_board, leaning
from render.light import Light
from render.rays import Floats
from render.renderer import PlacedBoard, render, with_noise
from render.solids import BodySolid
from vision.boards.pose import estimate_board_pose
from vision.camera.model import Camera, Image
from vision.markers.detect import detect_markers

POCKET_DEPTH = 0.010
BOARDS = ("01-02", "03-04", "05-06", "07-08", "09-10", "11-12")
DRAWN_STD = np.array([1e-4, 1e-4, 3e-4, 2e-3, 2e-3, 5e-4])  # of a drawn pose's twist, m and rad
EDGE = 0.006  # m of the plate's surroundings that must be in the image

What = Literal["cube", "empty", "other"]


@dataclass(frozen=True)
class Conditions:
    """How a scene is drawn.

    Attributes:
        cube_grey: range of the cubes' grey levels; the plate has 150, markers 22 and 235.
        exposure: range of the factor on all light; the image saturates.
        ambient: share of the light from all around.
        lamp_deg: range of the lamp's height over the horizon, seen from the plate.
        shadow: share of the light that a shadow takes.
        penumbra: standard deviation of its edge, m.
        arm: an arm-like body stands between lamp and board.
        gradient: largest change of light across the image, as a share.
        psf_px: of the lens at full size.
        noise: grey levels.
        across: one thing lies across a hole.
        at_edge: the white border of a marker leaves the image, all black corners are in it.
    """

    cube_grey: tuple[float, float] = (25.0, 235.0)
    exposure: tuple[float, float] = (0.8, 1.1)
    ambient: float = 0.45
    lamp_deg: tuple[float, float] = (50.0, 80.0)
    shadow: float = 0.3
    penumbra: float = 7e-3
    arm: bool = False
    gradient: float = 0.0
    psf_px: float = 0.7
    noise: float = 3.0
    across: bool = False
    at_edge: bool = False


CONDITIONS = {
    "plain": Conditions(),
    "dark cubes": Conditions(cube_grey=(20.0, 60.0)),
    "cubes as the plate": Conditions(cube_grey=(135.0, 165.0)),
    "low light": Conditions(exposure=(0.25, 0.4)),
    "overexposed": Conditions(exposure=(1.2, 1.6)),
    "light from a side": Conditions(lamp_deg=(25.0, 45.0), ambient=0.4, shadow=0.5, penumbra=3e-3),
    "shadow of an arm": Conditions(arm=True, lamp_deg=(25.0, 55.0), ambient=0.4, shadow=0.5, penumbra=4e-3),
    "gradient of light": Conditions(gradient=0.6),
    "blur": Conditions(psf_px=2.5),
    "noise": Conditions(noise=10.0),
    "at the image's edge": Conditions(at_edge=True),
}
ACROSS = Conditions(across=True)


@dataclass(frozen=True)
class HoleScene:
    """A board, what is in its holes, what else is there, and how it is photographed."""

    board: Board
    T_base_board: Array
    holes: tuple[What, ...]
    things: tuple[tuple[Body, float], ...]
    light: Light
    exposure: float
    slope: tuple[float, float]
    psf_px: float
    noise: float
    seed: int = field(default=0)


def seated_cube(rng: np.random.Generator, T_board_hole: Array) -> tuple[Body, Array]:
    """A cube as real ones sit: 40 mm to 0.3 mm, wedged where the pocket is as wide, turned and shifted a little."""
    size = CUBE + rng.uniform(-3e-4, 3e-4)
    depth = POCKET_DEPTH * (POCKET_MOUTH - size) / (POCKET_MOUTH - POCKET_FLOOR)
    play = transform(
        rot_z(np.radians(rng.uniform(-1.0, 1.0))), (*rng.uniform(-2e-4, 2e-4, 2), size / 2 - depth)
    )
    return Body("cube", Box((size,) * 3), np.eye(4), "cube"), T_board_hole @ play


def thing_across(rng: np.random.Generator, T_board_hole: Array) -> tuple[Body, Array]:
    """Something over a hole that is no cube in it: a cube beside its seat, or a bar or a plate held over it."""
    turn = rng.uniform(-np.pi, np.pi)
    kind = rng.integers(3)
    if kind == 0:  # stands on the plate and reaches at least 3 mm over the mouth
        away = rng.uniform(0.006, 0.036) * np.array([np.cos(turn), np.sin(turn)])
        pose = transform(rot_z(rng.uniform(-np.pi, np.pi)), (*away, CUBE / 2 + 1e-4))
        return Body("stray", Box((CUBE,) * 3), np.eye(4), "cube"), T_board_hole @ pose
    if kind == 1:  # leans, one edge in the pocket
        lean = rot_z(turn) @ rot_y(np.radians(rng.uniform(10.0, 30.0)))
        return Body("stray", Box((CUBE,) * 3), np.eye(4), "cube"), T_board_hole @ transform(
            lean, (0.004 * np.cos(turn), 0.004 * np.sin(turn), CUBE / 2)
        )
    pose = transform(
        rot_z(turn) @ rot_x(np.radians(90.0)), (*rng.uniform(-0.008, 0.008, 2), rng.uniform(0.04, 0.08))
    )
    return Body("bar", Capsule(rng.uniform(0.008, 0.02), 0.15), np.eye(4), "robot"), T_board_hole @ pose


def random_scene(seed: int, of: Conditions, camera: Camera) -> HoleScene:
    """A board of the lab whole in view, tilted 0, 7 or 15 degrees, with cubes in about half of its holes."""
    rng = np.random.default_rng([seed, 5])
    board = lab_board(BOARDS[seed % len(BOARDS)])
    tilt_deg = (0.0, 7.0, 15.0)[seed % 3] + rng.uniform(-0.3, 0.3)
    T = pose_at_edge(rng, tilt_deg, camera, board) if of.at_edge else pose_in_view(rng, tilt_deg, camera)
    holes: list[What] = ["cube" if rng.random() < 0.5 else "empty" for _ in range(4)]
    if of.across:
        holes[int(rng.integers(4))] = "other"
    things = []
    for index, what in enumerate(holes):
        if what == "empty":
            continue
        body, T_board_thing = (seated_cube if what == "cube" else thing_across)(
            rng, board.T_board_hole(index)
        )
        placed = Body(f"{body.name} {index}", body.shape, T @ T_board_thing, body.kind)
        things.append((placed, float(rng.uniform(*of.cube_grey))))
    centre = apply(T, (*PLATE_CENTRE, 0.0))
    height, around = np.radians(rng.uniform(*of.lamp_deg)), rng.uniform(-np.pi, np.pi)
    towards = np.array([np.cos(height) * np.cos(around), np.cos(height) * np.sin(around), np.sin(height)])
    if of.arm:
        things.append((arm_out_of_view(rng, T, towards, camera), 120.0))
    x, y, z = (centre + 2.5 * towards).tolist()
    light = Light((x, y, z), of.ambient, 1.0, of.shadow, rng.uniform(0.0, 0.15), of.penumbra)
    slope = tuple(float(v) for v in of.gradient * rng.uniform(-1.0, 1.0, 2))
    exposure = float(rng.uniform(*of.exposure))
    return HoleScene(
        board,
        T,
        tuple(holes),
        tuple(things),
        light,
        exposure,
        (slope[0], slope[1]),
        of.psf_px,
        of.noise,
        seed,
    )


def arm_out_of_view(rng: np.random.Generator, T_base_board: Array, towards: Array, camera: Camera) -> Body:
    """A bar between the lamp and the plate, its shadow on the plate, itself outside the image."""
    while True:
        target = apply(T_base_board, (*(np.array(PLATE_CENTRE) + rng.uniform(-0.08, 0.08, 2)), 0.0))
        middle = target + towards * rng.uniform(0.35, 0.8)
        along = np.cross(towards, (0.0, 0.0, 1.0)) / np.hypot(*towards[:2]) + rng.uniform(-0.6, 0.6) * towards
        z = along / np.linalg.norm(along)
        x = np.cross(z, (0.0, 0.0, 1.0)) / np.linalg.norm(np.cross(z, (0.0, 0.0, 1.0)))
        radius, length = rng.uniform(0.015, 0.05), rng.uniform(0.2, 0.5)
        on_axis = middle + np.linspace(-0.5, 0.5, 41)[:, None] * (length + 2 * radius) * z
        pixels = camera.project_base(on_axis)
        px_per_m = camera.K[0, 0] / 0.5  # no nearer than that
        beside = np.maximum(-pixels, pixels - np.array(camera.size)).max(axis=-1) > radius * px_per_m
        if (~np.isfinite(pixels).all(axis=-1) | beside).all():
            pose = transform(np.stack([x, np.cross(z, x), z], axis=-1), middle)
            return Body("arm", Capsule(radius, length), pose, "robot")


def pose_in_view(rng: np.random.Generator, tilt_deg: float, camera: Camera) -> Array:
    """T_base_board of a board anywhere in view, whole."""
    low, high = (
        np.array(PLATE_CENTRE) - np.array(PLATE_SIZE[:2]) / 2,
        np.array(PLATE_CENTRE) + np.array(PLATE_SIZE[:2]) / 2,
    )
    corners = [(x, y, 0.0) for x in (low[0] - EDGE, high[0] + EDGE) for y in (low[1] - EDGE, high[1] + EDGE)]
    while True:
        centre = (rng.uniform(0.33, 0.60), rng.uniform(-0.15, 0.12), rng.uniform(0.06, 0.10))
        T = leaning(centre, rng.uniform(-180, 180), tilt_deg, rng.uniform(-180, 180))
        pixels = camera.project_base(apply(T, corners))
        if (pixels > 0.0).all() and (pixels < np.array(camera.size) - 1.0).all():
            return T


def pose_at_edge(rng: np.random.Generator, tilt_deg: float, camera: Camera, board: Board) -> Array:
    """T_base_board of a board whose plate leaves the image: a black corner is 3 px to a white border from its edge."""
    half = POCKET_MOUTH / 2.0
    square = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (0.0, CUBE - 0.008)])
    mouths = (board.holes[:, None] + square).reshape(-1, 3)
    while True:
        centre = (rng.uniform(0.28, 0.65), rng.uniform(-0.20, 0.17), rng.uniform(0.06, 0.10))
        T = leaning(centre, rng.uniform(-180, 180), tilt_deg, rng.uniform(-180, 180))
        black = camera.project_base(apply(T, board.marker_corners().reshape(8, 3)))
        border = np.linalg.norm(black[1] - black[0]) / 6.0  # px
        nearest = np.minimum(black, np.array(camera.size) - 1.0 - black).min()
        pixels = camera.project_base(apply(T, mouths))
        inside = (pixels >= 6.0).all() and (pixels <= np.array(camera.size) - 7.0).all()
        if inside and 3.0 <= nearest < border:
            return T


def photographs(scene: HoleScene, camera: Camera, count: int = 2) -> list[Image]:
    """Our renderer's photographs, of one moment."""
    others = [BodySolid(body, scene.light, grey) for body, grey in scene.things]
    plate = plate_body(scene.board.name, scene.T_base_board)
    bright = Light(
        scene.light.lamp,
        scene.light.ambient,
        1.0,
        scene.light.shadow,
        scene.light.vignette,
        scene.light.penumbra,
    )
    clean = render(
        camera,
        [TABLE, plate],
        [PlacedBoard(scene.board, scene.T_base_board)],
        light=bright,
        psf_px=0.0,
        others=others,
    )
    return exposed(clean, scene, camera, count)


def exposed(clean: Floats, scene: HoleScene, camera: Camera, count: int) -> list[Image]:
    """What a sensor makes of an image: uneven light, exposure, the lens's blur, saturation and noise."""
    height, width = clean.shape
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, width), np.linspace(-0.5, 0.5, height))
    image = (clean * scene.exposure * (1.0 + scene.slope[0] * x + scene.slope[1] * y)).astype(np.float32)
    image = np.asarray(
        cv2.GaussianBlur(image, (0, 0), scene.psf_px * camera.size[0] / 1920.0), dtype=np.float32
    )
    rng = np.random.default_rng([scene.seed, 6])
    return [with_noise(image, rng, scene.noise) for _ in range(count)]


def measured_pose(scene: HoleScene, images: Sequence[Image], camera: Camera) -> BoardPose | None:
    """The board as it is measured in the photographs, with its covariance; None if it is not found or refused."""
    frames = [detect_markers(image, camera, "DICT_4X4_50") for image in images]
    try:
        return estimate_board_pose(scene.board, frames, camera)
    except A465Error:
        return None


def drawn_pose(scene: HoleScene) -> BoardPose:
    """The true pose with an error as good measured poses have, and the covariance that it is drawn from."""
    error = DRAWN_STD * np.random.default_rng([scene.seed, 7]).standard_normal(6)
    T = scene.T_base_board @ transform(rotation(error[3:]), error[:3])
    return BoardPose(scene.board, T, np.diag(DRAWN_STD**2), 0.1, 1e3)
