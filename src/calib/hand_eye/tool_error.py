"""Predicted error of the tool in the holes: what a hand-eye calibration is worth where cubes are placed.

A hole is seen by the camera, and the arm moves its tool there. The errors of camera, lens and arm meet in that one
place, and those that are common cancel: a base that is turned with its camera misses nothing. So the joint covariance
is carried to the tool, hole by hole, and the arm's scatter added.
"""

from __future__ import annotations

import numpy as np

from arm.robot.dh import DhTable
from arm.se3 import Array, Bools, Indices, apply, frozen, inverse, skew, transform
from calib.hand_eye.chain import OFFSETS, arm_chain
from calib.hand_eye.result import NO_TOOL, HandEye, ToolError
from vision.camera.projection import Projection

TOOL = frozen(transform(t=(0.0, 0.0, 0.134112)))
"""T_flange_tool of the A465's gripper and fingers."""
HEIGHTS = (0.03, 0.10)  # m above the base's plane: where boards' tops are if the cell is not known
_ACROSS = (0.2, 0.5, 0.8)  # of the image
_CORNERS = 0.018 * np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
_MARKERS = np.array([(-0.09, -0.07), (0.09, 0.07)])  # of a board, from its middle, m
_STEPS, _STARTS, _LONGEST = 60, 8, 0.3
_REACHED = 1e-4  # m and rad


def tool_error(found: HandEye, holes: Array | None = None, T_flange_tool: Array = TOOL) -> ToolError:
    """Predict the tool's error.

    Args:
        found: a calibration.
        holes: (n, 3) m in the base frame; default: `image_holes`. Of them count those that camera and tool reach.
        T_flange_tool: 4x4; its z points out of the gripper.
    """
    holes = image_holes(found) if holes is None else holes[_sees(found, holes)]
    dh = found.recording.dh
    joints, reached = _pointing_down(found, holes, T_flange_tool)
    if not len(reached):
        return NO_TOOL
    points = holes[reached]
    at = arm_chain(dh, np.eye(4), T_flange_tool).evaluate(joints, np.zeros(OFFSETS + 4 * dh.joints))
    R = at.T[:, :3, :3]
    by_arm = np.swapaxes(at.by_unknown[:, OFFSETS:, :3] @ np.swapaxes(R, 1, 2), 1, 2)
    by_joint = np.swapaxes(at.by_reading[..., :3] @ np.swapaxes(R, 1, 2), 1, 2)
    scatter = (by_joint * found.joint_scatter**2) @ np.swapaxes(by_joint, 1, 2)
    by_camera, by_lens = _by_camera(found, points)
    G = np.concatenate([by_camera, -by_arm, by_lens], axis=-1)
    C = G @ found.covariance @ np.swapaxes(G, 1, 2) + scatter
    variances = np.diagonal(C, axis1=1, axis2=2)
    worst = int(np.argmax(variances.sum(axis=1)))
    total = float(variances[worst].sum())
    left = {name: float(np.trace(G[worst] @ known @ G[worst].T)) for name, known in found.if_known().items()}
    spread = float(np.trace(scatter[worst]))
    parts = {name: 1.0 - (of + spread) / total for name, of in left.items()} | {"scatter": spread / total}
    return ToolError(
        float(np.sqrt(variances[:, :2].sum(axis=1).max())),
        float(np.sqrt(variances[:, 2].max())),
        float(np.sqrt(np.trace(scatter, axis1=1, axis2=2).max())),
        len(points),
        parts,
    )


def image_holes(found: HandEye) -> Array:
    """Places that the camera sees at usual heights, (n, 3) m in the base frame."""
    size = np.array(found.recording.camera.size)
    pixels = np.array([(x, y) for x in _ACROSS for y in _ACROSS]) * (size - 1.0)
    eye, rays = found.T_base_camera[:3, 3], found.camera.rays(pixels) @ found.T_base_camera[:3, :3].T
    with np.errstate(divide="ignore"):
        along = (np.array(HEIGHTS)[:, None] - eye[2]) / rays[:, 2]
    ahead = np.isfinite(along) & (along > 0.0)
    return np.asarray((eye + along[..., None] * rays)[ahead])


