"""Choosing measurements by what they will tell, and poses of an arm by that."""

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import rotation, transform
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.hand_eye.next_poses import LEVER, OBLIQUE, WIDER, choose_calibration_poses, next_poses
from recorded.arm_sets import (
    LENS,
    MOUNTS,
    NOMINAL,
    PLACE,
    TARGETS,
    draw_truth,
    nominal,
    recipe,
    recorded,
    seen,
    wide,
)


def about():
    return PLACE @ transform(rotation([0.005, -0.004, 0.003]), (0.004, -0.003, 0.004)), MOUNTS[
        "perpendicular"
    ]


def test_a_plan_of_8_is_worth_more_than_16_at_random_and_keeps_its_word():
    rng = np.random.default_rng(3)
    truth, points = draw_truth(rng), TARGETS["charuco"]
    pool = wide(truth, points, 400, rng)
    plan = choose_calibration_poses(pool, 8, NOMINAL, LENS, points, *about())
    assert len(set(plan.places)) == 8
    found = calibrate_hand_eye(recorded(truth, pool[list(plan.places)], "charuco", rng))
    shift, turn = found.camera_sigma
    assert np.linalg.norm(shift) == pytest.approx(plan.sigma, rel=0.3)
    assert np.linalg.norm(turn) == pytest.approx(plan.sigma_turn, rel=0.3)
    at_random = calibrate_hand_eye(recorded(truth, pool[:16], "charuco", rng))
    assert np.linalg.norm(shift) < 0.7 * np.linalg.norm(at_random.camera_sigma[0])
    off = np.linalg.norm(found.T_base_camera[:3, 3] - truth.T_base_camera[:3, 3])
    assert off < 0.2e-3


def test_a_plan_goes_on_from_poses_that_were_taken():
    rng = np.random.default_rng(4)
    points = TARGETS["marker"]
    pool = wide(nominal("perpendicular"), points, 200, rng)
    alone = choose_calibration_poses(pool, 6, NOMINAL, LENS, points, *about())
    more = choose_calibration_poses(pool, 6, NOMINAL, LENS, points, *about(), taken=pool[list(alone.places)])
    again = choose_calibration_poses(pool, 12, NOMINAL, LENS, points, *about())
    assert more.sigma < 0.8 * alone.sigma
    assert again.sigma / 1.2 <= more.sigma <= 1.2 * again.sigma
    noisy = choose_calibration_poses(pool, 6, NOMINAL, LENS, points, *about(), pixel_sigma=0.6)
    assert noisy.sigma == pytest.approx(2.0 * alone.sigma, rel=0.1)


def test_the_lever_is_that_of_the_aims():
    assert pytest.approx(0.2e-3) == LEVER * np.radians(0.02)


@pytest.mark.slow
def test_the_next_poses_show_the_target_near_those_recorded_and_help_as_much_as_they_say():
    rng = np.random.default_rng(5)
    truth, points = draw_truth(rng), TARGETS["charuco"]
    joints = recipe(truth, points, 10, rng)
    recording = recorded(truth, joints, "charuco", rng)
    found = calibrate_hand_eye(recording)
    poses = next_poses(found)
    assert len(poses) == 3
    gains = [pose.gain for pose in poses]
    assert gains == sorted(gains)
    assert 0.0 < gains[0] < gains[-1] < 1.0
    low, high = joints.min(axis=0) - WIDER, joints.max(axis=0) + WIDER
    T = truth.T_camera_target(np.array([pose.joints for pose in poses]))
    pixels = truth.pixels(np.array([pose.joints for pose in poses]), points)
    assert ((pixels > 0) & (pixels < np.array(LENS.size) - 1)).all()
    facing = -np.einsum("ni,ni->n", T[:, :3, 2], T[:, :3, 3]) / np.linalg.norm(T[:, :3, 3], axis=1)
    assert (facing > np.cos(OBLIQUE + 0.1)).all()
    for pose in poses:
        assert ((pose.joints >= low) & (pose.joints <= high)).all()

    after = np.concatenate([joints, [pose.joints for pose in poses]])
    better = calibrate_hand_eye(recorded(truth, after, "charuco", rng))
    others = np.concatenate([joints, recipe(truth, points, 3, rng)])
    plain = calibrate_hand_eye(recorded(truth, others, "charuco", rng))
    assert predicted_sigma(better, joints) < 0.8 * predicted_sigma(plain, joints)
    assert seen(truth, joints, points).all()


def predicted_sigma(found, joints):
    s = found.chain.problem.sightings[0]
    J = replace(s, readings=joints).evaluate(found.chain.fit.unknowns).by_unknown[..., :3]
    return np.sqrt(np.mean(np.einsum("nui,uv,nvi->n", J, found.chain.covariance, J)))
