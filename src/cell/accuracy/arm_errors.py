"""The errors of a calibrated arm that certificates allow for, from the same sources as the budget of a placement."""

from __future__ import annotations

import numpy as np

from arm.calibration_file import COVARIANCE
from arm.robot.dh import A465
from arm.se3 import Array, frozen
from cell.config.cell import Cell
from plan.collision.certificate import ArmErrors

_BODY = 0.15  # m, from the tool's frame to the furthest point of a held cube or of the gripper
_OFFSETS = slice(COVARIANCE[0], sum(COVARIANCE[:2]))
_LINKS = slice(sum(COVARIANCE[:2]), sum(COVARIANCE[:5]))


def arm_errors(cell: Cell) -> ArmErrors | None:
    """Return the errors of a cell's arm at `accuracy.sigmas` standard deviations; None without a calibration.

    Joints err by their offsets (the calibration's covariance), by what they scatter, and by the error at rest. Errors
    of d and a move what lies behind them by themselves, those of alpha by their distance from the joint, at most the
    length of the arm from there.
    """
    made = cell.calibration
    if made is None or made.covariance is None or cell.sigmas == 0.0:
        return None
    scatter = np.zeros(6) if made.scatter is None else made.scatter
    joints = made.covariance[_OFFSETS, _OFFSETS] + np.diag(scatter**2 + cell.following_error**2)
    lever = np.concatenate([np.ones(2 * A465.joints), _length_behind(cell)])
    links = float(lever @ np.abs(made.covariance[_LINKS, _LINKS]) @ lever)
    return ArmErrors(frozen(joints), cell.sigmas, cell.sigmas * float(np.sqrt(links)))


def _length_behind(cell: Cell) -> Array:
    """Largest distance of any point of arm, tool and cube from the frame behind each joint, (6,) m."""
    links = np.hypot(A465.a, A465.d)
    behind = np.cumsum(links[::-1])[::-1] - links
    return np.asarray(behind + cell.gripper.length + _BODY)