def _sees(found: HandEye, holes: Array) -> Bools:
    """Which of the holes (n, 3) are in the image, (n,)."""
    with np.errstate(invalid="ignore"):
        pixels = found.camera.project_base(holes)
        return np.asarray(((pixels > 0.0) & (pixels < np.array(found.camera.size))).all(axis=1))


def _by_camera(found: HandEye, holes: Array) -> tuple[Array, Array]:
    """Change of the holes' measured places by the camera's twist (n, 3, 6) and by the intrinsics (n, 3, 9)."""
    camera, T = found.camera, found.T_base_camera
    corners = np.concatenate([m + _CORNERS for m in _MARKERS])
    board = np.column_stack([corners, np.zeros(len(corners))])
    by_camera, by_lens = [], []
    for hole in holes:
        in_camera = apply(inverse(T), hole)
        by_camera.append(T[:3, :3] @ np.hstack([np.eye(3), -skew(in_camera)]))
        seen = Projection(camera.at(np.eye(4)), inverse(T) @ transform(t=hole), board)
        B, L = seen.by_target.reshape(-1, 6), seen.by_intrinsics.reshape(-1, 9)
        by_lens.append(-np.linalg.lstsq(B, L, rcond=None)[0][:3])
    return np.array(by_camera), np.array(by_lens)


def _pointing_down(found: HandEye, holes: Array, T_flange_tool: Array) -> tuple[Array, Indices]:
    """Readings (k, joints) with the tool at k of the holes (n, 3), pointing down; and which holes those are, (k,).

    By damped least squares from several of the recorded poses; of those that arrive, the one that bends least.
    """
    dh, recorded = found.recording.dh, found.recording.joints
    starts = recorded[np.unique(np.linspace(0, len(recorded) - 1, _STARTS).astype(int))]
    q = np.tile(starts, (len(holes), 1))
    arrived = _reach(dh, q, np.repeat(holes, len(starts), axis=0), T_flange_tool)
    bend = np.where(arrived, np.abs(np.arctan2(np.sin(q), np.cos(q))).max(axis=1), np.inf)
    bend = bend.reshape(len(holes), len(starts))
    reached = np.flatnonzero(np.isfinite(bend).any(axis=1))
    return q.reshape(*bend.shape, dh.joints)[reached, np.argmin(bend[reached], axis=1)], reached


def _reach(dh: DhTable, q: Array, holes: Array, T_flange_tool: Array) -> Bools:
    """Move readings q (n, joints), in place, until the tool points down at holes (n, 3); which have arrived, (n,)."""
    chain, none = arm_chain(dh, np.eye(4), T_flange_tool), np.zeros(OFFSETS + 4 * dh.joints)
    arrived, moving = np.zeros(len(q), dtype=bool), np.arange(len(q))
    for _ in range(_STEPS + 1):
        at = chain.evaluate(q[moving], none)
        back = np.swapaxes(at.T[:, :3, :3], 1, 2)
        off = (back @ (holes[moving] - at.T[:, :3, 3])[..., None])[..., 0]
        down = -back[:, :, 2]
        lean = np.stack([-down[:, 1], down[:, 0]], axis=1)
        residual = np.hstack([off, lean])
        there = (np.abs(residual).max(axis=1) < _REACHED) & (down[:, 2] > 0.0)
        arrived[moving[there]] = True
        J = np.swapaxes(at.by_reading, 1, 2)[~there, :5]
        moving, residual = moving[~there], residual[~there]
        if not len(moving):
            break
        H = np.swapaxes(J, 1, 2) @ J + 1e-6 * np.eye(J.shape[2])
        step = np.linalg.solve(H, np.swapaxes(J, 1, 2) @ residual[..., None])[..., 0]
        longest = np.abs(step).max(axis=1, keepdims=True)
        q[moving] += step * np.minimum(1.0, _LONGEST / np.maximum(longest, 1e-12))
    return arrived
