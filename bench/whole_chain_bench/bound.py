"""The linear bound of a placement: the covariance that best estimator has that knows the sizes of all errors.

All is linearised at the truth, by differences and without `calib`'s chains. Lens, print and smooth errors of the arm
are unknowns with the prior that they are drawn from; scatter of the arm is noise of the readings. The bound of the lens
is what its calibration told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from arm.se3 import Array, apply, inverse, rotation, transform
from calib.hand_eye.chain import smooth_errors
from calib.hand_eye.image_effects import lens_factor
from calib.hand_eye.tool_error import TOOL
from calib.model.intrinsics import camera_of, vector_of
from recorded.arm_sets import LENS, NOMINAL, TARGETS, Truth
from whole_chain_bench.world import FRAMES, MADE, TARGET, Placed, World

PLACE, MOUNT, ZEROS, FIRST_PRIOR = slice(0, 6), slice(6, 12), slice(12, 16), 16
STEP = 1e-6
PRINT, BIAS = 1e-3, 0.1  # standard deviations of the print's scale and of the corners' bias, px
RUNOUT, SAG = np.radians(0.01), np.radians(0.03)


def placement_bound(world: World, placed: Placed) -> Array:
    """Covariance of the offsets of all cubes of a world, (2 n, 2 n) m^2: they share the calibration and the board."""
    lens = lens_factor(placed.found.recording.camera)
    C = _calibration_bound(world, lens)
    R = placed.T_base_board[:3, :3]
    board = transform(R, placed.T_base_board[:3, 3])
    of_board, corner_noise, of_markers = _board(world, board, placed.board_corners, lens)
    T_base_camera = world.truth.T_base_camera
    rows, own, twists, marks = [], [], [], []
    for cube in placed.cubes:
        hole = placed.holes[cube.hole]
        in_camera = apply(inverse(T_base_camera), apply(board, hole))
        by_place = R.T @ T_base_camera[:3, :3] @ np.hstack([np.eye(3), -_skew(in_camera)])
        by_twist = np.hstack([np.eye(3), -_skew(hole)])
        by_joint = R.T @ _by_joint(world.truth, cube.q)
        gains = _wave_gains(cube.q[None])[0] if world.arm is not None else np.zeros((6, 0))
        G = np.hstack(
            [
                by_place,
                np.zeros((3, 6)),
                -by_joint[:, 1:5],
                by_twist @ of_board,
                np.zeros((3, 2)),
                -by_joint @ gains,
            ]
        )
        rows.append(G[:2])
        twists.append(by_twist[:2])
        marks.append((by_twist @ of_markers)[:2])
        scatter = np.zeros(6) if world.arm is None else world.arm.scatter
        own.append(MADE**2 * np.eye(2) + (by_joint * scatter**2 @ by_joint.T)[:2, :2])
    G, B, M = (np.concatenate(of) for of in (rows, twists, marks))
    shared = G @ C @ G.T + B @ corner_noise @ B.T + MADE**2 * M @ M.T
    for k, part in enumerate(own):
        shared[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += part
    return np.asarray(shared)


def _calibration_bound(world: World, lens: Array) -> Array:
    """Covariance of place, mount, zeros, lens, print and smooth errors."""
    truth, k = world.truth, lens.shape[1]
    waves = smooth_errors(NOMINAL) if world.arm is not None else []
    count = FIRST_PRIOR + k + 2 + len(waves)
    base = world.joints if world.arm is None else world.arm.joints(world.joints)
    prior = np.zeros(count)
    prior[FIRST_PRIOR : FIRST_PRIOR + k + 2] = 1.0
    if waves:
        prior[-len(waves) :] = 1.0 / np.array([_wave_variance(j, w.joint) for j, w in enumerate(waves)])

    def at(x: Array) -> Array:
        changed = _changed(truth, x)
        camera = camera_of(vector_of(LENS) + lens @ x[FIRST_PRIOR : FIRST_PRIOR + k], LENS.size)
        size, bias = x[FIRST_PRIOR + k : FIRST_PRIOR + k + 2]
        readings = base
        if waves:
            readings = base + np.einsum("njk,k->nj", _wave_gains(world.joints), x[-len(waves) :])
        T = changed.T_camera_target(readings)
        points = (1.0 + PRINT * size) * TARGETS[TARGET]
        px = camera.project(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])
        towards = px.mean(axis=1, keepdims=True) - px
        return np.asarray(px + BIAS * bias * towards / np.linalg.norm(towards, axis=-1, keepdims=True))

    J = _differences(at, np.zeros(count)).reshape(len(base), -1, count)
    noise = world.noise_px**2 * np.eye(J.shape[1])
    information = np.diag(prior)
    scatter = np.zeros(6) if world.arm is None else world.arm.scatter
    for n, of in enumerate(J):
        K = _differences(partial(_image, truth, base[n]), np.zeros(6)).reshape(-1, 6)
        information += of.T @ np.linalg.solve(noise + K * scatter**2 @ K.T, of)
    return np.asarray(np.linalg.inv(information))


def _image(truth: Truth, reading: Array, error: Array) -> Array:
    return np.asarray(truth.pixels((reading + error)[None], TARGETS[TARGET])[0])


def _changed(truth: Truth, x: Array) -> Truth:
    offsets = truth.offsets.copy()
    offsets[1:5] += x[ZEROS]
    return replace(
        truth,
        T_base_camera=truth.T_base_camera @ _moved(x[PLACE]),
        T_gripper_target=truth.T_gripper_target @ _moved(x[MOUNT]),
        offsets=offsets,
    )


def _board(world: World, T_base_board: Array, corners: Array, lens: Array) -> tuple[Array, Array, Array]:
    """Change of the board's twist by the lens (6, k), its covariance by noise (6, 6), and by the markers (6, 4)."""
    T = inverse(world.truth.T_base_camera) @ T_base_board
    points = corners.reshape(-1, 3)

    def seen(x: Array) -> Array:
        return LENS.at(np.eye(4)).project(apply(T @ _moved(x), points))

    def by_lens(u: Array) -> Array:
        return camera_of(vector_of(LENS) + lens @ u, LENS.size).project(apply(T, points))

    def by_markers(off: Array) -> Array:
        aside = np.repeat(np.column_stack([off.reshape(2, 2), np.zeros(2)]), 4, axis=0)
        return LENS.at(np.eye(4)).project(apply(T, points + aside))

    B = _differences(seen, np.zeros(6)).reshape(-1, 6)
    back = np.linalg.pinv(B)
    L = _differences(by_lens, np.zeros(lens.shape[1])).reshape(len(B), -1)
    M = _differences(by_markers, np.zeros(4)).reshape(-1, 4)
    noise = np.asarray(world.noise_px**2 / FRAMES * np.linalg.inv(B.T @ B), dtype=float)
    return -back @ L, noise, back @ M


