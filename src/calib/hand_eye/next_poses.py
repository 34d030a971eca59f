"""Optimal poses for hand-eye calibration: a plan before any image is taken, and the next poses after a calibration.

The information of an image is known before it is taken (`calib.chain.fit.normal_equations`). The plan minimises the
error of `T_base_camera`. Advice after a calibration minimises the error of predicted targets over the pool.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm.controller.unit import UNITS, load_unit
from arm.former import former_names
from arm.robot.dh import DhTable
from arm.se3 import Array, frozen
from calib.chain.fit import ChainFit, Problem, normal_equations
from calib.hand_eye.calibrate import HandEye, hand_eye_problem
from calib.hand_eye.chain import CAMERA, OFFSETS, arm_chain
from calib.model.optimal_design import OptimalDesign
from calib.recordings.arm import ArmRecording
from vision.camera.model import Camera
from vision.camera.projection import Projection

LEVER = 0.2e-3 / np.radians(0.02)  # m; weighs rotations by the displacement at this distance
UNKNOWN_LENGTH, UNKNOWN_TURN = 0.1, np.radians(10.0)  # m, rad; standard deviations of extrinsics and mount
CORNER_PX = 0.3  # noise of a corner before any was measured
WIDER = np.radians(10.0)  # margin around the joints of a recording
OBLIQUE = np.radians(55.0)  # largest angle between a target's normal and the line of sight
MARGIN_PX = 20.0
_POOL, _BATCH, _MOST_BATCHES = 1000, 4000, 25
_NEXT = 3  # poses proposed after a calibration


@dataclass(frozen=True, eq=False)
class CalibrationPoses:
    """Poses worth taking, chosen before any image is taken.

    Attributes:
        places: indices in the pool, most informative first.
        sigma: expected standard deviation of T_base_camera after all of them, m (root sum of squares over x, y, z).
        sigma_turn: the same for the rotation, rad.
    """

    places: tuple[int, ...]
    sigma: float
    sigma_turn: float


@dataclass(frozen=True, eq=False)
class NextPose:
    """A pose to take next.

    Attributes:
        joints: readings, (joints,) rad.
        gain: relative reduction of the error of predicted targets by this pose and those before it, 0 to 1.
    """

    joints: Array
    gain: float


def choose_calibration_poses(
    pool: Array,
    count: int,
    dh: DhTable,
    lens: Camera,
    points: Array,
    T_base_camera: Array,
    T_gripper_target: Array,
    taken: Array | None = None,
    pixel_sigma: float = CORNER_PX,
) -> CalibrationPoses:
    """Choose the `count` poses of a pool that determine T_base_camera best, with the joint offsets unknown too.

    Args:
        pool: (n, joints) rad in which the whole target is in view.
        count: number of poses.
        dh: nominal, from the maker.
        lens: camera at the origin.
        points: of the target, (m, 3) m.
        T_base_camera, T_gripper_target: rough extrinsics and mount, 4x4 each.
        taken: (k, joints) rad already recorded.
        pixel_sigma: noise of a corner, px.
    """
    taken = np.zeros((0, dh.joints)) if taken is None else taken
    problem = _unseen(dh, lens, points, np.concatenate([taken, pool]), (T_base_camera, T_gripper_target))
    free = problem.free.copy()
    free[OFFSETS + dh.joints :] = False
    problem = replace(problem, free=free, pixel_sigma=np.full(2, pixel_sigma))
    informations = _information(problem, np.zeros(len(free)))
    k = len(taken)
    known = _prior(problem) + informations[:k].sum(axis=0)
    worth = np.zeros((len(free), 6))  # of translations, and of rotations at a lever
    worth[CAMERA : CAMERA + 6] = np.diag([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
    worth = worth[free]
    chosen = OptimalDesign(informations[k:], known, worth).best(count)
    covariance = np.linalg.inv(known + informations[k:][list(chosen.places)].sum(axis=0))
    moves = worth.T @ covariance @ worth
    sigma, at_lever = (float(np.sqrt(np.trace(block))) for block in (moves[:3, :3], moves[3:, 3:]))
    return CalibrationPoses(chosen.places, sigma, at_lever / LEVER)


def next_poses(found: HandEye, pool: Array | None = None) -> list[NextPose]:
    """Choose greedily the three poses that reduce the error of predicted targets most.

    Args:
        found: a calibration.
        pool: readings (n, joints) rad to choose from. Default: sampled around the recorded joints, within the limits
            of the unit if the recording names it, with the whole target in the image and facing the camera. The
            caller has to check that the arm is clear there.

    Returns:
        The poses; none if the calibration is so wrong that its information is no information.
    """
    recording, problem = found.recording, found.chain.problem
    x = found.chain.fit.unknowns
    if pool is None:
        pool = _pool(found, np.random.default_rng(0))
    if not len(pool):
        return []
    unseen = _unseen(recording.dh, recording.camera, recording.points, pool, found.start)
    unseen = replace(problem, sightings=unseen.sightings)
    twists = unseen.sightings[0].evaluate(x, np.zeros_like(pool)).by_unknown[:, problem.free, :3]
    values, vectors = np.linalg.eigh(np.einsum("nui,nvi->uv", twists, twists) / len(pool))
    worth = vectors * np.sqrt(np.maximum(values, 0.0))
    design = OptimalDesign(_information(unseen, x), found.chain.fit.information, worth)
    best = design.best(_NEXT, exchange=False)
    left = np.asarray(best.variances) / best.before
    if not (left >= 0.0).all():
        return []
    return [
        NextPose(frozen(pool[p]), 1.0 - float(np.sqrt(v))) for p, v in zip(best.places, left, strict=True)
    ]


def _unseen(dh: DhTable, camera: Camera, points: Array, joints: Array, about: tuple[Array, Array]) -> Problem:
    nothing = np.zeros((len(joints), len(points), 2))
    recording = ArmRecording(camera, dh, points, "", joints, nothing)
    return hand_eye_problem(recording, about, np.full(2, CORNER_PX), np.zeros(dh.joints))


def _information(problem: Problem, unknowns: Array) -> Array:
    """Information of an image at each reading on the free unknowns, (n, free, free)."""
    readings = problem.sightings[0].readings
    errors, weights = (np.zeros_like(readings),), (np.ones(len(readings)),)
    fit = ChainFit(unknowns, errors, (), 0.0, np.zeros((0, 0)), 0, 0, weights)
    return normal_equations(problem, fit).S


def _prior(problem: Problem) -> Array:
    sigma = problem.prior_sigma.copy()
    for first in range(CAMERA, OFFSETS, 6):
        sigma[first : first + 3], sigma[first + 3 : first + 6] = UNKNOWN_LENGTH, UNKNOWN_TURN
    return np.diag(sigma[problem.free] ** -2)


def _pool(found: HandEye, rng: np.random.Generator) -> Array:
    """Sample readings (n, joints) near the recorded ones that show the whole target, not too obliquely."""
    r = found.recording
    low, high = r.joints.min(axis=0) - WIDER, r.joints.max(axis=0) + WIDER
    if r.unit in UNITS and len((unit := load_unit(r.unit)).lower) == r.dh.joints:
        low, high = np.maximum(low, unit.lower), np.minimum(high, unit.upper)
    chain = arm_chain(r.dh, *found.start)
    last = np.array(r.camera.size) - 1.0 - MARGIN_PX
    good = np.zeros((0, r.dh.joints))
    before = chain.evaluate(r.joints, found.chain.fit.unknowns).T
    # the printed side is the one that the recording shows, whatever the sign of its z axis
    side = np.sign(np.median(np.einsum("ni,ni->n", before[:, :3, 2], before[:, :3, 3])))
    for _ in range(_MOST_BATCHES):
        joints = rng.uniform(low, high, (_BATCH, r.dh.joints))
        T = chain.evaluate(joints, found.chain.fit.unknowns).T
        middle = T[:, :3, 3] + T[:, :3, :3] @ r.points.mean(axis=0)
        facing = side * np.einsum("ni,ni->n", T[:, :3, 2], middle) / np.linalg.norm(middle, axis=1)
        ahead = np.flatnonzero((facing > np.cos(OBLIQUE)) & (middle[:, 2] > 0.0))
        pixels = Projection(r.camera, T[ahead], r.points).pixels
        inside = ((pixels >= MARGIN_PX) & (pixels <= last)).all(axis=(1, 2))
        good = np.concatenate([good, joints[ahead[inside]]])
        if len(good) >= _POOL:
            break
    return good[:_POOL]


former_names(__name__, __name__, plan_poses="choose_calibration_poses", Planned="CalibrationPoses")
