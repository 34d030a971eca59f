"""One calibration of a drawn recording: what is varied, and what came of it."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array, rotation, transform
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.hand_eye.next_poses import choose_calibration_poses
from hand_eye_bench.judge import (
    Off,
    bound,
    closed_forms,
    nees,
    pose_off,
    prediction_off,
    rigid_prediction_off,
    true_unknowns,
)
from recorded.arm_sets import (
    LENS,
    NOMINAL,
    SAMPLERS,
    TARGETS,
    Truth,
    draw_truth,
    recorded,
    spoilt,
    wide,
)
from recorded.faults import FAULTS

POOL, FRESH = 1000, 60


@dataclass(frozen=True)
class Case:
    """Conditions of a recording.

    Attributes:
        poses: how many.
        target: marker or charuco.
        mount: perpendicular or parallel.
        sampler: wide, recipe or planned.
        links: whether links have errors.
        wrong: part of the images that are wrong.
        way: how they are wrong.
        fault: what is wrong with the recording as a whole, see `recorded.faults`.
        peers: whether SHAH and LI are run too.
    """

    poses: int = 270
    target: str = "charuco"
    mount: str = "perpendicular"
    sampler: str = "wide"
    links: bool = False
    wrong: float = 0.0
    way: str = ""
    fault: str = ""
    peers: bool = False


@dataclass(frozen=True)
class Outcome:
    """What came of a recording; NaN where nothing was computed.

    Attributes:
        camera: error of T_base_camera.
        least: its bound: roots of the summed variances.
        held_out: error of predicted targets in postures that were not recorded.
        nees: squared error over covariance, per unknown.
        links: whether the model has errors of links.
        lost, missed: right images that were left out, and wrong ones that were not.
        accepted: the verdict.
        named: the most telling cause that chance does not explain, or "".
        peers: camera and held-out errors of SHAH and LI.
        cpu_s: of the calibration.
    """

    camera: Off
    least: Off
    held_out: Off
    nees: float
    links: bool
    lost: int
    missed: int
    accepted: bool
    named: str
    reasons: tuple[str, ...]
    peers: dict[str, tuple[Off, Off]]
    cpu_s: float


def run(case: Case, seed: int) -> Outcome:
    """Draw a recording and calibrate from it."""
    rng = np.random.default_rng([seed, 20])
    truth = draw_truth(rng, case.mount, case.links)
    points = TARGETS[case.target]
    fresh = wide(truth, points, FRESH, rng)
    rng = np.random.default_rng([seed, case.poses, sum(map(ord, case.sampler))])
    joints = postures(case, truth, rng)
    if case.fault:
        recording = FAULTS[case.fault][0](truth, joints, case.target, rng)
    else:
        recording = recorded(truth, joints, case.target, rng)
    wrong: set[int] = set()
    if case.wrong:
        recording, which = spoilt(recording, case.wrong, case.way, rng)
        wrong = set(which.tolist())
    C = bound(truth, joints, case.target)
    least = Off(1e3 * float(np.sqrt(np.trace(C[:3, :3]))), float(np.degrees(np.sqrt(np.trace(C[3:, 3:])))))
    peers = {}
    if case.peers:
        for name, (X, Y) in closed_forms(recording).items():
            peers[name] = (
                pose_off(Y, truth.T_base_camera),
                rigid_prediction_off(NOMINAL, X, Y, truth, fresh),
            )
    began = time.process_time()
    try:
        found = calibrate_hand_eye(recording)
    except CalibrationRefused as error:
        none = Off(np.nan, np.nan)
        return Outcome(none, least, none, np.nan, False, 0, 0, False, "", (str(error),), peers, 0.0)
    took = time.process_time() - began
    chain = found.chain
    left_out = set(chain.wrong[0].tolist())
    total, unknowns = nees(found, true_unknowns(found, truth))
    return Outcome(
        pose_off(found.T_base_camera, truth.T_base_camera),
        least,
        prediction_off(found, truth, fresh),
        total / unknowns,
        chain.trials[0].needed,
        len(left_out - wrong),
        len(wrong - left_out),
        chain.accepted,
        next((s.name for s in chain.hypotheses if s.sure), ""),
        chain.reasons,
        peers,
        took,
    )


def postures(case: Case, truth: Truth, rng: np.random.Generator, pool_size: int = POOL) -> Array:
    """Of a sampler; planned ones are chosen with place and mount known to 5 mm and 0.5 deg, zeros to 3 deg."""
    points = TARGETS[case.target]
    if case.sampler != "planned":
        return SAMPLERS[case.sampler](truth, points, case.poses, rng)
    pool = wide(truth, points, pool_size, rng)
    about = [
        T @ transform(rotation(np.radians(rng.uniform(-0.5, 0.5, 3))), rng.uniform(-5e-3, 5e-3, 3))
        for T in (truth.T_base_camera, truth.T_gripper_target)
    ]
    plan = choose_calibration_poses(pool, case.poses, NOMINAL, LENS, points, about[0], about[1])
    return np.asarray(pool[rng.permutation(list(plan.places))])
