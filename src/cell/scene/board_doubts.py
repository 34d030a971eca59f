"""Where a board was seen although it cannot well stand there: outside the zone, or tilted as no stand is.

Both are what a wrong camera pose looks like, and nothing else tells it before a cube is missed.
"""

from __future__ import annotations

import numpy as np

from arm.poses import BoardPose
from arm.robot.shapes import Box
from arm.se3 import apply, inverse
from cell.config.cell import Cell
from vision.observation import Observation


def outside_zone(cell: Cell, pose: BoardPose) -> float:
    """How far a corner of a plate's top is outside the box in which boards may stand, m; 0 if none is."""
    if not isinstance(cell.zone.shape, Box):
        return 0.0
    plate = pose.board.plate
    square = np.array([[i, j, 0.0] for i in (-1, 1) for j in (-1, 1)]) / 2.0
    top = apply(pose.T_base_board, square * (*plate.size[:2], 0.0) + (*plate.centre, 0.0))
    beyond = np.abs(apply(inverse(cell.zone.T_base_body), top)) - np.array(cell.zone.shape.size) / 2.0
    return max(0.0, float(beyond.max()))


def board_doubts(cell: Cell, seen: Observation) -> str:
    """Return what is doubtful about where boards were seen, and what would help; empty if nothing is."""
    found = []
    outside = {b.name: outside_zone(cell, b.pose) for b in seen.boards}
    if words := ", ".join(f"{name} by {1e3 * far:.0f} mm" for name, far in outside.items() if far > 0.0005):
        found.append(f"outside the zone for boards (boards.zone_centre_mm, boards.zone_size_mm): {words}")
    if words := ", ".join(
        f"{b.name} by {np.degrees(b.pose.tilt()):.1f} deg"
        for b in seen.boards
        if (tilt := b.pose.tilt_hypothesis) is not None and not tilt.fits
    ):
        found.append(f"tilted as no stand is (boards.tilts_deg): {words}")
    pose = f"the pose in {cell.camera_file.name}" if cell.calibration is None else "the calibration"
    help = f"measure a hole by tape: if the look has it elsewhere, {pose} is wrong, otherwise these keys are"
    return f"boards were seen {' and '.join(found)}; {help}" if found else ""
