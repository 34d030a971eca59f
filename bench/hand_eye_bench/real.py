"""Calibrations of realistic cells: arms that scatter and sag, lenses that we calibrated, targets of another size."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array, frozen
from calib.camera.calibrate import calibrate_camera
from calib.hand_eye.calibrate import HandEye, calibrate_hand_eye
from calib.hand_eye.chain import CAMERA, TARGET, smooth_errors
from calib.hand_eye.image_effects import BIAS, SIZE, lens_factor
from calib.model.intrinsics import vector_of
from calib.recordings.arm import ArmRecording
from cell.sim.target_photos import random_poses
from hand_eye_bench.cases import Case, postures
from hand_eye_bench.judge import nees_of, pose_off, true_unknowns
from pictures.targets import CHARUCO, photos, seen
from recorded.arm_sets import LENS, NOMINAL, TARGETS, Truth, draw_truth, recorded
from recorded.real_arms import RealArm, draw_real_arm
from vision.camera.model import Camera

CANDIDATES = 300  # of poses, as the command has
VIEWS = 20  # of a lens calibration
LENS_NOISE_PX = (0.1, 0.3)


@dataclass(frozen=True)
class RealCase:
    """Conditions of a realistic recording.

    Attributes:
        poses: how many, planned as the command plans them.
        target: marker or charuco.
        real: whether the arm scatters and sags; otherwise its zeros alone are off.
        links: whether its links have errors of 0.3 mm and 0.05 deg.
        own_lens: whether the lens comes from our calibration of 20 views with corners of 0.1 to 0.3 px.
        size: error of the print, relative.
        inwards_px: how far corners are detected towards the target's middle.
    """

    poses: int = 24
    target: str = "charuco"
    real: bool = True
    links: bool = False
    own_lens: bool = False
    size: float = 0.0
    inwards_px: float = 0.0


@dataclass(frozen=True)
class RealOutcome:
    """What came of a realistic recording; NaN where nothing was computed.

    Attributes:
        accepted: the verdict, and why not.
        mm, told_mm: error of the camera's position, and its standard deviation.
        camera, all: squared errors over the covariance, per unknown: of T_base_camera, and of all.
        scatter_deg: rms over the joints, estimated and true.
        px: noise of the corners.
    """

    accepted: bool
    reasons: tuple[str, ...]
    mm: float
    told_mm: float
    camera: float
    all: float
    scatter_deg: tuple[float, float]
    px: float
    cpu_s: float


def lens_from_views(rng: np.random.Generator) -> Camera | None:
    """The bench's lens as our calibration finds it in 20 views; None if it is refused."""
    noise = float(np.exp(rng.uniform(*np.log(LENS_NOISE_PX))))
    views = [seen(T, rng, noise, lens=LENS) for T in random_poses(LENS, CHARUCO, rng, VIEWS)]
    found = calibrate_camera(photos(views), CHARUCO, LENS.size)
    return replace(found.camera, lens_covariance=found.covariance) if found.accepted else None


def draw(case: RealCase, seed: int) -> tuple[ArmRecording, Truth, RealArm | None]:
    """Draw a recording and its truth."""
    rng = np.random.default_rng([seed, 18])
    truth = draw_truth(rng, links=case.links)
    plan = Case(poses=case.poses, target=case.target, sampler="planned")
    joints = postures(plan, truth, rng, CANDIDATES)
    arm = draw_real_arm(rng, truth) if case.real else None
    points = TARGETS[case.target]
    if arm is None:
        recording, at = recorded(truth, joints, case.target, rng), joints
    else:
        at = arm.rest(joints, rng)
        recording = replace(recorded(truth, at, case.target, rng, arm.noise_px), joints=frozen(joints))
    clean = truth.pixels(at, points)
    middle = clean.mean(axis=1, keepdims=True)
    towards = (middle - clean) / np.linalg.norm(middle - clean, axis=-1, keepdims=True)
    shift = truth.pixels(at, (1.0 + case.size) * points) - clean + case.inwards_px * towards
    return replace(recording, pixels=frozen(recording.pixels + shift)), truth, arm


def run_real(case: RealCase, seed: int) -> RealOutcome:
    """Draw a recording and calibrate from it."""
    recording, truth, arm = draw(case, seed)
    none = (np.nan, np.nan)
    px = 0.3 if arm is None else arm.noise_px
    if case.own_lens:
        lens = lens_from_views(np.random.default_rng([seed, 19]))
        if lens is None:
            return RealOutcome(False, ("the lens is refused",), *none, *none, none, px, 0.0)
        recording = replace(recording, camera=lens)
    began = time.process_time()
    try:
        found = calibrate_hand_eye(recording)
    except CalibrationRefused as error:
        return RealOutcome(False, (str(error),), *none, *none, none, px, 0.0)
    took = time.process_time() - began
    true = real_unknowns(found, truth, arm, case)
    c = found.chain
    told = 1e3 * float(np.linalg.norm(found.camera_sigma[0]))
    total, count = nees_of(found, true, np.flatnonzero(c.problem.free))
    camera, six = nees_of(found, true, np.arange(CAMERA, TARGET))
    estimated = 0.0 if c.scattering is None else _rms_deg(c.scattering.sizes.scatter)
    return RealOutcome(
        c.accepted,
        c.reasons,
        pose_off(found.T_base_camera, truth.T_base_camera).mm,
        told,
        camera / six,
        total / count,
        (estimated, 0.0 if arm is None else _rms_deg(arm.scatter)),
        px,
        took,
    )


def real_unknowns(found: HandEye, truth: Truth, arm: RealArm | None, case: RealCase) -> Array:
    """All unknowns of a calibration of a drawn cell, as they really are."""
    lens = lens_factor(found.recording.camera)
    off = vector_of(LENS) - vector_of(found.recording.camera)
    u = np.linalg.lstsq(lens, off, rcond=None)[0] if lens.shape[1] else np.zeros(0)
    image = dict.fromkeys(found.chain.names[len(found.chain.names) - len(u) - 2 :], 0.0)
    image |= {
        SIZE: case.size / found.recording.size_within,
        BIAS: case.inwards_px / found.recording.corners_within,
    }
    image |= dict(zip(image, u, strict=False))
    waves = np.array([arm.wave(w) for w in smooth_errors(NOMINAL)]) if arm is not None else None
    return true_unknowns(found, truth, np.array(list(image.values())), waves)


def _rms_deg(sizes: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(sizes**2))))
