"""Both markers of a board as photographs show them: rendered once in linear light, then exposed in many ways.

Only windows around the markers are drawn. Light goes through the lens's blur, is brightened, clipped at the sensor's
end, bent by a gamma curve, and gets noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from arm.board import Board
from arm.se3 import Array, apply, frozen
from cell.scene.bodies import plate_body
from pictures.boards import TABLE, lab_board, lab_camera, photograph, random_pose, window
from render.renderer import PlacedBoard, render, with_noise
from vision.camera.model import Camera, Image
from vision.markers.detect import Marker, detect_markers

MARGIN_PX = 48.0


@dataclass(frozen=True, eq=False)
class Pane:
    """The part of the image around one marker.

    Attributes:
        first_px: of the whole image.
        camera: of this part.
        outline_px: true corners of the marker in this part, (4, 2).
        light: (h, w), 255 is the sensor's end.
    """

    first_px: Array
    camera: Camera
    outline_px: Array
    light: np.ndarray[tuple[int, int], np.dtype[np.float32]]


@dataclass(frozen=True)
class Exposure:
    """How photographs are taken.

    Attributes:
        gain: of the light, before it is clipped.
        gamma: exponent of the curve after that.
        blur_px: standard deviation of the lens's blur.
        gains: of each marker on top, as uneven light gives them; between them it changes evenly.
        glare: extra light in a spot beside a side of the first marker: grey levels, distance from the side and
            standard deviation of the spot in marker sides, and which side; None for none.
        rim: gleam of a raised rim inside a side of the first marker, as of a 3D print, which fades along the side: grey
            levels, width px, and which side; None for none.
        noise: grey levels.
        frames: photographs.
    """

    gain: float = 1.0
    gamma: float = 1.0
    blur_px: float = 0.7
    gains: tuple[float, float] = (1.0, 1.0)
    glare: tuple[float, float, float, int] | None = None
    rim: tuple[float, float, int] | None = None
    noise: float = 2.0
    frames: int = 3


def panes(board: Board, T_base_board: Array) -> list[Pane]:
    """The light around each marker of a board before the lab's camera, before the lens's blur."""
    camera, found = lab_camera(), []
    for outline in board.marker_corners():
        pixels = camera.project_base(outline @ T_base_board[:3, :3].T + T_base_board[:3, 3])
        low = np.maximum(np.floor(pixels.min(axis=0) - MARGIN_PX), 0.0)
        high = np.minimum(np.ceil(pixels.max(axis=0) + MARGIN_PX), camera.size)
        width, height = (int(v) for v in high - low)
        cut = window(camera, low, (width, height))
        scene = [TABLE, plate_body(board.name, T_base_board)]
        light = render(cut, scene, [PlacedBoard(board, T_base_board)], "DICT_4X4_50", psf_px=0.0)
        found.append(Pane(low, cut, pixels - low, np.asarray(light, dtype=np.float32)))
    return found


def photographed(
    board: Board, around: list[Pane], of: Exposure, rng: np.random.Generator
) -> list[list[Marker]]:
    """What is detected of a board's markers in photographs."""
    frames: list[list[Marker]] = [[] for _ in range(of.frames)]
    middles = np.array([pane.first_px + np.array(pane.camera.size) / 2.0 for pane in around])
    along = middles[1] - middles[0]
    for number, pane in enumerate(around):
        sharp = pane.light
        if of.rim is not None and number == 0:
            sharp = sharp + _rim(pane, of.rim).astype(np.float32)
        light = np.asarray(cv2.GaussianBlur(sharp, (0, 0), of.blur_px), dtype=float)
        height, width = light.shape
        places = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) + pane.first_px
        share = (places - middles[0]) @ along / (along @ along)
        light = light * (of.gains[0] + share * (of.gains[1] - of.gains[0]))
        if of.glare is not None and number == 0:
            light = light + _glare(pane, places, of.glare)
        seen = 255.0 * (np.clip(of.gain * light, 0.0, 255.0) / 255.0) ** of.gamma
        for frame in frames:
            image = with_noise(seen.astype(np.float32), rng, of.noise)
            wanted = board.marker_ids[number]
            frame += [_moved(m, pane) for m in detect_markers(image, pane.camera) if m.id == wanted]
    return frames


def _moved(marker: Marker, pane: Pane) -> Marker:
    return replace(marker, corners_px=frozen(marker.corners_px + pane.first_px))


def _glare(pane: Pane, places: Array, glare: tuple[float, float, float, int]) -> Array:
    grey, away, spread, side = glare
    size = min(pane.camera.size) - 2.0 * MARGIN_PX  # about a marker, whichever way it is turned
    direction = np.array([np.cos(side * np.pi / 2.0), np.sin(side * np.pi / 2.0)])
    middle = pane.first_px + np.array(pane.camera.size) / 2.0 + (0.5 + away) * size * direction
    distance = ((places - middle) ** 2).sum(axis=-1)
    return np.asarray(grey * np.exp(-0.5 * distance / (spread * size) ** 2))


def _rim(pane: Pane, rim: tuple[float, float, int]) -> Array:
    grey, width_px, side = rim
    start, end = pane.outline_px[side], pane.outline_px[(side + 1) % 4]
    along = end - start
    y, x = np.mgrid[: pane.light.shape[0], : pane.light.shape[1]]
    away = np.stack([x, y], axis=-1) - start
    part = away @ along / (along @ along)
    inside = (
        away @ np.array([-along[1], along[0]]) / np.linalg.norm(along)
    )  # corners go clockwise in the image
    # its two ends to a pixel's part, as a lens would draw them
    covered = np.clip(inside + 0.5, 0.0, 1.0) * np.clip(width_px - inside + 0.5, 0.0, 1.0)
    return np.where((part > 0.0) & (part < 1.0), grey * (1.0 - part) * covered, 0.0)


def one_marker(
    seed: int, tilt_deg: float, noise: float = 2.0, size: float = 0.036, dictionary: str = "DICT_4X4_50"
) -> tuple[Image, Camera, Array]:
    """A photograph of the lower marker alone, the camera that took it, and the true corners (4, 2) px."""
    rng = np.random.default_rng(seed)
    board, T = lab_board(marker_size=size), random_pose(rng, tilt_deg)
    corners = apply(T, board.marker_corners()[0])
    whole = lab_camera()
    low = np.floor(whole.project_base(corners).min(axis=0) - 60.0)
    high = np.ceil(whole.project_base(corners).max(axis=0) + 60.0)
    camera = window(whole, low, (int(high[0] - low[0]), int(high[1] - low[1])))
    shot = photograph(camera, [(board, T)], rng, noise=noise, dictionary=dictionary)
    return shot.images[0], camera, camera.project_base(corners)
