"""The test that the NAO's paper ends with: lines of a football field, drawn back into the image of a standing robot.

The robot stands on its left foot's known place; where the camera is follows from the leg's and the head's readings. The
field is the Standard Platform League's of 2014: 9 m x 6 m, penalty areas of 0.6 m x 2.2 m, a circle of 1.5 m, lines of
50 mm (assumed: its rule book was not at hand). Gravity is the standing robot's; that the leg bears its weight is not
modelled, see docs/sources.md, "The NAO and its paper".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from arm.se3 import Array, inverse, rot_z, transform
from nao_paper_bench.kinematics import STANDING, NaoKinematics
from nao_paper_bench.table_2 import NAO_CAMERA
from vision.camera.model import Image
from vision.drawing import Colour

_LENGTH, _WIDTH, _LINE = 9.0, 6.0, 0.05
_BOX_DEPTH, _BOX_WIDTH, _CIRCLE = 0.6, 2.2, 0.75
_STEP = 0.02  # m between points of a line
_FARTHEST = 3.0  # m from the robot to points that count
_LEG_DEG = np.array([0.0, 0.0, -25.0, 50.0, -25.0, 0.0])  # the torso upright above bent knees
_HEADS_DEG = np.array([(yaw, pitch) for pitch in (-20.0, 0.0) for yaw in (-40.0, 0.0, 40.0)])
_PLACES = (
    (3.0, 0.4, 0.0),
    (-1.5, 0.2, 0.0),
)  # x, y, heading of the left sole: before the penalty area, the circle
_GRASS, _WHITE, _RED = (40, 110, 40), (235, 235, 235), (40, 40, 255)


@dataclass(frozen=True)
class FieldErrors:
    """How far modelled lines are from those that are seen, over all postures.

    Attributes:
        median_px, p90_px: in the image.
        median_m, p90_m: on the ground, up to 3 m away.
        points: how many were compared.
    """

    median_px: float
    p90_px: float
    median_m: float
    p90_m: float
    points: int


def field_lines() -> list[Array]:
    """Middles of all lines, points (n, 2) m about the field's middle, x to the goals."""
    x, y, half = _LENGTH / 2.0, _WIDTH / 2.0, _BOX_WIDTH / 2.0
    corners = [
        ((-x, -y), (x, -y)),
        ((-x, y), (x, y)),
        ((-x, -y), (-x, y)),
        ((x, -y), (x, y)),
        ((0, -y), (0, y)),
    ]
    for sign in (-1.0, 1.0):
        front = sign * (x - _BOX_DEPTH)
        corners += [((front, -half), (front, half))]
        corners += [((sign * x, edge), (front, edge)) for edge in (-half, half)]
    lines = []
    for a, b in corners:
        count = int(np.ceil(np.linalg.norm(np.subtract(b, a)) / _STEP)) + 1
        lines.append(np.linspace(a, b, count))
    turn = np.linspace(0.0, 2.0 * np.pi, 240)
    return [*lines, _CIRCLE * np.stack([np.cos(turn), np.sin(turn)], axis=-1)]


def field_errors(true: NaoKinematics, taken: NaoKinematics) -> FieldErrors:
    """Over two places on the field and six postures of the head."""
    ground = np.concatenate([_on_ground(line) for line in field_lines()])
    px, metres = [], []
    for place in _PLACES:
        near = ground[np.linalg.norm(ground[:, :2] - place[:2], axis=1) < _FARTHEST]
        for head in np.radians(_HEADS_DEG):
            T_true, T_taken = (_T_camera_field(nao, place, head) for nao in (true, taken))
            seen, modelled = (NAO_CAMERA.project(near @ T[:3, :3].T + T[:3, 3]) for T in (T_true, T_taken))
            with np.errstate(invalid="ignore"):
                inside = ((seen >= 0.0) & (seen < np.array(NAO_CAMERA.size))).all(axis=1)
            inside &= np.isfinite(modelled).all(axis=1)
            px.append(np.linalg.norm(modelled[inside] - seen[inside], axis=1))
            metres.append(np.linalg.norm(_to_ground(T_taken, seen[inside]) - near[inside, :2], axis=1))
    off, away = np.concatenate(px), np.nan_to_num(np.concatenate(metres), nan=_FARTHEST)
    return FieldErrors(
        float(np.median(off)),
        float(np.quantile(off, 0.9)),
        float(np.median(away)),
        float(np.quantile(away, 0.9)),
        len(off),
    )


def draw_field(true: NaoKinematics, taken: NaoKinematics, words: str) -> Image:
    """What the camera sees before the penalty area, and the lines as a model has them in red, (480, 640, 3)."""
    picture = np.full((NAO_CAMERA.size[1], NAO_CAMERA.size[0], 3), _GRASS, dtype=np.uint8)
    head = np.radians([0.0, -20.0])
    for nao, colour, width in ((true, _WHITE, _LINE), (taken, _RED, 0.0)):
        T = _T_camera_field(nao, _PLACES[0], head)
        for line in field_lines():
            _draw(picture, T, line, colour, width)
    cv2.putText(picture, words, (12, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.6, _WHITE, 1, cv2.LINE_AA)
    return picture


def _draw(picture: Image, T: Array, line: Array, colour: Colour, width: float) -> None:
    along = np.gradient(line, axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    edges = [
        NAO_CAMERA.project(_on_ground(line + side * width / 2.0 * across) @ T[:3, :3].T + T[:3, 3])
        for side in (-1.0, 1.0)
    ]
    for a, b, c, d in zip(edges[0][:-1], edges[0][1:], edges[1][1:], edges[1][:-1], strict=True):
        quad = np.array([a, b, c, d])
        if not np.isfinite(quad).all() or np.abs(quad).max() > 4000.0:
            continue
        points = np.rint(quad * 16.0).astype(np.int32)
        if width > 0.0:
            cv2.fillConvexPoly(picture, points, colour, cv2.LINE_AA, 4)
        else:
            cv2.polylines(picture, [points[:2]], False, colour, 2, cv2.LINE_AA, 4)


def _T_camera_field(nao: NaoKinematics, place: Sequence[float], head: Array) -> Array:
    """Of a robot whose left sole is at a place, as it is by its readings."""
    T_field_sole = transform(rot_z(place[2]), (place[0], place[1], 0.0))
    T_camera_sole = nao.T_camera_sole("L", np.radians(_LEG_DEG)[None], head[None], STANDING)[0]
    return np.asarray(T_camera_sole @ inverse(T_field_sole))


def _to_ground(T_camera_field: Array, pixels: Array) -> Array:
    """Where lines of sight meet the ground, (n, 2) m; NaN for those that do not."""
    rays = np.column_stack([NAO_CAMERA.normalised(pixels), np.ones(len(pixels))]) @ T_camera_field[:3, :3]
    eye = -T_camera_field[:3, :3].T @ T_camera_field[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(rays[:, 2] < 0.0, -eye[2] / rays[:, 2], np.nan)
    return np.asarray(eye[:2] + far[:, None] * rays[:, :2])


def _on_ground(points: Array) -> Array:
    return np.column_stack([points, np.zeros(len(points))])
