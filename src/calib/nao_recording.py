"""Recorded images of the checkerboards on a NAO's soles.

``camera{focal_px, centre_px, size_px}``, ``board.vertices_sole_m``, ``gravity_m_s2`` and ``images[]{side, stance,
leg_encoder_deg[6], head_encoder_deg[2], vertices_px[n][2]}``; nothing else in the file is read.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.jsonnode import JsonNode
from arm.se3 import Array, frozen
from calib.chain_fit import Sightings
from calib.nao import SIDES, NaoUnknowns, nao_sightings
from vision.camera import Camera

_MOST_IMAGES, _FEWEST_VERTICES = 100_000, 4


@dataclass(frozen=True, eq=False)
class NaoRecording:
    """What a file holds.

    Attributes:
        camera: at the origin, z forward.
        board: vertices (m, 3) m in the sole's frame.
        gravity: in the torso's frame, (3,) m/s^2.
        side: of each image, 0 for L and 1 for R, (n,).
        stance: number of each image's stance, (n,).
        leg, head: encoders (n, 6) and (n, 2), rad.
        pixels: (n, m, 2), NaN where a vertex was not seen.
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
        """Of both soles, or of the one that was seen."""
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


def read_nao_recording(path: Path) -> NaoRecording:
    """Read such a file.

    Raises:
        InputError: with the key that breaks the format.
    """
    root = JsonNode.of_file(path)
    node = root["camera"]
    focal = float(node["focal_px"].numbers())
    centre, size = node["centre_px"].numbers(2), node["size_px"].numbers(2)
    if focal <= 0.0:
        raise node["focal_px"].error("must be above 0 px")
    if (size < 1.0).any():
        raise node["size_px"].error("must be width and height in px")
    K = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    board = root["board"]["vertices_sole_m"].numbers(None, 3)
    if len(board) < _FEWEST_VERTICES:
        raise root["board"]["vertices_sole_m"].error(f"must be {_FEWEST_VERTICES} vertices at least")
    images = root["images"].items()
    if not images:
        raise root["images"].error("must be one image at least")
    pixels = [_pixels(image["vertices_px"], len(board)) for image in images]
    return NaoRecording(
        Camera(K, np.zeros(5), (int(size[0]), int(size[1])), np.eye(4)),
        board,
        root["gravity_m_s2"].numbers(3),
        frozen(np.array([SIDES.index(image["side"].text(*SIDES)) for image in images])),
        frozen(np.array([image["stance"].integer(0, _MOST_IMAGES) for image in images])),
        frozen(np.radians([image["leg_encoder_deg"].numbers(6) for image in images])),
        frozen(np.radians([image["head_encoder_deg"].numbers(2) for image in images])),
        frozen(np.array(pixels)),
    )


def _pixels(node: JsonNode, count: int) -> Array:
    pixels = node.numbers(count, 2, gaps=True).copy()
    pixels[np.isnan(pixels).any(axis=1)] = np.nan
    if np.isfinite(pixels[:, 0]).sum() < _FEWEST_VERTICES:
        raise node.error(f"must hold {_FEWEST_VERTICES} vertices at least that are not null")
    return pixels
