"""The arm's chain by its Denavit-Hartenberg numbers, and what a fixed camera says of its errors."""

import numpy as np
import pytest

from arm.robot.model import load_a465
from arm.se3 import frozen, inverse, rot_z, rotation, transform
from calib.chain.fit import Problem, Sightings, fit_chains
from calib.hand_eye import chain
from calib.hand_eye.chain import OFFSETS, DhTable, arm_chain, free_pose, unknown_names
from vision.camera.model import Camera

HALF = np.pi / 2
A465 = DhTable(
    np.array([0.3052, 0.0, 0.0, 0.3302, 0.0, 0.0762]),
    np.array([0.0, 0.3048, 0.0, 0.0, 0.0, 0.0]),
    np.array([HALF, 0.0, 3 * HALF, HALF, 3 * HALF, 0.0]),
    np.array([0.0, -3 * HALF, -HALF, 0.0, 0.0, 0.0]),
)
NAMES = unknown_names(6)
NOTHING = np.zeros(len(NAMES))
CAMERA = Camera(
    np.array([[4746.0, 0, 1072], [0, 4738.0, 533], [0, 0, 1]]), np.zeros(5), (1920, 1200), frozen(np.eye(4))
)
MOUNT = transform(rotation([0.1, 0.2, 0.3]), (0.01, -0.02, 0.06))
TARGET = frozen([(0.012 * i, 0.012 * j, 0.0) for i in range(1, 7) for j in range(1, 5)])


def test_the_chain_is_the_arm_of_the_planner():
    robot = load_a465(0.134112, 0.06)
    chain = arm_chain(A465, np.eye(4), np.eye(4))
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.5, 1.5, (20, 6))
    flange = chain.evaluate(q, NOTHING).T
    fixed = [inverse(T) @ robot.T_base_tool(one) for T, one in zip(flange, q, strict=True)]
    # base and tool frames may be named otherwise, but by one and the same transform for every configuration
    for T in fixed:
        assert pytest.approx(fixed[0], abs=1e-9) == T


def pictured(seed: int, count: int = 40, offsets=(0.0, 0.004, -0.003, 0.005, -0.004, 0.0)):
    """A target on the flange before the camera, with joint offsets; about a first guess that is 20 mm, 1 deg off."""
    rng = np.random.default_rng(seed)
    truth = NOTHING.copy()
    truth[OFFSETS : OFFSETS + 6] = offsets
    q = np.array([0.1, -0.4, -1.6, 0.0, -0.9, 0.0]) + rng.uniform(-0.5, 0.5, (count, 6))
    to_flange = arm_chain(A465, np.eye(4), MOUNT).evaluate(q, truth).T
    middle = to_flange[:, :3, 3].mean(axis=0)
    place = transform(rotation([np.pi, 0.0, 0.0]) @ rot_z(0.3), middle + (0.02, 0.01, 1.1))
    T = arm_chain(A465, place, MOUNT).evaluate(q, truth).T
    points = np.einsum("nij,mj->nmi", T[:, :3, :3], TARGET) + T[:, None, :3, 3]
    pixels = CAMERA.project(points) + 0.3 * rng.standard_normal((count, len(TARGET), 2))
    guess = place @ transform(rotation([0.01, -0.015, 0.01]), (0.02, -0.01, 0.01))
    return q, pixels, place, guess, truth


def test_place_mount_and_offsets_are_found_with_their_covariance():
    q, pixels, place, guess, truth = pictured(2)
    count = len(q)
    free = np.zeros(len(NAMES), dtype=bool)
    free[: OFFSETS + 6] = True
    free[[OFFSETS, OFFSETS + 5]] = False  # these slide into the place and the mount
    ids = np.tile(np.arange(count)[:, None], (1, 6))
    sightings = Sightings(arm_chain(A465, guess, MOUNT), q, ids, np.arange(count), TARGET, pixels)
    problem = Problem(
        [sightings], CAMERA, NOTHING, np.full(len(NAMES), np.inf), np.full(2, 0.3), np.zeros(6), free
    )
    fit = fit_chains(problem)
    assert fit.chi2_dof == pytest.approx(1.0, abs=0.1)
    assert fit.iterations <= 8
    found = free_pose(guess, chain.CAMERA, fit.unknowns).T[0]
    mount = free_pose(MOUNT, chain.TARGET, fit.unknowns).T[0]
    assert np.linalg.norm(found[:3, 3] - place[:3, 3]) < 0.5e-3
    assert mount == pytest.approx(MOUNT, abs=1e-3)
    sigma = np.sqrt(np.diag(fit.covariance(free)))[OFFSETS : OFFSETS + 6]
    off = (fit.unknowns - truth)[OFFSETS : OFFSETS + 6]
    assert (np.abs(off) <= 4.0 * sigma).all()
    assert np.degrees(sigma.max()) < 0.02

    rigid = free.copy()
    rigid[OFFSETS : OFFSETS + 6] = False
    alone = fit_chains(
        Problem([sightings], CAMERA, NOTHING, problem.prior_sigma, problem.pixel_sigma, np.zeros(6), rigid)
    )
    assert alone.chi2_dof > 5.0


def test_unknowns_have_names():
    assert len(NAMES) == 12 + 6 + 18
    assert NAMES[OFFSETS + 1] == "J2 offset"
    assert NAMES[-1] == "J6 alpha"
