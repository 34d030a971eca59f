"""Pairs of poses with stated errors about a known truth: what is found, how sure it claims to be, what is refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from arm.errors import CalibrationRefused, InputError
from arm.se3 import inverse, rotation, transform
from calib.robot_world.initial_guess import closed_form, initial_guess
from calib.robot_world.reml import inverses
from calib.robot_world.solve import PosePairs, calibrate_pose_pairs
from recorded.posed_pairs import HELD, STANDING, cone, drawn, nees, off, twisted, views


def photographed(seed, n=25, in_gripper=False, middle=(0.0, 0.0)):
    """Pairs whose camera poses come from 0.5 px corners of a flat target, f 920 px, by OpenCV's iterative PnP."""
    rng = np.random.default_rng(seed)
    said, seen = views(rng, n, in_gripper)
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, 5), np.linspace(-0.05, 0.05, 5))
    points = np.stack([x.ravel() + middle[0], y.ravel() + middle[1], np.zeros(x.size)], axis=1)
    K, measured = np.diag([920.0, 920.0, 1.0]), []
    for T in seen:
        start = cv2.Rodrigues(T[:3, :3])[0], T[:3, 3].reshape(3, 1).copy()
        pixels = cv2.projectPoints(points, *start, K, None)[0] + 0.5 * rng.standard_normal(
            (len(points), 1, 2)
        )
        _, r, t = cv2.solvePnP(points, pixels, K, None, *start, True, cv2.SOLVEPNP_ITERATIVE)
        measured.append(transform(rotation(r.reshape(3)), t.reshape(3)))
    return PosePairs(twisted(rng, said, 0.1e-3, 0.2e-3), np.array(measured), in_gripper)


def spoiled(pairs, seed, share, flipped):
    rng = np.random.default_rng(seed)
    wrong = rng.permutation(len(pairs.T_base_gripper)) < round(share * len(pairs.T_base_gripper))
    seen = pairs.T_camera_target.copy()
    for i in np.flatnonzero(wrong):
        seen[i, :3, :3] = seen[i, :3, :3] @ rotation(rng.uniform(0.3, 1.2, 3) * rng.choice([-1.0, 1.0], 3))
        if not flipped:
            seen[i, :3, 3] = rng.uniform(-0.5, 0.5, 3)
    return PosePairs(pairs.T_base_gripper, seen, pairs.camera_in_gripper), wrong


def shah(pairs):
    """How far the closed form is off in both shifts, m."""
    B = inverses(pairs.T_camera_target) if pairs.camera_in_gripper else pairs.T_camera_target
    X, Y = closed_form(pairs.T_base_gripper, B)
    return np.linalg.norm(np.r_[X[:3, 3] - HELD[:3, 3], Y[:3, 3] - STANDING[:3, 3]])


@pytest.mark.parametrize("in_gripper", [False, True])
def test_exact_pairs_give_the_exact_poses_under_the_right_names(in_gripper):
    said, seen = views(np.random.default_rng(3), 8, in_gripper)
    found = calibrate_pose_pairs(PosePairs(said, seen, in_gripper))
    assert found.T_held == pytest.approx(HELD, abs=1e-6)
    assert found.T_standing == pytest.approx(STANDING, abs=1e-6)
    names = ("T_gripper_camera", "T_base_target") if in_gripper else ("T_gripper_target", "T_base_camera")
    assert found.pairs.names == names
    assert found.inliers.all()


