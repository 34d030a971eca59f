"""Eye-to-hand calibration with a fixed camera, from images of a target and the joint readings at each image.

It estimates the extrinsics of the camera, the mount of the target, and the joint offsets and link errors of the arm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array
from calib.chain.fit import Problem, Sightings
from calib.chain.model_selection import Part
from calib.chain.per_image_poses import PerImagePoses
from calib.chain.result import ChainLimits, calibrate_chain
from calib.chain.verdict import with_verdict
from calib.hand_eye.chain import OFFSETS, arm_chain, smooth_errors, unknown_names
from calib.hand_eye.image_effects import ImageEffects, poses_without_bias
from calib.hand_eye.mistaken import likely_mistake
from calib.hand_eye.result import HandEye as HandEye
from calib.hand_eye.verdict import HandEyeLimits, WorkPlace, with_hand_eye_verdict
from calib.recordings.arm import ArmRecording
from calib.recordings.encoder_steps import encoder_sigmas
from calib.recordings.points import plausible_numbers
from calib.robot_world.initial_guess import initial_guess

LINKS = "errors of the links"
PRINT = "size of the target and bias of its corners"
ZERO = np.radians(3.0)  # rad; standard deviation of joint offsets, wide for an arm that was ever homed
LENGTH, ANGLE = 0.5e-3, np.radians(0.1)  # m and rad; standard deviations of link errors of an industrial arm
GAUGES = (
    "zero of the first joint: equivalent to a rotation of the base, included in T_base_camera",
    "zero of the last joint: equivalent to a rotation of the flange, included in T_gripper_target",
)
HAND_EYE_LIMITS = HandEyeLimits()


def hand_eye_problem(
    recording: ArmRecording,
    about: tuple[Array, Array],
    pixel_sigma: Array,
    reading_sigma: Array,
    alone: PerImagePoses | None = None,
    effects: ImageEffects | None = None,
) -> Problem:
    """Return the estimation problem of an arm and a fixed camera; all unknowns but the gauges are free.

    Args:
        recording: images and joints.
        about: T_base_camera and T_gripper_target, 4x4 each, relative to which the unknowns are defined.
        pixel_sigma: standard deviation of a corner's x and y, (2,) px.
        reading_sigma: standard deviation of the readings, (joints,) rad; 0 for exact encoders.
        alone: fit of each image alone: corners to exclude, and the images' noise; None: all are used and alike.
        effects: unknowns of the image, all free; None for none.
    """
    dh, n = recording.dh, len(recording.joints)
    waves = smooth_errors(dh)
    image = 0 if effects is None else len(effects.names)
    count = len(unknown_names(dh.joints)) + len(waves) + image
    pixels = recording.pixels if alone is None else np.where(alone.wrong[..., None], np.nan, recording.pixels)
    ids = np.tile(np.arange(n)[:, None], (1, dh.joints))
    chain = arm_chain(dh, *about, smooth=True)
    sightings = Sightings(
        chain,
        recording.joints,
        ids,
        np.arange(n),
        recording.points,
        pixels,
        lambda readings, unknowns: {wave.name: wave.gain(readings) for wave in waves},
        None if alone is None else alone.noise,
        None if effects is None else effects.columns,
    )
    free = np.ones(count, dtype=bool)
    free[OFFSETS + 4 * dh.joints : count - image] = False
    free[[OFFSETS, OFFSETS + dh.joints - 1]] = False
    prior = np.concatenate(
        [
            np.full(OFFSETS, np.inf),
            np.repeat([ZERO, LENGTH, LENGTH, ANGLE], dh.joints),
            np.full(len(waves), np.inf),
            np.ones(image),
        ]
    )
    freedom = np.inf if alone is None else alone.freedom
    start = np.zeros(count)
    return Problem([sightings], recording.camera, start, prior, pixel_sigma, reading_sigma, free, freedom)


def calibrate_hand_eye(
    recording: ArmRecording,
    limits: ChainLimits = HAND_EYE_LIMITS,
    encoder_step: float | None = None,
    place: WorkPlace | None = None,
) -> HandEye:
    """Estimate extrinsics, mount, joint offsets and, if the data show them, link errors.

    The offsets of the first and last joint are gauges and held (`GAUGES`).

    Args:
        recording: images and joints.
        limits: of the verdict; the tool's are the usual ones if they are no `HandEyeLimits`.
        encoder_step: rad; default: estimated from the readings.
        place: where the tool is to be right; default: places that the camera sees.

    Returns:
        The calibration; if it is refused, with the likely mistake in the recording as the first reason.

    Raises:
        CalibrationRefused: too few poses, degenerate motions, or implausible parameters.
    """
    try:
        found = _calibrated(recording, limits, encoder_step, place)
    except CalibrationRefused as refused:
        if mistake := likely_mistake(recording):
            raise CalibrationRefused(f"{mistake}; as it is: {refused}", **refused.data) from refused
        raise
    if found.chain.accepted or not (mistake := likely_mistake(recording)):
        return found
    return replace(found, chain=replace(found.chain, reasons=(mistake, *found.chain.reasons)))


@plausible_numbers()
def _calibrated(
    recording: ArmRecording, limits: ChainLimits, encoder_step: float | None, place: WorkPlace | None
) -> HandEye:
    dh = recording.dh
    alone = poses_without_bias(recording)
    names = unknown_names(dh.joints)
    last = len(names)
    are_lengths = [name[-1] in "xyzda" and "turn" not in name and "alpha" not in name for name in names]
    waves = [wave.name for wave in smooth_errors(dh)]
    effects = ImageEffects.of(recording, alone.T_camera_target)
    names += [*waves, *effects.names]
    lengths = np.array(are_lengths + [False] * (len(names) - last))
    nominal = arm_chain(dh, np.eye(4), np.eye(4)).evaluate(recording.joints, np.zeros(last)).T
    begin = initial_guess(nominal, alone.T_camera_target)
    about = (begin.T_base_camera, begin.T_gripper_target)
    problem = hand_eye_problem(
        recording,
        about,
        alone.pixel_sigma,
        encoder_sigmas([recording.joints], encoder_step),
        alone,
        effects,
    )
    if not begin.inliers.any():
        raise CalibrationRefused("no two poses agree on the camera's extrinsics", reason="start")
    chain = calibrate_chain(
        names,
        lengths,
        problem,
        [
            Part(LINKS, tuple(range(OFFSETS + dh.joints, last))),
            Part(PRINT, (len(names) - 2, len(names) - 1), known=True),
        ],
        limits,
        [begin.inliers.astype(float)],
        readings=[f"J{j + 1}" for j in range(dh.joints)],
        step_known=encoder_step is not None,
        smooth=range(last, last + len(waves)),
    )

    def in_words(name: str, value: float) -> str:
        length = lengths[names.index(name)]
        return f"{1e3 * value:.3g} mm" if length else f"{np.degrees(value):.3g} deg"

    chain = with_verdict(chain, in_words)
    found = HandEye(recording, chain, about, effects.lens)
    return with_hand_eye_verdict(found, limits, place or WorkPlace())
