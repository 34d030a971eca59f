"""A cube's move as a run's looks see it: its source and its target before, and both after, each with its own errors.

Two looks, each of several photographs. Before: the cube sits in a hole of one board, and a hole of another is empty.
After: its source is empty, and it stands in, or not quite in, its target. Between the looks the boards may have
shifted, the camera has swayed, the light has changed a little, and every photograph has its own noise, all of which
real looks have (photographs of a real cell, October 2025: the camera's shift is up to 1.5 px within a session).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from arm.board import Board
from arm.errors import A465Error
from arm.poses import BoardPose
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, frozen, inverse, rot_z, rotation, transform
from cell.scene.bodies import plate_body
from cell.sim.release_faults import T_hole_released
from pictures.boards import CUBE, TABLE, window
from pictures.holes import CONDITIONS, HoleScene, random_scene
from render.renderer import PlacedBoard, render, with_noise
from render.solids import BodySolid
from vision.boards.pose import estimate_board_pose
from vision.camera.model import Camera, Image
from vision.markers.detect import detect_markers

MARGIN_PX = 40  # around a plate that is drawn: the rest of the image is not
PLATE_CORNERS = np.array([[x, y, z] for x in (-0.03, 0.21) for y in (-0.03, 0.17) for z in (0.0, 0.04)])


@dataclass(frozen=True)
class Reality:
    """What is not the same in two looks; standard deviations, but for `moved`.

    Attributes:
        sway_px: of the camera between looks, in x and y, at the image's middle.
        jitter_px: the same between photographs of one look.
        roll_deg: of the camera about its axis between looks.
        moved: a board shifts by up to this on its plane between looks, m.
        turned_deg: and turns.
        gain: of the light between looks, as a share.
        lamp: the lamp's place between looks, m.
        texture: of all surfaces, as a share of their grey level; drawn anew for each look, so nothing cancels it.
        hole: holes from where the board's file says, m.
        play: a seated cube's place is off by up to this, m.
        turn_deg: and its turn.
        size: a cube's edge is off its nominal one by up to this, m.
    """

    sway_px: float = 0.3
    jitter_px: float = 0.1
    roll_deg: float = 0.005
    moved: float = 1e-3
    turned_deg: float = 0.1
    gain: float = 0.04
    lamp: float = 0.05
    texture: float = 0.01
    hole: float = 3e-5
    play: float = 2e-4
    turn_deg: float = 1.0
    size: float = 1e-4


@dataclass(frozen=True, eq=False)
class HoleLook:
    """One hole in the photographs of one look.

    Attributes:
        images: photographs, of the camera's size.
        camera: what is known of what took them, a part of the image.
        pose: of the board, measured in them; None where it was refused.
        index: of the hole.
    """

    images: list[Image]
    camera: Camera
    pose: BoardPose | None
    index: int


@dataclass(frozen=True, eq=False)
class Moved:
    """A cube's move: its source and its target in the look before, and in the one after.

    Attributes:
        source, target: before, with the cube and without.
        source_after, target_after: after.
        size: the cube's true edge, m.
        grey: its grey level.
        where: "view" or "edge": how its boards stand in the image.
        foot: distance of the target from the point on its board's plane right under the camera, m.
    """

    source: HoleLook
    target: HoleLook
    source_after: HoleLook
    target_after: HoleLook
    size: float
    grey: float
    where: str
    foot: float


def moved_cube(
    seed: int,
    release: str,
    camera: Camera,
    where: str,
    reality: Reality | None = None,
    photographs: int = 5,
    grey: tuple[float, float] = (25.0, 235.0),
) -> Moved:
    """Draw a move.

    Args:
        seed: of everything that is drawn.
        release: how the cube stands in the end, see `cell.sim.release_faults`.
        camera: the whole image's.
        where: "view": whole boards; "edge": a marker's white border leaves the image.
        reality: what is not the same in two looks.
        photographs: of a look.
        grey: range of the cube's grey levels.
    """
    of = reality or Reality()
    rng = np.random.default_rng([seed, 11])
    conditions = CONDITIONS["at the image's edge" if where == "edge" else "plain"]
    target_scene = random_scene(seed + 1_000_000, conditions, camera)
    source_scene = replace(
        random_scene(seed, conditions, camera), light=target_scene.light, exposure=target_scene.exposure
    )
    size, level = CUBE + rng.uniform(-of.size, of.size), float(rng.uniform(*grey))
    cube = Body("cube", Box((size,) * 3), np.eye(4), "cube")
    holes = [int(i) for i in rng.integers(4, size=2)]
    scenes = [_emptied(scene, i) for scene, i in zip((source_scene, target_scene), holes, strict=True)]
    made = [_as_made(scene, of, rng) for scene in scenes]
    T_hole_cubes = [_stands(rng, r, size, of) for r in ("seated", release)]
    looks: list[list[HoleLook]] = [[], []]
    for after in (False, True):
        swayed = _swayed(camera, rng, of.sway_px, of.roll_deg)
        gain, lamp = 1.0 + of.gain * rng.standard_normal(), of.lamp * rng.standard_normal(3)
        for k, (scene, board) in enumerate(zip(scenes, made, strict=True)):
            T = scene.T_base_board
            if after:
                T = T @ _shift(rng, of)
            things = [
                (replace(b, T_base_body=T @ inverse(scene.T_base_board) @ b.T_base_body), g)
                for b, g in scene.things
            ]
            if (k == 1) == after:
                T_cube = T @ board.T_board_hole(holes[k]) @ T_hole_cubes[k]
                things.append((replace(cube, T_base_body=frozen(T_cube)), level))
            x, y, z = (np.array(scene.light.lamp) + after * lamp).tolist()
            now = replace(
                scene,
                board=board,
                T_base_board=T,
                things=tuple(things),
                light=replace(scene.light, lamp=(x, y, z)),
                exposure=scene.exposure * (gain if after else 1.0),
            )
            looks[after].append(_look(now, scene, camera, swayed, holes[k], photographs, of, rng))
    target = target_scene.T_base_board @ target_scene.board.T_board_hole(holes[1])
    eye = apply(inverse(target), camera.T_base_camera[:3, 3])
    (source, empty), (emptied, placed) = looks
    return Moved(source, empty, emptied, placed, size, level, where, float(np.hypot(*eye[:2])))


def _emptied(scene: HoleScene, index: int) -> HoleScene:
    things = tuple(t for t in scene.things if t[0].name != f"cube {index}")
    return replace(scene, things=things)


def _as_made(scene: HoleScene, of: Reality, rng: np.random.Generator) -> Board:
    """The board as it was made; its file says where holes should be."""
    off = of.hole * rng.standard_normal((len(scene.board.holes), 3)) * (1.0, 1.0, 0.0)
    return replace(scene.board, holes=frozen(scene.board.holes + off))


def _stands(rng: np.random.Generator, release: str, size: float, of: Reality) -> Array:
    turn = rot_z(np.radians(rng.uniform(-of.turn_deg, of.turn_deg)))
    play = transform(turn, (*rng.uniform(-of.play, of.play, 2), 0.0))
    T = play @ T_hole_released(release, size)
    if release in ("seated", "high"):  # wedged where the pocket is as wide
        T = T @ transform(t=(0.0, 0.0, 2.0 * (size - CUBE)))
    return np.asarray(T)


def _shift(rng: np.random.Generator, of: Reality) -> Array:
    angle, far = rng.uniform(-np.pi, np.pi), of.moved * rng.uniform(0.0, 1.0)
    turn = rot_z(np.radians(of.turned_deg * rng.standard_normal()))
    return transform(turn, (far * np.cos(angle), far * np.sin(angle), 0.0))


def _swayed(camera: Camera, rng: np.random.Generator, sway_px: float, roll_deg: float) -> Camera:
    """The same camera, turned by so much that its image shifts by about as many pixels."""
    about = np.array([*(sway_px / camera.K[0, 0] * rng.standard_normal(2)), 0.0])
    about[2] = np.radians(roll_deg) * rng.standard_normal()
    return replace(camera, T_base_camera=frozen(camera.T_base_camera @ transform(rotation(about))))


def _look(
    scene: HoleScene,
    nominal: HoleScene,
    camera: Camera,
    swayed: Camera,
    index: int,
    photographs: int,
    of: Reality,
    rng: np.random.Generator,
) -> HoleLook:
    """Photographs of a board and what is on it, of the part of the image where it stands."""
    pixels = camera.project_base(apply(nominal.T_base_board, PLATE_CORNERS))
    low = np.maximum(np.floor(pixels.min(axis=0)) - MARGIN_PX, 0.0)
    high = np.minimum(np.ceil(pixels.max(axis=0)) + MARGIN_PX, camera.size)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    clean = render(
        window(swayed, low, size),
        [TABLE, plate_body(scene.board.name, scene.T_base_board)],
        [PlacedBoard(scene.board, scene.T_base_board)],
        light=scene.light,
        psf_px=0.0,
        others=[_solid(body, scene, grey) for body, grey in scene.things],
    )
    rough = cv2.GaussianBlur(rng.standard_normal(clean.shape).astype(np.float32), (0, 0), 1.5)
    clean = clean * np.float32(scene.exposure) * (1.0 + np.float32(of.texture) * rough / rough.std())
    clean = np.asarray(cv2.GaussianBlur(clean, (0, 0), scene.psf_px), dtype=np.float32)
    images = []
    for _ in range(photographs):
        dx, dy = of.jitter_px * rng.standard_normal(2)
        shake = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]])
        shaken = cv2.warpAffine(clean, shake, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        images.append(with_noise(np.asarray(shaken, dtype=np.float32), rng, scene.noise))
    known = window(camera, low, size)
    return HoleLook(images, known, _measured(nominal.board, images, known), index)


def _solid(body: Body, scene: HoleScene, grey: float) -> BodySolid:
    return BodySolid(body, scene.light, grey)


def _measured(board: Board, images: Sequence[Image], camera: Camera) -> BoardPose | None:
    frames = [detect_markers(image, camera, "DICT_4X4_50") for image in images]
    try:
        return estimate_board_pose(board, frames, camera)
    except A465Error:
        return None
