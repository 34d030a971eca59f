"""Recorded images of a target in an arm's gripper, seen by a camera that stands still, with the joints at each.

``camera{K_px, distortion_k1k2p1p2k3, size_px}``, ``dh{d_m, a_m, alpha_rad, theta_offset_rad}``, ``target{kind,
points_m}`` and ``poses[]{joints_rad, corners_px[n][2]}``, null for a corner that was not seen; and ``unit`` where it is
known. Nothing else in the file is read.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.dh import DhTable
from arm.jsonnode import JsonNode
from arm.se3 import Array, frozen
from vision.camera import Camera
from vision.detections import read_recorded_camera

FEWEST_CORNERS = 4


@dataclass(frozen=True, eq=False)
class ArmRecording:
    """What was recorded.

    Attributes:
        camera: at the origin.
        dh: the arm as its maker says.
        points: of the target, (m, 3) m.
        kind: of the target, in a word.
        joints: (n, joints) rad; they may lie outside the arm's limits.
        pixels: (n, m, 2), NaN where a corner was not seen.
        unit: name of the unit that the joints are of; "" if the file does not say.
    """

    camera: Camera
    dh: DhTable
    points: Array
    kind: str
    joints: Array
    pixels: Array
    unit: str = ""


def read_arm_recording(path: Path) -> ArmRecording:
    """Read such a file.

    Raises:
        InputError: with the key that breaks the format.
    """
    root = JsonNode.of_file(path)
    dh = root["dh"]
    d = dh["d_m"].numbers(None)
    others = [dh[key].numbers(len(d)) for key in ("a_m", "alpha_rad", "theta_offset_rad")]
    points = root["target"]["points_m"].numbers(None, 3)
    if len(points) < FEWEST_CORNERS:
        raise root["target"]["points_m"].error(f"must be {FEWEST_CORNERS} points at least")
    poses = root["poses"].items()
    if not poses:
        raise root["poses"].error("must be one pose at least")
    return ArmRecording(
        read_recorded_camera(root["camera"]),
        DhTable(d, *others),
        points,
        root["target"]["kind"].text() if "kind" in root["target"] else "target",
        frozen(np.array([pose["joints_rad"].numbers(len(d)) for pose in poses])),
        frozen(np.array([_corners(pose["corners_px"], len(points)) for pose in poses])),
        root["unit"].text() if "unit" in root else "",
    )


def _corners(node: JsonNode, count: int) -> Array:
    pixels = node.numbers(count, 2, gaps=True).copy()
    pixels[np.isnan(pixels).any(axis=1)] = np.nan
    if np.isfinite(pixels[:, 0]).sum() < FEWEST_CORNERS:
        raise node.error(f"must hold {FEWEST_CORNERS} corners at least that are not null")
    return pixels
