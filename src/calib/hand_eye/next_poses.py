"""In which poses an arm should show its target to the camera: planned before any is taken, and which to take next.

What an image will say is known before it is taken (`chain_fit.normal_equations`). A plan leaves the least error of
`T_base_camera`; advice after a calibration leaves the least error of targets predicted where the arm was and may go.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm.controller.unit import UNITS, load_unit
from arm.robot.dh import DhTable
from arm.se3 import Array, frozen
from calib.chain.fit import ChainFit, Problem, normal_equations
from calib.hand_eye.calibrate import HandEye, hand_eye_problem
from calib.hand_eye.chain import CAMERA, OFFSETS, arm_chain
from calib.hand_eye.optimal_design import InformationChoice
from calib.recordings.arm import ArmRecording
from vision.camera.model import Camera

LEVER = 0.2e-3 / np.radians(0.02)  # m; turns count as what they move at this distance
UNKNOWN_LENGTH, UNKNOWN_TURN = 0.1, np.radians(10.0)  # of place and mount before the first image
CORNER_PX = 0.3  # noise of a corner, where none was seen yet
WIDER = np.radians(10.0)  # beyond the joints of a recording
OBLIQUE = np.radians(55.0)  # most, between a target's normal and the line of sight
MARGIN_PX = 20.0
_POOL, _BATCH, _MOST_BATCHES = 1000, 4000, 25


@dataclass(frozen=True, eq=False)
class PosePlan:
    """Poses that are worth taking.

    Attributes:
        places: in the pool, most telling first.
        sigma: of T_base_camera after all of them, expected: m (root of the sum over x, y, z).
        sigma_turn: the same, rad.
    """

    places: tuple[int, ...]
    sigma: float
    sigma_turn: float


@dataclass(frozen=True, eq=False)
class NextPose:
    """A pose to take next.

    Attributes:
        joints: (joints,) rad, as they are read.
        gain: by what part the error of predicted targets falls if it and those before it are taken, 0 to 1.
    """

    joints: Array
    gain: float


def plan_poses(
    pool: Array,
    count: int,
    dh: DhTable,
    lens: Camera,
    points: Array,
    T_base_camera: Array,
    T_gripper_target: Array,
    taken: Array | None = None,
    pixel_sigma: float = CORNER_PX,
) -> PosePlan:
    """The `count` poses of a pool that leave T_base_camera least uncertain, zeros of the joints being unknown too.

    Args:
        pool: (n, joints) rad in which the whole target is seen.
        count: how many to choose.
        dh: the arm as its maker says.
        lens: camera at the origin.
        points: of the target, (m, 3) m.
        T_base_camera, T_gripper_target: about where the camera is and how the target is held, 4x4 each.
        taken: (k, joints) rad that were recorded before.
        pixel_sigma: noise of a corner, px.
    """
    taken = np.zeros((0, dh.joints)) if taken is None else taken
    problem = _unseen(dh, lens, points, np.concatenate([taken, pool]), (T_base_camera, T_gripper_target))
    free = problem.free.copy()
    free[OFFSETS + dh.joints :] = False
    problem = replace(problem, free=free, pixel_sigma=np.full(2, pixel_sigma))
    informations = _informations(problem, np.zeros(len(free)))
    k = len(taken)
    known = _prior(problem) + informations[:k].sum(axis=0)
    worth = _place(problem)
    choice = InformationChoice(informations[k:], known, worth)
    chosen = choice.best(count)
    covariance = np.linalg.inv(known + informations[k:][list(chosen.places)].sum(axis=0))
    moves = worth.T @ covariance @ worth
    return PosePlan(
        chosen.places,
        float(np.sqrt(np.trace(moves[:3, :3]))),
        float(np.sqrt(np.trace(moves[3:, 3:]))) / LEVER,
    )


def next_poses(found: HandEye, count: int = 3, seed: int = 0, pool: Array | None = None) -> list[NextPose]:
    """The poses that would lower the error of predicted targets most, each with those before it taken.

    Args:
        found: a calibration.
        count: how many.
        seed: of the poses that are tried.
        pool: readings (n, joints) rad to choose from. Without it they are looked for where the recorded joints were
            and a little around, within the limits of the unit if the recording says which, with the target wholly in
            the image and its face to the camera; whether the arm is clear there is then for the caller to see.
    """
    recording, problem = found.recording, found.chain.problem
    x = found.chain.fit.unknowns
    if pool is None:
        pool = _pool(found, np.random.default_rng(seed))
    if not len(pool):
        return []
    unseen = _unseen(recording.dh, recording.camera, recording.points, pool, found.start)
    unseen = replace(problem, sightings=unseen.sightings)
    twists = unseen.sightings[0].evaluate(x, np.zeros_like(pool)).by_unknown[:, problem.free, :3]
    values, vectors = np.linalg.eigh(np.einsum("nui,nvi->uv", twists, twists) / len(pool))
    worth = vectors * np.sqrt(np.maximum(values, 0.0))
    choice = InformationChoice(_informations(unseen, x), found.chain.fit.information, worth)
    best = choice.best(count, exchange=False)
    return [
        NextPose(frozen(pool[place]), 1.0 - float(np.sqrt(left / best.before)))
        for place, left in zip(best.places, best.variances, strict=True)
    ]


def _unseen(dh: DhTable, lens: Camera, points: Array, joints: Array, about: tuple[Array, Array]) -> Problem:
    nothing = np.zeros((len(joints), len(points), 2))
    recording = ArmRecording(lens, dh, points, "", joints, nothing)
    return hand_eye_problem(recording, about, np.full(2, CORNER_PX), np.zeros(dh.joints))


def _informations(problem: Problem, unknowns: Array) -> Array:
    """What an image at each reading says of the free unknowns, (n, free, free)."""
    readings = problem.sightings[0].readings
    fit = ChainFit(
        unknowns, (np.zeros_like(readings),), (), 0.0, np.zeros((0, 0)), 0, 0, (np.ones(len(readings)),)
    )
    return normal_equations(problem, fit).S


def _prior(problem: Problem) -> Array:
    sigma = problem.prior_sigma.copy()
    for first in range(CAMERA, OFFSETS, 6):
        sigma[first : first + 3], sigma[first + 3 : first + 6] = UNKNOWN_LENGTH, UNKNOWN_TURN
    return np.diag(sigma[problem.free] ** -2)


def _place(problem: Problem) -> Array:
    """Worth of the camera's place: shifts, and turns at a lever."""
    worth = np.zeros((len(problem.free), 6))
    worth[CAMERA : CAMERA + 6] = np.diag([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
    return worth[problem.free]


def _pool(found: HandEye, rng: np.random.Generator) -> Array:
    """Readings (n, joints) near those of the recording at which the whole target is seen, not too obliquely."""
    r = found.recording
    low, high = r.joints.min(axis=0) - WIDER, r.joints.max(axis=0) + WIDER
    if r.unit in UNITS and len((unit := load_unit(r.unit)).lower) == r.dh.joints:
        low, high = np.maximum(low, unit.lower), np.minimum(high, unit.upper)
    chain = arm_chain(r.dh, *found.start)
    last = np.array(r.camera.size) - 1.0 - MARGIN_PX
    good = np.zeros((0, r.dh.joints))
    before = chain.evaluate(r.joints, found.chain.fit.unknowns).T
    # the printed side is the one that was seen, whichever way its z points
    side = np.sign(np.median(np.einsum("ni,ni->n", before[:, :3, 2], before[:, :3, 3])))
    for _ in range(_MOST_BATCHES):
        joints = rng.uniform(low, high, (_BATCH, r.dh.joints))
        T = chain.evaluate(joints, found.chain.fit.unknowns).T
        middle = T[:, :3, 3] + T[:, :3, :3] @ r.points.mean(axis=0)
        facing = side * np.einsum("ni,ni->n", T[:, :3, 2], middle) / np.linalg.norm(middle, axis=1)
        ahead = np.flatnonzero((facing > np.cos(OBLIQUE)) & (middle[:, 2] > 0.0))
        at = np.einsum("nij,mj->nmi", T[ahead, :3, :3], r.points) + T[ahead, None, :3, 3]
        pixels = r.camera.project(at)
        inside = ((pixels >= MARGIN_PX) & (pixels <= last)).all(axis=(1, 2))
        good = np.concatenate([good, joints[ahead[inside]]])
        if len(good) >= _POOL:
            break
    return good[:_POOL]
