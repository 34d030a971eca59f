"""Where a board was seen although it cannot well stand there: outside the zone, or tilted as no stand is.

Both are what a wrong camera pose, or images turned by 180 deg, look like, and nothing else tells it before a cube is
missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm.numerics.angles import arctan2
from arm.poses import BoardPose
from arm.robot.shapes import Box
from arm.se3 import apply, frozen, inverse
from cell.config.cell import Cell
from vision.boards.pose import assess_board
from vision.camera.model import Camera
from vision.camera.taped_pose import looking_pose
from vision.markers.detect import Marker
from vision.observation import Observation

LEAST_OUTSIDE = 0.0005  # m, from which it is told
BETTER = 0.7  # of the residuals of images as they are, at most, by which turned ones fit better
LEAST_DOWN = 0.1  # vertical part of a line of sight about which an azimuth is told
HIGH_PX = 0.1  # residual from which turned images are tried although boards are where they may be


def outside_zone(cell: Cell, pose: BoardPose) -> float:
    """How far a corner of a plate's top is outside the box in which boards may stand, m; 0 if none is."""
    if not isinstance(cell.zone.shape, Box):
        return 0.0
    plate = pose.board.plate
    square = np.array([[i, j, 0.0] for i in (-1, 1) for j in (-1, 1)]) / 2.0
    top = apply(pose.T_base_board, square * (*plate.size[:2], 0.0) + (*plate.centre, 0.0))
    beyond = np.abs(apply(inverse(cell.zone.T_base_body), top)) - np.array(cell.zone.shape.size) / 2.0
    return max(0.0, float(beyond.max()))


def _is_tilted_otherwise(pose: BoardPose) -> bool:
    """Whether a board is tilted as no stand is."""
    return pose.tilt_hypothesis is not None and not pose.tilt_hypothesis.fits


def _fitting(
    cell: Cell, seen: Observation, frames: Sequence[Sequence[Marker]], camera: Camera
) -> list[float]:
    """Return the residuals of boards in other frames or by another camera, px; none unless all fit zone and stands."""
    found = []
    for board in seen.boards if frames else ():
        of = assess_board(board.pose.board, frames, camera, cell.board_limits, cell.tilts)
        if of.pose is None or outside_zone(cell, of.pose) > LEAST_OUTSIDE or _is_tilted_otherwise(of.pose):
            return []
        found.append(of.pose.residual_px)
    return found


def _is_inverse(cell: Cell, seen: Observation) -> str:
    """Say that the camera's pose is the inverse of what it should be, if all boards then fit zone and stands."""
    if not _fitting(cell, seen, seen.frames, cell.camera.at(cell.camera.T_camera_base)):
        return ""
    file = cell.camera_file.name
    return (
        f"with the inverse of T_base_camera all fit the zone and the stands: {file} has T_camera_base, which maps base "
        "to camera; give its inverse"
    )


def _is_azimuth(cell: Cell, seen: Observation) -> str:
    """Say with which other azimuth of the camera all boards fit zone and stands: of another sign, or quarters off."""
    T = cell.camera.T_base_camera
    x, z, at = T[:3, 0], T[:3, 2], T[:3, 3]
    if abs(z[2]) < LEAST_DOWN:
        return ""
    right = x - x[2] / z[2] * z  # its part across the line of sight is x
    now = float(arctan2(right[1], right[0]))
    fitting = []
    for other in (-now, *(now + k * np.pi / 2.0 for k in (1, 2, 3))):
        if _fitting(cell, seen, seen.frames, cell.camera.at(looking_pose(at, at + z, other))):
            fitting.append(float(np.degrees((other + np.pi) % (2.0 * np.pi) - np.pi)))
    if not fitting:
        return ""
    return (
        f"with right_azimuth_deg = {' or '.join(f'{v:.1f}' for v in fitting)} all fit the zone and the stands, and the "
        f"pose in {cell.camera_file.name} has {np.degrees(now):.1f}: is its sign wrong, or is it some quarters off?"
    )


def _are_turned(cell: Cell, seen: Observation) -> str:
    """Say that the images are turned by 180 deg, if all boards then fit zone and stands, and the lens better.

    Markers read the same when turned, and the pose absorbs most of it; what is left are the lens's distortion and its
    principal point.
    """
    frames = [
        [replace(m, corners_px=frozen(np.array(cell.camera.size) - 1.0 - m.corners_px)) for m in frame]
        for frame in seen.frames
    ]
    turned, now = _fitting(cell, seen, frames, cell.camera), [board.pose.residual_px for board in seen.boards]
    if not turned or sum(turned) > BETTER * sum(now):
        return ""
    return (
        f"if the images are turned by 180 deg, all fit the zone, the stands and the lens (residual {max(turned):.3f} "
        f"instead of {max(now):.3f} px): take them as those were taken with which lens and pose were calibrated"
    )


def board_doubts(cell: Cell, seen: Observation) -> str:
    """Return what is doubtful about where boards were seen, and what would help; empty if nothing is."""
    found = []
    outside = {b.name: outside_zone(cell, b.pose) for b in seen.boards}
    if words := ", ".join(
        f"{name} by {1e3 * far:.0f} mm" for name, far in outside.items() if far > LEAST_OUTSIDE
    ):
        found.append(f"outside the zone for boards (boards.zone_centre_mm, boards.zone_size_mm): {words}")
    if words := ", ".join(
        f"{b.name} by {np.degrees(b.pose.tilt()):.1f} deg"
        for b in seen.boards
        if _is_tilted_otherwise(b.pose)
    ):
        found.append(f"tilted as no stand is (boards.tilts_deg): {words}")
    largest = max((b.pose.residual_px for b in seen.boards), default=0.0)
    turned = _are_turned(cell, seen) if found or largest > HIGH_PX else ""
    if turned and not found:
        found.append(f"with a residual of {largest:.3f} px")
    if not found:
        return ""
    pose = f"the pose in {cell.camera_file.name}" if cell.calibration is None else "the calibration"
    help = f"measure a hole by tape: if the look has it elsewhere, {pose} is wrong, otherwise these keys are"
    why = turned or _is_inverse(cell, seen) or _is_azimuth(cell, seen) or help
    return f"boards were seen {' and '.join(found)}; {why}"
