"""A start of robot-world calibration from pairs of poses, many of them wrong, by an arm whose zeros are wrong."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm.errors import CalibrationRefused
from arm.se3 import angle_between, inverse, rotation, transform
from calib.hand_eye.chain import OFFSETS, DhTable, arm_chain, unknown_names
from calib.robot_world.initial_guess import closed_form, initial_guess, residual_sizes

HALF = np.pi / 2
A465 = DhTable(
    np.array([0.3052, 0.0, 0.0, 0.3302, 0.0, 0.0762]),
    np.array([0.0, 0.3048, 0.0, 0.0, 0.0, 0.0]),
    np.array([HALF, 0.0, 3 * HALF, HALF, 3 * HALF, 0.0]),
    np.array([0.0, -3 * HALF, -HALF, 0.0, 0.0, 0.0]),
)
CAMERA = transform(rotation([0.3, -2.2, 0.4]), (0.5, -0.1, 1.3))
TARGET = transform(rotation([0.4, -0.2, 1.1]), (0.02, -0.03, 0.06))


def pairs(rng, n, zeros_deg=0.0, shift_m=0.0, turn_rad=0.0):
    """Poses as an arm reports them, and as a camera sees them with noise; joint zeros off by up to `zeros_deg`."""
    offsets = np.zeros(len(unknown_names(6)))
    q = np.array([0.1, -0.4, -1.6, 0.0, -0.9, 0.0]) + rng.uniform(-0.6, 0.6, (n, 6))
    chain = arm_chain(A465, np.eye(4), np.eye(4))
    said = chain.evaluate(q, offsets).T
    offsets[OFFSETS : OFFSETS + 6] = np.radians(rng.uniform(-zeros_deg, zeros_deg, 6))
    noise = np.tile(np.eye(4), (n, 1, 1))
    noise[:, :3, :3] = Rotation.from_rotvec(turn_rad * rng.standard_normal((n, 3))).as_matrix()
    noise[:, :3, 3] = shift_m * rng.standard_normal((n, 3))
    return said, inverse(CAMERA) @ chain.evaluate(q, offsets).T @ TARGET @ noise


def spoiled(rng, seen, share):
    """A share of the poses anywhere, half of them only turned (as a flipped marker is)."""
    wrong = rng.permutation(len(seen)) < round(share * len(seen))
    seen = seen.copy()
    for k, i in enumerate(np.flatnonzero(wrong)):
        seen[i, :3, :3] = seen[i, :3, :3] @ rotation(rng.uniform(0.3, 1.2, 3) * rng.choice([-1.0, 1.0], 3))
        if k % 2:
            seen[i, :3, 3] += rng.normal(0.0, 0.3, 3)
    return seen, wrong


def off_by(start):
    return np.linalg.norm(start.T_base_camera[:3, 3] - CAMERA[:3, 3]), angle_between(
        start.T_base_camera[:3, :3], CAMERA[:3, :3]
    )


def test_exact_pairs_give_the_exact_poses_and_nothing_is_thrown_away():
    rng = np.random.default_rng(1)
    said, seen = pairs(rng, 12)
    start = initial_guess(said, seen)
    assert start.T_base_camera == pytest.approx(CAMERA, abs=1e-9)
    assert start.T_gripper_target == pytest.approx(TARGET, abs=1e-9)
    assert start.inliers.all()
    X, Y = closed_form(said, seen)  # the frames are those of A X = Y B
    assert np.max(residual_sizes(said, seen, X, Y)) < 1e-7


def test_a_camera_in_the_gripper_is_the_same_with_the_inverse_poses():
    said, seen = pairs(np.random.default_rng(2), 12)
    # the roles change: a camera where the target is, and a target where the camera stands
    start = initial_guess(said, np.array([inverse(T) for T in np.linalg.inv(seen)]))
    assert start.T_gripper_target == pytest.approx(TARGET, abs=1e-9)


@pytest.mark.few(2)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("n", [30, 270])
def test_wrong_poses_are_found_though_the_arms_zeros_are_wrong(n, share):
    for seed in range(2):
        rng = np.random.default_rng((seed, n))
        said, seen = pairs(rng, n, 0.3, 0.5e-3, 2e-3)
        seen, wrong = spoiled(rng, seen, share)
        start = initial_guess(said, seen, seed)
        assert not (start.inliers & wrong).any()
        assert (start.inliers | wrong).mean() > 0.95
        of_these, _ = closed_form(said[start.inliers], seen[start.inliers])
        assert start.T_gripper_target == pytest.approx(of_these, abs=1e-9)
        shift, turn = off_by(start)
        assert shift < 0.015  # as far as such zeros put the closed form off without any wrong pose
        assert np.degrees(turn) < 1.0


def test_the_same_seed_gives_the_same_start():
    rng = np.random.default_rng(3)
    said, seen = pairs(rng, 30, 0.3, 1e-3, 3e-3)
    seen, _ = spoiled(rng, seen, 0.4)
    one, other = (initial_guess(said, seen, 7) for _ in range(2))
    assert np.array_equal(one.T_base_camera, other.T_base_camera)
    assert np.array_equal(one.inliers, other.inliers)


def test_too_few_pairs_are_refused_with_their_number():
    said, seen = pairs(np.random.default_rng(4), 2)
    with pytest.raises(CalibrationRefused, match=r"2 pairs of poses .* at least 3") as refused:
        initial_guess(said, seen)
    assert refused.value.data == {"reason": "few_pairs", "pairs": 2, "fewest": 3}


def test_an_arm_that_never_turned_is_refused():
    said, seen = pairs(np.random.default_rng(5), 1)
    with pytest.raises(CalibrationRefused, match="must rotate about different axes") as refused:
        initial_guess(np.repeat(said, 8, axis=0), np.repeat(seen, 8, axis=0))
    assert refused.value.data == {"reason": "degenerate", "pairs": 8}


def test_a_pose_that_is_not_there_is_no_inlier():
    said, seen = pairs(np.random.default_rng(6), 12)
    seen[3] = np.nan
    assert np.flatnonzero(~initial_guess(said, seen).inliers).tolist() == [3]
