"""Eye-to-hand calibration with a fixed camera, from images of a target and the joint readings at each image.

It estimates the extrinsics of the camera, the mount of the target, and the joint offsets and link errors of the arm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm.calibration_file import LARGEST_LINK, LARGEST_ZERO
from arm.errors import CalibrationRefused
from arm.se3 import Array, Bools, frozen
from calib.chain.fit import Problem, Sightings
from calib.chain.flipped_targets import flipped_targets
from calib.chain.model_selection import Part
from calib.chain.per_image_poses import fit_per_image_poses
from calib.chain.result import ChainCalibration, ChainLimits, calibrate_chain
from calib.chain.verdict import with_verdict
from calib.hand_eye.chain import CAMERA, OFFSETS, TARGET, arm_chain, place_and_mount, unknown_names
from calib.recordings.arm import ArmRecording
from calib.recordings.encoder_steps import encoder_sigmas
from calib.recordings.points import plausible_numbers
from calib.robot_world.initial_guess import initial_guess

LINKS = "errors of the links"
ZERO = np.radians(3.0)  # rad; standard deviation of joint offsets, wide for an arm that was ever homed
LENGTH, ANGLE = 0.5e-3, np.radians(0.1)  # m and rad; standard deviations of link errors of an industrial arm
GAUGES = (
    "zero of the first joint: equivalent to a rotation of the base, included in T_base_camera",
    "zero of the last joint: equivalent to a rotation of the flange, included in T_gripper_target",
)
HAND_EYE_LIMITS = ChainLimits(held_out=1e-3)


@dataclass(frozen=True, eq=False)
class HandEye:
    """Extrinsics of the camera, mount of the target, and kinematic errors of the arm.

    Attributes:
        recording: the input.
        chain: the calibration of the chain, with its verdict.
        start: T_base_camera and T_gripper_target relative to which the chain's unknowns are defined, 4x4 each.
        pixel_sigma: noise of a corner, (2,) px, estimated from the images without the arm.
    """

    recording: ArmRecording
    chain: ChainCalibration
    start: tuple[Array, Array]
    pixel_sigma: Array

    @cached_property
    def _placed(self) -> tuple[Array, Array]:
        return place_and_mount(*self.start, self.chain.fit.unknowns)

    @property
    def T_base_camera(self) -> Array:
        """Extrinsics of the camera, 4x4."""
        return self._placed[0]

    @property
    def T_gripper_target(self) -> Array:
        """Mount of the target, 4x4; gripper is the flange."""
        return self._placed[1]

    @property
    def joint_offsets(self) -> Array:
        """Offsets to add to the readings, (joints,) rad."""
        return frozen(self.chain.fit.unknowns[OFFSETS : OFFSETS + self.recording.dh.joints])

    @property
    def link_errors(self) -> tuple[Array, Array, Array]:
        """Errors to add to d and a (m) and alpha (rad), (joints,) each."""
        first = OFFSETS + self.recording.dh.joints
        return tuple(map(frozen, np.split(self.chain.fit.unknowns[first:], 3)))  # type: ignore[return-value]

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


def hand_eye_problem(
    recording: ArmRecording,
    about: tuple[Array, Array],
    pixel_sigma: Array,
    reading_sigma: Array,
    wrong: Bools | None = None,
    noise: Array | None = None,
    noise_freedom: float = np.inf,
) -> Problem:
    """Return the estimation problem of an arm and a fixed camera; all unknowns but the gauges are free.

    Args:
        recording: images and joints.
        about: T_base_camera and T_gripper_target, 4x4 each, relative to which the unknowns are defined.
        pixel_sigma: standard deviation of a corner's x and y, (2,) px.
        reading_sigma: standard deviation of the readings, (joints,) rad; 0 for exact encoders.
        wrong: corners to exclude, (n, m).
        noise: of each image, relative to a typical image, (n,).
        noise_freedom: see `Problem`.
    """
    dh, n = recording.dh, len(recording.joints)
    count = len(unknown_names(dh.joints))
    pixels = recording.pixels if wrong is None else np.where(wrong[..., None], np.nan, recording.pixels)
    ids = np.tile(np.arange(n)[:, None], (1, dh.joints))
    chain = arm_chain(dh, *about)
    sightings = Sightings(chain, recording.joints, ids, np.arange(n), recording.points, pixels, None, noise)
    free = np.ones(count, dtype=bool)
    free[[OFFSETS, OFFSETS + dh.joints - 1]] = False
    prior = np.concatenate([np.full(OFFSETS, np.inf), np.repeat([ZERO, LENGTH, LENGTH, ANGLE], dh.joints)])
    start = np.zeros(count)
    return Problem(
        [sightings], recording.camera, start, prior, pixel_sigma, reading_sigma, free, noise_freedom
    )


@plausible_numbers()
def calibrate_hand_eye(
    recording: ArmRecording, limits: ChainLimits = HAND_EYE_LIMITS, encoder_step: float | None = None
) -> HandEye:
    """Estimate extrinsics, mount, joint offsets and, if the data show them, link errors.

    The offsets of the first and last joint are gauges and held (`GAUGES`).

    Args:
        recording: images and joints.
        limits: of the verdict.
        encoder_step: rad; default: estimated from the readings.

    Raises:
        CalibrationRefused: too few poses, degenerate motions, or implausible parameters.
    """
    dh = recording.dh
    alone = fit_per_image_poses(recording.camera, recording.points, recording.pixels)
    names = unknown_names(dh.joints)
    lengths = np.array([name[-1] in "xyzda" and "turn" not in name and "alpha" not in name for name in names])
    nominal = arm_chain(dh, np.eye(4), np.eye(4)).evaluate(recording.joints, np.zeros(len(names))).T
    begin = initial_guess(nominal, alone.T_camera_target)
    problem = hand_eye_problem(
        recording,
        (begin.T_base_camera, begin.T_gripper_target),
        alone.pixel_sigma,
        encoder_sigmas([recording.joints], encoder_step),
        alone.wrong,
        alone.noise,
        alone.freedom,
    )
    if not begin.inliers.any():
        raise CalibrationRefused("no two poses agree on the camera's extrinsics", reason="start")
    chain = calibrate_chain(
        names,
        lengths,
        problem,
        [Part(LINKS, tuple(range(OFFSETS + dh.joints, len(names))))],
        limits,
        [begin.inliers.astype(float)],
        readings=[f"J{j + 1}" for j in range(dh.joints)],
        step_known=encoder_step is not None,
    )

    def in_words(name: str, value: float) -> str:
        length = lengths[names.index(name)]
        return f"{1e3 * value:.3g} mm" if length else f"{np.degrees(value):.3g} deg"

    chain = with_verdict(chain, in_words)
    flipped = [
        f"{len(images)} of the rejected images show the target rotated by {turn} deg (a flipped marker): "
        f"{', '.join(map(str, images[:8]))}{', ...' if len(images) > 8 else ''}"
        for turn, images in flipped_targets(chain).items()
    ]
    found = HandEye(recording, chain, (begin.T_base_camera, begin.T_gripper_target), alone.pixel_sigma)
    reasons, remarks = (*chain.reasons, *_implausible(found)), (*chain.remarks, *flipped)
    return replace(found, chain=replace(chain, reasons=reasons, remarks=remarks))


def _implausible(found: HandEye) -> Iterator[str]:
    """Refuse errors that are too large for a calibration file: it is another arm, or one that was homed wrongly."""
    d, a, alpha = found.link_errors
    length, angle = LARGEST_LINK
    checked = (
        ("zero", found.joint_offsets, LARGEST_ZERO, np.degrees(1.0), "deg"),
        ("d", d, length, 1e3, "mm"),
        ("a", a, length, 1e3, "mm"),
        ("alpha", alpha, angle, np.degrees(1.0), "deg"),
    )
    beyond = [
        (
            float(abs(values[j]) / most),
            f"{what} of J{j + 1} is off by {unit * values[j]:.3g} {symbol}, at most {unit * most:.3g} is plausible",
        )
        for what, values, most, unit, symbol in checked
        for j in np.flatnonzero(np.abs(values) > most)
    ]
    if beyond:
        others = f", and {len(beyond) - 1} more such parameters" if len(beyond) > 1 else ""
        yield (
            f"{max(beyond)[1]}{others}: home the arm again; does the recording's dh describe this arm, and are dh and "
            "target in m and rad?"
        )
