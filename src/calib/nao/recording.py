"""Recorded images of the checkerboards on a NAO's soles.

``camera{focal_px, centre_px, size_px}``, ``board.vertices_sole_m``, ``gravity_m_s2`` and ``images[]{side, stance,
leg_encoder_deg[6], head_encoder_deg[2], vertices_px[n][2]}``, null for a vertex that was not detected (docs/nao.md).
Nothing else in the file is read. Vertices may lie outside the image: those of simulated compliant legs do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.io.node import Node
from arm.io.rules import integer, line, number, numbers
from arm.se3 import Array, frozen
from calib.chain.fit import Sightings
from calib.nao.chain import SIDES, NaoUnknowns, nao_sightings
from calib.recordings.points import refuse_repeats, seen_points, target_points
from vision.camera.model import Camera, require_px

_SEVERAL, _MOST_PITCH_DEG = 5, 40.0  # images; HeadPitch
_MOST_IMAGES, _FEWEST_VERTICES = 100_000, 4
GRAVITY, _GRAVITY_VARIES = 9.81, 0.05  # m/s^2; it is 9.78 at the equator and 9.83 at the poles


@dataclass(frozen=True, eq=False)
class NaoRecording:
    """A recording.

    Attributes:
        camera: at the origin, z forward.
        board: vertices (m, 3) m in the sole frame.
        gravity: in the torso frame, (3,) m/s^2.
        side: of each image, 0 for L and 1 for R, (n,).
        stance: number of each image's stance, (n,).
        leg, head: encoders (n, 6) and (n, 2), rad.
        pixels: (n, m, 2), NaN where a vertex was not detected.
    """

    camera: Camera
    board: Array
    gravity: Array
    side: Array
    stance: Array
    leg: Array
    head: Array
    pixels: Array

    def sightings(self, unknowns: NaoUnknowns) -> list[Sightings]:
        """Sightings of both soles, or of the one recorded."""
        return [
            nao_sightings(
                side,
                unknowns,
                self.stance[of].astype(np.intp),
                self.leg[of],
                self.head[of],
                self.board,
                self.pixels[of],
                self.gravity.tolist(),
            )
            for number, side in enumerate(SIDES)
            if (of := self.side == number).any()
        ]


def _require_deg(images: Sequence[Node], leg: Array, head: Array) -> None:
    """Refuse angles (n, 6) and (n, 2) that are in rad, or of the head the other way round.

    Over several images a leg bends by more than 3 deg. HeadPitch is limited to 38.5 deg (Aldebaran's data sheet, H25).
    """
    if len(images) >= _SEVERAL and np.degrees(np.abs(leg).max()) < np.pi:
        rule = f"is within {np.degrees(np.abs(leg).max()):.2g} deg in all {len(images)} images"
        raise images[0]["leg_encoder_deg"].error(rule, "are these rad?")
    for image, (yaw, pitch) in zip(images, np.degrees(head).tolist(), strict=True):
        if abs(pitch) > _MOST_PITCH_DEG and abs(yaw) <= _MOST_PITCH_DEG:
            rule = f"must be HeadYaw and HeadPitch, which is within +-{_MOST_PITCH_DEG:g} deg"
            raise image["head_encoder_deg"].error(rule, "are they the other way round?")


def read_nao_recording(path: Path) -> NaoRecording:
    """Read a recording.

    Raises:
        InputError: the format is broken (the message names the key), or an image is repeated.
    """
    root = Node.of_json(path, "nao recording")
    node = root["camera"]
    focal = node["focal_px"].read(number())
    centre, size = node["centre_px"].read(numbers(2)), node["size_px"].read(numbers(2))
    if focal <= 0.0:
        raise node["focal_px"].error("must be above 0 px")
    if (size < 1.0).any():
        raise node["size_px"].error("must be width and height in px")
    K = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    require_px(node, K, (int(size[0]), int(size[1])), "focal_px", "centre_px")
    board = target_points(root["board"]["vertices_sole_m"], _FEWEST_VERTICES, "vertices")
    images = root["images"].items()
    if not images:
        raise root["images"].error("must have at least one image")
    side = np.array([SIDES.index(image["side"].read(line(*SIDES))) for image in images])
    leg = np.radians([image["leg_encoder_deg"].read(numbers(6)) for image in images])
    head = np.radians([image["head_encoder_deg"].read(numbers(2)) for image in images])
    _require_deg(images, leg, head)
    pixels = np.array(
        [seen_points(image["vertices_px"], len(board), _FEWEST_VERTICES, "vertices") for image in images]
    )
    refuse_repeats(images, np.column_stack([side, leg, head]), pixels)
    gravity = root["gravity_m_s2"].read(numbers(3))
    if not abs(np.linalg.norm(gravity) - GRAVITY) < _GRAVITY_VARIES:
        raise root["gravity_m_s2"].error(f"must have a magnitude of {GRAVITY} +- {_GRAVITY_VARIES} m/s^2")
    return NaoRecording(
        Camera(K, np.zeros(5), (int(size[0]), int(size[1])), np.eye(4)),
        board,
        gravity,
        frozen(side),
        frozen(np.array([image["stance"].read(integer(0, _MOST_IMAGES)) for image in images])),
        frozen(leg),
        frozen(head),
        frozen(pixels),
    )
