"""Recorded images of a target in an arm's gripper, taken by a fixed camera, with the joint readings at each.

``camera{K_px, distortion_k1k2p1p2k3, size_px}``, ``dh{d_m, a_m, alpha_rad, theta_offset_rad}``, ``target{kind,
points_m}`` and ``poses[]{joints_rad, corners_px[n][2]}``, null for a corner that was not detected; optionally ``unit``.
Nothing else in the file is read.

Corners may lie outside the image by up to a hundredth of its longer side (19 px of 1920). Noise moves a corner past the
border by a fraction of a pixel; a wrong detection, which the fit rejects, may be off by several pixels. A corner that
is farther out belongs to another image, or to an image of another size.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.io.node import Node
from arm.io.rules import covariance_matrix, line, number, numbers
from arm.io.storage import write_atomic
from arm.robot.dh import DhTable
from arm.se3 import Array, frozen
from calib.recordings.points import metres, refuse_repeats, seen_points, target_points
from vision.camera.model import Camera
from vision.markers.recorded import read_recorded_camera

FEWEST_CORNERS = 4
SIZE_RULE, CORNERS_RULE = number("percent", 0, 2), number("px", 0, 2)
SIZE_WITHIN = 1e-3
"""Standard deviation of a print's scale, relative, if nobody measured it: 0.06 mm on 60 mm."""
CORNERS_WITHIN_PX = 0.1
"""Standard deviation of detected corners' common bias, px: real print has shown 0.13 px."""
OUTSIDE = 0.01  # of the image's longer side: how far outside a corner may lie


@dataclass(frozen=True, eq=False)
class ArmRecording:
    """A recording.

    Attributes:
        camera: at the origin.
        dh: nominal, from the maker.
        points: of the target, (m, 3) m.
        kind: of the target, in a word.
        joints: (n, joints) rad; may lie outside the arm's limits.
        pixels: (n, m, 2), NaN where a corner was not detected.
        unit: name of the arm's unit; "" if the file does not give it.
        size_within: standard deviation of the print's scale, relative.
        corners_within: standard deviation of a bias of the corners towards the target's middle, px.
    """

    camera: Camera
    dh: DhTable
    points: Array
    kind: str
    joints: Array
    pixels: Array
    unit: str = ""
    size_within: float = SIZE_WITHIN
    corners_within: float = CORNERS_WITHIN_PX


def read_arm_recording(path: Path) -> ArmRecording:
    """Read a recording.

    Raises:
        InputError: the format is broken (the message names the key), a corner lies outside the image, or a pose is
            repeated.
    """
    root = Node.of_json(path, "recording")
    dh = root["dh"]
    d = metres(dh["d_m"], None)
    a = metres(dh["a_m"], len(d))
    angles = [dh[key].read(numbers(len(d))) for key in ("alpha_rad", "theta_offset_rad")]
    camera = read_recorded_camera(root["camera"])
    if "covariance" in root["camera"]:
        camera = replace(camera, lens_covariance=root["camera"]["covariance"].read(covariance_matrix(9)))
    points = target_points(root["target"]["points_m"], FEWEST_CORNERS, "points")
    poses = root["poses"].items()
    if not poses:
        raise root["poses"].error("must have at least one pose")
    joints = frozen(np.array([pose["joints_rad"].read(numbers(len(d))) for pose in poses]))
    for pose, q in zip(poses, joints, strict=True):
        if np.abs(q).max() > 4.0 * np.pi:
            raise pose["joints_rad"].error("must be within 4 pi rad", "are these degrees?")
    pixels = frozen(np.array([_corners(pose["corners_px"], len(points), camera.size) for pose in poses]))
    refuse_repeats(poses, joints, pixels)
    return ArmRecording(
        camera,
        DhTable(d, a, *angles),
        points,
        root["target"]["kind"].read(line()) if "kind" in root["target"] else "target",
        joints,
        pixels,
        root["unit"].read(line()) if "unit" in root else "",
        root["target"].get("size_within_percent", SIZE_RULE, 100.0 * SIZE_WITHIN) / 100.0,
        root["target"].get("corners_within_px", CORNERS_RULE, CORNERS_WITHIN_PX),
    )


def _corners(node: Node, count: int, size: tuple[int, int]) -> Array:
    pixels = seen_points(node, count, FEWEST_CORNERS, "corners")
    beyond = OUTSIDE * max(size)
    high = np.array(size) - 1.0 + beyond
    for corner, axis in np.argwhere((pixels < -beyond) | (pixels > high)):
        number = node.items()[corner].items()[axis]
        raise number.error(
            f"must be from {-beyond:g} to {high[axis]:g} px: camera.size_px is {size[0]} x {size[1]}, and a corner "
            f"may lie {beyond:g} px outside",
            "are u and v swapped?" if not ((pixels < -beyond) | (pixels > high[::-1])).any() else "",
        )
    return pixels


def recording_json(r: ArmRecording) -> dict[str, Any]:
    """A recording in the format of its file."""
    covariance = r.camera.lens_covariance
    return {
        "kind": "eye_to_hand_fixed_camera",
        **({"unit": r.unit} if r.unit else {}),
        "camera": {
            "K_px": r.camera.K.tolist(),
            "distortion_k1k2p1p2k3": r.camera.distortion.tolist(),
            "size_px": list(r.camera.size),
            **({} if covariance is None else {"covariance": covariance.tolist()}),
        },
        "dh": {
            "d_m": r.dh.d.tolist(),
            "a_m": r.dh.a.tolist(),
            "alpha_rad": r.dh.alpha.tolist(),
            "theta_offset_rad": r.dh.theta_offset.tolist(),
        },
        "target": {
            "kind": r.kind,
            "points_m": r.points.tolist(),
            "size_within_percent": 100.0 * r.size_within,
            "corners_within_px": r.corners_within,
        },
        "poses": [
            {
                "joints_rad": q.tolist(),
                "corners_px": [[None, None] if np.isnan(c).any() else c.tolist() for c in corners],
            }
            for q, corners in zip(r.joints, r.pixels, strict=True)
        ],
    }


def write_arm_recording(path: Path, r: ArmRecording) -> None:
    """Write a file atomically; `read_arm_recording` reads it back bit by bit.

    Raises:
        InputError: it cannot be written.
    """
    write_atomic(path, json.dumps(recording_json(r), indent=1) + "\n")
