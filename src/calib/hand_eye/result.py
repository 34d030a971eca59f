"""Result of a hand-eye calibration: extrinsics, mount, joint offsets, link errors, lens, and their joint covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm.se3 import Array, frozen
from calib.chain.result import ChainCalibration
from calib.hand_eye.chain import CAMERA, OFFSETS, TARGET, free_pose, smooth_errors
from calib.hand_eye.image_effects import refined_lens
from calib.model.intrinsics import COUNT
from calib.recordings.arm import ArmRecording
from vision.camera.model import Camera


@dataclass(frozen=True)
class ToolError:
    """Standard deviations of the tool against holes, at the worst of them.

    Attributes:
        sideways: root of the summed variances of both horizontal directions, m.
        height: m.
        scatter: the part of the arm's scatter, all directions, m.
        holes: number of holes that were looked at; 0 if the arm reaches none.
        parts: part of the variance, 0 to 1, that would go if this were known: "links", "lens", "print", "scatter".
    """

    sideways: float
    height: float
    scatter: float
    holes: int
    parts: Mapping[str, float]


NO_TOOL = ToolError(np.nan, np.nan, np.nan, 0, {})


@dataclass(frozen=True, eq=False)
class HandEye:
    """Extrinsics of the camera, mount of the target, kinematic errors of the arm, and refined lens.

    Attributes:
        recording: the input.
        chain: the calibration of the chain, with its verdict.
        start: T_base_camera and T_gripper_target relative to which the chain's unknowns are defined, 4x4 each.
        lens_factor: change of the nine intrinsics per unknown of the lens, (9, k); k = 0 if the lens is held.
        tool: predicted error of the tool in the holes.
    """

    recording: ArmRecording
    chain: ChainCalibration
    start: tuple[Array, Array]
    lens_factor: Array
    tool: ToolError = NO_TOOL

    @cached_property
    def T_base_camera(self) -> Array:
        """Extrinsics of the camera, 4x4."""
        return frozen(free_pose(self.start[0], CAMERA, self.chain.fit.unknowns).T[0])

    @cached_property
    def T_gripper_target(self) -> Array:
        """Mount of the target, 4x4; gripper is the flange."""
        return frozen(free_pose(self.start[1], TARGET, self.chain.fit.unknowns).T[0])

    @property
    def joint_offsets(self) -> Array:
        """Offsets to add to the readings, (joints,) rad; with the smooth errors' mean over the recorded poses."""
        return frozen(self._parameters[6 : 6 + self.recording.dh.joints] @ self.chain.fit.unknowns)

    @property
    def link_errors(self) -> tuple[Array, Array, Array]:
        """Errors to add to d and a (m) and alpha (rad), (joints,) each."""
        joints = self.recording.dh.joints
        links = self.chain.fit.unknowns[OFFSETS + joints : OFFSETS + 4 * joints]
        return tuple(map(frozen, np.split(links, 3)))  # type: ignore[return-value]

    @cached_property
    def camera(self) -> Camera:
        """The lens as the images refine it within its covariance, with the extrinsics and the remaining covariance."""
        lens = self.recording.camera
        if self.lens_factor.shape[1]:
            change = self._parameters[-COUNT:] @ self.chain.fit.unknowns
            lens = refined_lens(lens, change, self.covariance[-COUNT:, -COUNT:])
        return lens.at(self.T_base_camera)

    @cached_property
    def joint_scatter(self) -> Array:
        """Standard deviation of a joint about its calibrated position, (joints,) rad: scatter and smooth errors."""
        dh, s = self.recording.dh, self.chain.scattering
        if s is None:
            return np.zeros(dh.joints)
        variances = s.sizes.scatter**2
        first = OFFSETS + 4 * dh.joints
        used = self.chain.fit.weights[0] > 0.0
        for joint in range(dh.joints):
            waves = [(k, w) for k, w in enumerate(smooth_errors(dh)) if w.joint == joint]
            gains = np.stack([w.gain(self.recording.joints[used]) for _, w in waves], axis=1)
            gains -= gains.mean(axis=0)
            where = first + np.array([k for k, _ in waves])
            x = self.chain.fit.unknowns[where]
            second = self.chain.covariance[np.ix_(where, where)] + np.outer(x, x)
            variances[joint] += float(np.mean(np.einsum("nk,kl,nl->n", gains, second, gains)))
        return frozen(np.sqrt(variances))

    @cached_property
    def covariance(self) -> Array:
        """Covariance of what a cell uses, (6 + 4 joints + 9, ...): twist of T_base_camera in its own frame (m and rad),
        joint offsets (rad), errors of d, a (m) and alpha (rad), and the nine intrinsics."""
        P = self._parameters
        return frozen(P @ self.chain.covariance @ P.T)

    def if_known(self) -> dict[str, Array]:
        """That covariance if errors of the links, the lens or the print were known, by "links", "lens", "print"."""
        joints, C = self.recording.dh.joints, self.covariance
        held = {"links": range(6 + joints, 6 + 4 * joints), "lens": range(6 + 4 * joints, len(C))}
        P = self._parameters
        found = {name: _given(C, np.array(of)) for name, of in held.items()}
        if self.chain.considered:
            exact = self.chain.fit.covariance(self.chain.problem.free)
        else:
            exact = _given(self.chain.covariance, np.array([-2, -1]))
        return found | {"print": P @ exact @ P.T}

    @cached_property
    def _parameters(self) -> Array:
        """Derivative of those parameters by all unknowns, (6 + 4 joints + 9, count)."""
        dh, count = self.recording.dh, len(self.chain.names)
        joints = dh.joints
        twist = free_pose(self.start[0], CAMERA, self.chain.fit.unknowns).by_unknown[0].T
        arm = np.zeros((4 * joints, count))
        arm[:, OFFSETS : OFFSETS + 4 * joints] = np.eye(4 * joints)
        if self.chain.scattering is not None:
            used = self.chain.fit.weights[0] > 0.0
            for k, wave in enumerate(smooth_errors(dh)):
                mean = float(wave.gain(self.recording.joints[used]).mean())
                arm[wave.joint, OFFSETS + 4 * joints + k] = mean
        lens = np.zeros((COUNT, count))
        k = self.lens_factor.shape[1]
        lens[:, count - k - 2 : count - 2] = self.lens_factor
        return np.concatenate([twist, arm, lens])

    def pose_sigma(self, first: int, R: Array) -> tuple[Array, Array]:
        """Standard deviations: (3,) m along the axes of R's parent frame, (3,) rad about the frame's own axes."""
        C = self.chain.covariance[first : first + 6, first : first + 6]
        return np.sqrt(np.diag(R @ C[:3, :3] @ R.T)), np.sqrt(np.diag(C)[3:])

    @property
    def camera_sigma(self) -> tuple[Array, Array]:
        """Standard deviations of `T_base_camera`: (3,) m in the base frame, (3,) rad about the camera's axes."""
        return self.pose_sigma(CAMERA, self.T_base_camera[:3, :3])

    @property
    def target_sigma(self) -> tuple[Array, Array]:
        """Standard deviations of `T_gripper_target`: (3,) m in the gripper frame, (3,) rad about the target's axes."""
        return self.pose_sigma(TARGET, self.T_gripper_target[:3, :3])


def _given(C: Array, known: Array) -> Array:
    """Covariance of everything if some values, or as many of them as vary, were known."""
    known = np.arange(len(C))[known]
    known = known[np.diag(C)[known] > 0.0]
    scale = np.sqrt(np.diag(C)[known])
    block = C[np.ix_(known, known)] / np.outer(scale, scale)
    across = C[:, known] / scale
    return np.asarray(C - across @ np.linalg.pinv(block, rcond=1e-10, hermitian=True) @ across.T)