def _by_joint(truth: Truth, q: Array) -> Array:
    """Change of the tool's tip by the joints, (3, 6) m/rad, in the base frame."""
    return _differences(lambda e: (truth.T_base_gripper((q + e)[None])[0] @ TOOL)[:3, 3], np.zeros(6))


def _wave_gains(readings: Array) -> Array:
    """Change of the joints by the smooth errors, (n, 6, k)."""
    waves = smooth_errors(NOMINAL)
    gains = np.zeros((len(readings), 6, len(waves)))
    for k, wave in enumerate(waves):
        gains[:, wave.joint, k] = wave.gain(readings)
    return gains


def _wave_variance(index: int, joint: int) -> float:
    """Variance that a smooth error is drawn with, rad^2; see `recorded.real_arms`."""
    wave = smooth_errors(NOMINAL)[index]
    of_sag = SAG**2 / 3.0
    if sum(map(bool, wave.angles)) > 1:
        share = (0.4, 1.0)[joint - 1] if wave.wave == "sine" else 0.0
        return max(float(share**2 * of_sag), 1e-18)
    own = 0.36 * of_sag if joint == 1 and wave.wave == "sine" else 0.0
    return float(RUNOUT**2 / 2.0 + own)


def _moved(twist: Array) -> Array:
    return transform(rotation(twist[3:]), twist[:3])


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _differences(function: Callable[[Array], Array], x: Array) -> Array:
    """Central differences, (..., len(x))."""
    steps = STEP * np.eye(len(x))
    return np.stack([(function(x + e) - function(x - e)) / (2.0 * STEP) for e in steps], axis=-1)