@pytest.mark.slow
@pytest.mark.parametrize("in_gripper", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_errors_along_the_cameras_axes_are_told_and_the_covariance_is_honest(in_gripper):
    found = [calibrate_pose_pairs(drawn(seed, in_gripper=in_gripper)) for seed in range(4)]
    assert sum(f.scatter.shape == "axes" for f in found) >= 3
    assert all(f.inliers.all() for f in found)
    assert 0.6 < np.mean([nees(f) for f in found]) < 1.7
    for name, size in (("camera across", 1e-3), ("camera along", 3e-3), ("camera turn", 2e-3)):
        sizes = [f.sizes[name] for f in found if f.scatter.shape == "axes"]
        assert np.median(sizes) == pytest.approx(size, rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("in_gripper", [pytest.param(False, marks=pytest.mark.slow), True])
def test_errors_of_a_targets_image_are_told_and_weighed_by_it(in_gripper):
    all_pairs = [photographed(seed, in_gripper=in_gripper) for seed in range(3)]
    found = [calibrate_pose_pairs(pairs) for pairs in all_pairs]
    assert [f.scatter.shape for f in found] == ["image"] * 3
    assert "those of a target's image" in found[0].reason
    assert np.median([f.sizes["target"] for f in found]) == pytest.approx(0.045, rel=0.35)  # half its side
    ours = np.median([np.linalg.norm(off(f)[[0, 1, 2, 6, 7, 8]]) for f in found])
    assert ours < 0.6 * np.median([shah(pairs) for pairs in all_pairs])
    assert 0.5 < np.mean([nees(f) for f in found]) < 1.8


@pytest.mark.slow
def test_a_target_whose_origin_is_its_corner_is_told():
    found = [calibrate_pose_pairs(photographed(seed, middle=(0.05, -0.05))) for seed in (11, 12)]
    assert all(f.scatter.off_centre for f in found)
    assert "whose centre is not its origin" in found[0].reason
    assert 0.7 < np.median([f.sizes["middle x"] for f in found]) < 2.0  # in halves of the target's side
    assert -2.0 < np.median([f.sizes["middle y"] for f in found]) < -0.7


@pytest.mark.few(1)
@pytest.mark.parametrize("share", [0.1, 0.5])
@pytest.mark.parametrize("flipped", [False, True])
def test_wrong_pairs_have_no_weight_and_flipped_ones_keep_their_shift(share, flipped):
    for seed in range(2):
        clean = drawn(seed, 30)
        pairs, wrong = spoiled(clean, seed + 50, share, flipped)
        found = calibrate_pose_pairs(pairs, seed)
        assert (found.inliers == ~wrong).all()
        assert (found.flipped == (wrong & flipped)).all()
        assert np.linalg.norm(off(found)[:3]) < 4e-3
        assert nees(found) < 3.0


@pytest.mark.slow
def test_pairs_that_stray_are_told_and_have_less_weight():
    rng = np.random.default_rng(5)
    said, seen = views(rng, 60, False)
    spread = np.sqrt(2.5 / rng.chisquare(2.5, 60))[:, None]
    seen = twisted(rng, seen, 1e-3 * spread, 2e-3 * spread)
    found = calibrate_pose_pairs(PosePairs(said, seen))
    assert found.scatter.freedom is not None
    assert "heavier tails" in found.reason
    assert calibrate_pose_pairs(drawn(6, 60)).scatter.freedom is None


def test_the_estimator_refuses_parallel_axes_though_a_closed_form_exists():
    R, _ = cone(1, 0, (15, 30))
    rng = np.random.default_rng(1)
    said = np.tile(np.eye(4), (20, 1, 1))
    said[:, :3, :3], said[:, :3, 3] = R, rng.uniform(-0.2, 0.2, (20, 3))
    seen = twisted(rng, inverse(STANDING) @ said @ HELD, 1e-3, 1e-3)
    with pytest.raises(CalibrationRefused) as refused:
        calibrate_pose_pairs(PosePairs(said, seen))
    assert refused.value.data["reason"] == "parallel_axes"


def test_pairs_that_do_not_belong_together_are_refused():
    pairs = drawn(7, 20)
    with pytest.raises(
        CalibrationRefused, match=r"of 20 pairs of poses agree .* read at the same time"
    ) as refused:
        calibrate_pose_pairs(PosePairs(pairs.T_base_gripper, np.roll(pairs.T_camera_target, 3, axis=0)))
    assert refused.value.data["reason"] == "no_consensus"


@pytest.mark.parametrize(
    ("count", "agree", "refused"), [(20, 7, True), (20, 8, False), (6, 3, True), (6, 4, False)]
)
def test_less_than_two_fifths_or_four_that_agree_are_no_consensus(monkeypatch, count, agree, refused):
    """However the start came by them: most of what was taken says otherwise."""
    pairs = drawn(7, count)

    def start(A, C, seed):
        found = initial_guess(A, C, seed)
        return found._replace(inliers=found.inliers & (np.arange(len(A)) < agree))

    monkeypatch.setattr("calib.robot_world.solve.initial_guess", start)
    if refused:
        with pytest.raises(
            CalibrationRefused, match=f"{agree} of {count} pairs of poses agree .* 40 % must"
        ) as told:
            calibrate_pose_pairs(pairs)
        assert told.value.data["reason"] == "no_consensus"
    else:
        assert calibrate_pose_pairs(pairs).used.any()


def test_frames_without_a_target_are_left_out_and_the_rest_is_the_same():
    pairs = drawn(8, 20)
    gaps = pairs.T_camera_target.copy()
    gaps[[3, 9]] = np.nan
    found = calibrate_pose_pairs(PosePairs(pairs.T_base_gripper, gaps))
    kept = np.delete(np.arange(20), [3, 9])
    alone = calibrate_pose_pairs(PosePairs(pairs.T_base_gripper[kept], gaps[kept]))
    assert np.flatnonzero(~found.inliers).tolist() == [3, 9]
    assert np.isnan(found.residuals[[3, 9]]).all()
    assert found.T_held == pytest.approx(alone.T_held, abs=1e-9)


def test_the_weakest_shift_has_a_name_and_its_size():
    found = calibrate_pose_pairs(drawn(9, 12))
    sizes = np.full(12, 1e-3)
    sizes[8] = 2.5e-3
    assert (
        replace(found, covariance=np.diag(sizes**2)).weakest
        == "T_base_camera: translation along z of the camera, 2.5 mm"
    )
    slanted = np.diag(sizes**2)
    slanted[0:3, 0:3] += 9e-6 * np.outer([0.6, 0.0, -0.8], [0.6, 0.0, -0.8])
    expected = "T_gripper_target: translation along (-0.60, -0.00, 0.80) of the target, 3.16 mm"
    assert replace(found, covariance=slanted).weakest.replace("-0.00", "0.00") == expected.replace(
        "-0.00", "0.00"
    )


def test_two_arrays_of_different_length_are_no_pairs():
    pairs = drawn(10, 8)
    with pytest.raises(InputError, match=r"\(8, 4, 4\) and \(7, 4, 4\)"):
        PosePairs(pairs.T_base_gripper, pairs.T_camera_target[1:])
