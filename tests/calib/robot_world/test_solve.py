"""Pairs of poses with stated errors about a known truth: what is found, how sure it claims to be, what is refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

from arm.errors import CalibrationRefused, InputError
from arm.se3 import inverse, rotation, transform
from calib.robot_world.initial_guess import closed_form, initial_guess
from calib.robot_world.noise_model import Covariances, NoiseModel
from calib.robot_world.observability import motion_axes, refuse_parallel_axes
from calib.robot_world.reml import Closed, _Likelihood, fit_pairs, inverses, moved
from calib.robot_world.solve import PosePairs, calibrate_pose_pairs

HELD = transform(rotation([0.2, -0.3, 0.8]), (0.03, -0.02, 0.08))
STANDING = transform(rotation([3.0, 0.3, 0.2]), (0.5, 0.1, 0.9))
SHAPES = (NoiseModel(), NoiseModel("image"), NoiseModel("image", off_centre=True), NoiseModel(geometry=True))


def twisted(rng, T, shift, turn):
    """T times small random motions, of sizes in m and rad, per axis or for all."""
    noise = np.tile(np.eye(4), (len(T), 1, 1))
    noise[:, :3, :3] = Rotation.from_rotvec(rng.standard_normal((len(T), 3)) * turn).as_matrix()
    noise[:, :3, 3] = rng.standard_normal((len(T), 3)) * shift
    return T @ noise


def views(rng, n, in_gripper):
    """T_base_gripper and T_camera_target without error: the target 0.4 to 0.8 m away, tilted up to 45 deg, any roll."""
    seen = np.tile(np.eye(4), (n, 1, 1))
    tilt = Rotation.from_rotvec(np.c_[rng.uniform(-0.6, 0.6, (n, 2)), np.zeros(n)])
    roll = Rotation.from_rotvec(np.c_[np.zeros((n, 2)), rng.uniform(-np.pi, np.pi, n)])
    seen[:, :3, :3] = (Rotation.from_rotvec([np.pi, 0.0, 0.0]) * tilt * roll).as_matrix()
    seen[:, :3, 3] = np.c_[rng.uniform(-0.08, 0.08, (n, 2)), rng.uniform(0.4, 0.8, n)]
    if in_gripper:
        return STANDING @ inverses(HELD @ seen), seen
    return STANDING @ seen @ inverse(HELD), seen


def drawn(seed, n=20, in_gripper=False, across=1e-3, along=3e-3, turn=2e-3, arm=(0.2e-3, 0.3e-3)):
    """Pairs whose camera errs along its axes and whose arm errs about the flange."""
    rng = np.random.default_rng(seed)
    said, seen = views(rng, n, in_gripper)
    seen = twisted(rng, seen, 0.0, turn)
    seen[:, :3, 3] += rng.standard_normal((n, 3)) * (across, across, along)
    return PosePairs(twisted(rng, said, *arm), seen, in_gripper)


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


def off(found):
    """Twists (12,) from what was found to the truth."""
    E = [inverse(found.T_held) @ HELD, inverse(found.T_standing) @ STANDING]
    return np.concatenate([np.r_[e[:3, 3], Rotation.from_matrix(e[:3, :3]).as_rotvec()] for e in E])


def nees(found):
    return off(found) @ np.linalg.solve(found.covariance, off(found)) / 12.0


def shah(pairs):
    """How far the closed form is off in both shifts, m."""
    B = inverses(pairs.T_camera_target) if pairs.camera_in_gripper else pairs.T_camera_target
    X, Y = closed_form(pairs.T_base_gripper, B)
    return np.linalg.norm(np.r_[X[:3, 3] - HELD[:3, 3], Y[:3, 3] - STANDING[:3, 3]])


@pytest.mark.parametrize("in_gripper", [False, True])
def test_derivatives_of_the_predicted_pose_are_those_of_finite_differences(in_gripper):
    rng = np.random.default_rng(1)
    said, seen = views(rng, 6, in_gripper)
    P, Q = (HELD, STANDING) if in_gripper else (STANDING, HELD)
    at = Closed(said, seen, in_gripper).linearised(P, Q)
    assert np.abs(at.residuals).max() < 1e-9
    for k, step in enumerate(1e-6 * np.eye(12)):
        then = Closed(said, seen, in_gripper).linearised(moved(P, step[:6]), moved(Q, step[6:]))
        assert -then.residuals / 1e-6 == pytest.approx(at.by_unknowns[:, :, k], abs=1e-5)
    for k, step in enumerate(1e-6 * np.eye(6)):
        arm = said @ transform(rotation(step[3:]), step[:3])
        then = Closed(arm, seen, in_gripper).linearised(P, Q)
        assert -then.residuals / 1e-6 == pytest.approx(at.by_arm[:, :, k], abs=1e-5)


@pytest.mark.parametrize("scatter", SHAPES)
def test_the_gradient_of_the_likelihood_is_that_of_finite_differences(scatter):
    pairs = drawn(2, 9)
    rows = np.ones((9, 6), dtype=bool)
    rows[2, 3:] = rows[4] = False
    at = Closed(pairs.T_base_gripper, pairs.T_camera_target, False).linearised(STANDING, HELD)
    likelihood = _Likelihood(Covariances(scatter, at), rows, np.linspace(0.4, 1.4, 9))
    sizes = likelihood.covariances.typical()[0] + 0.2
    expected = approx_fprime(sizes, lambda s: likelihood(s)[0], 1e-6)
    assert likelihood(sizes)[1] == pytest.approx(expected, rel=1e-4, abs=1e-3)


def test_pairs_that_are_not_used_are_as_if_they_had_not_been_given():
    pairs, used = drawn(4, 14), np.ones(14, dtype=bool)
    used[[2, 7]] = False
    one, other = (
        _Likelihood(
            Covariances(
                NoiseModel(),
                Closed(pairs.T_base_gripper[k], pairs.T_camera_target[k], False).linearised(STANDING, HELD),
            ),
            np.repeat(used[k, None], 6, axis=1),
            np.ones(len(used[k])),
        )
        for k in (np.arange(14), np.flatnonzero(used))
    )
    sizes = one.covariances.typical()[0]
    assert one.solve(sizes).step == pytest.approx(other.solve(sizes).step, abs=1e-12)
    assert one.solve(sizes).inverse == pytest.approx(other.solve(sizes).inverse, rel=1e-9, abs=1e-18)
    assert one(sizes)[0] == pytest.approx(other(sizes)[0], abs=1e-8)
    assert one(sizes)[1] == pytest.approx(other(sizes)[1], abs=1e-8)


@pytest.mark.parametrize("in_gripper", [False, True])
def test_exact_pairs_give_the_exact_poses_under_the_right_names(in_gripper):
    said, seen = views(np.random.default_rng(3), 8, in_gripper)
    found = calibrate_pose_pairs(PosePairs(said, seen, in_gripper))
    assert found.T_held == pytest.approx(HELD, abs=1e-6)
    assert found.T_standing == pytest.approx(STANDING, abs=1e-6)
    names = ("T_gripper_camera", "T_base_target") if in_gripper else ("T_gripper_target", "T_base_camera")
    assert found.pairs.names == names
    assert found.inliers.all()


@pytest.mark.parametrize("in_gripper", [False, True])
def test_errors_along_the_cameras_axes_are_told_and_the_covariance_is_honest(in_gripper):
    found = [calibrate_pose_pairs(drawn(seed, in_gripper=in_gripper)) for seed in range(4)]
    assert sum(f.scatter.shape == "axes" for f in found) >= 3
    assert all(f.inliers.all() for f in found)
    assert 0.6 < np.mean([nees(f) for f in found]) < 1.7
    for name, size in (("camera across", 1e-3), ("camera along", 3e-3), ("camera turn", 2e-3)):
        sizes = [f.sizes[name] for f in found if f.scatter.shape == "axes"]
        assert np.median(sizes) == pytest.approx(size, rel=0.25)


@pytest.mark.parametrize("in_gripper", [False, True])
def test_errors_of_a_targets_image_are_told_and_weighed_by_it(in_gripper):
    all_pairs = [photographed(seed, in_gripper=in_gripper) for seed in range(3)]
    found = [calibrate_pose_pairs(pairs) for pairs in all_pairs]
    assert [f.scatter.shape for f in found] == ["image"] * 3
    assert "those of a target's image" in found[0].reason
    assert np.median([f.sizes["target"] for f in found]) == pytest.approx(0.045, rel=0.35)  # half its side
    ours = np.median([np.linalg.norm(off(f)[[0, 1, 2, 6, 7, 8]]) for f in found])
    assert ours < 0.6 * np.median([shah(pairs) for pairs in all_pairs])
    assert 0.5 < np.mean([nees(f) for f in found]) < 1.8


def test_a_target_whose_origin_is_its_corner_is_told():
    found = [calibrate_pose_pairs(photographed(seed, middle=(0.05, -0.05))) for seed in (11, 12)]
    assert all(f.scatter.off_centre for f in found)
    assert "whose centre is not its origin" in found[0].reason
    assert 0.7 < np.median([f.sizes["middle x"] for f in found]) < 2.0  # in halves of the target's side
    assert -2.0 < np.median([f.sizes["middle y"] for f in found]) < -0.7


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


def test_pairs_that_stray_are_told_and_have_less_weight():
    rng = np.random.default_rng(5)
    said, seen = views(rng, 60, False)
    spread = np.sqrt(2.5 / rng.chisquare(2.5, 60))[:, None]
    seen = twisted(rng, seen, 1e-3 * spread, 2e-3 * spread)
    found = calibrate_pose_pairs(PosePairs(said, seen))
    assert found.scatter.freedom is not None
    assert "heavier tails" in found.reason
    assert calibrate_pose_pairs(drawn(6, 60)).scatter.freedom is None


def test_an_arm_whose_errors_depend_on_its_pose_is_told_and_hurts_less():
    scores, with_it, without = [], [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        said, seen = views(rng, 40, False)
        stretch = 0.01 * rng.standard_normal((3, 3))  # some 1 mm where the arm works
        bent = said.copy()
        bent[:, :3, 3] += (said[:, :3, 3] - said[:, :3, 3].mean(axis=0)) @ stretch.T
        pairs = PosePairs(bent, twisted(rng, seen, 0.3e-3, 0.5e-3))
        found = calibrate_pose_pairs(pairs)
        assert found.scatter.geometry
        assert "vary smoothly with its pose" in found.reason
        scores.append(nees(found))
        with_it.append(np.linalg.norm(found.T_held[:3, 3] - HELD[:3, 3]))
        closed = Closed(bent, pairs.T_camera_target, False)
        rigid = fit_pairs(closed, STANDING, HELD, NoiseModel(), np.ones((40, 2), dtype=bool))
        without.append(np.linalg.norm(rigid.Q[:3, 3] - HELD[:3, 3]))
    assert np.mean(scores) < 2.5
    assert np.mean(with_it) < 0.7 * np.mean(without)


def cone(seed, half_deg, turns_deg, n=20):
    """R_base_gripper of motions about axes in a cone, either way round."""
    rng = np.random.default_rng(seed)
    main, R = Rotation.random(random_state=rng), [Rotation.random(random_state=rng)]
    for _ in range(n - 1):
        z, around = rng.uniform(np.cos(np.radians(half_deg)), 1.0), rng.uniform(-np.pi, np.pi)
        axis = main.apply([np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around), z])
        R.append(
            R[-1] * Rotation.from_rotvec(axis * np.radians(rng.uniform(*turns_deg)) * rng.choice([-1, 1]))
        )
    return np.array([r.as_matrix() for r in R]), main.apply([0.0, 0.0, 1.0])


@pytest.mark.parametrize("turns_deg", [(3, 8), (15, 30)])
def test_motions_about_one_axis_are_refused_and_wide_cones_are_not(turns_deg):
    for seed in range(10):
        for half in (0, 2, 10):
            R, main = cone(seed, half, turns_deg)
            with pytest.raises(CalibrationRefused, match="rotated about one axis only") as refused:
                refuse_parallel_axes(R)
            assert refused.value.data["reason"] == "parallel_axes"
            assert abs(main @ refused.value.data["axis"]) > 0.95
        for half in (30, 45, 90):
            assert not motion_axes(cone(seed, half, turns_deg)[0]).degenerate


def test_a_dense_stream_is_not_taken_for_many_axes_because_of_its_noise():
    rng = np.random.default_rng(2)
    turned = Rotation.from_rotvec(np.outer(np.radians(np.arange(0.0, 40.0, 0.1)), [0.0, 0.6, 0.8]))
    R = (turned * Rotation.from_rotvec(1e-3 * rng.standard_normal((400, 3)))).as_matrix()
    axes = motion_axes(R)
    assert axes.degenerate
    assert axes.motions < 20
    assert abs(axes.main @ [0.0, 0.6, 0.8]) > 0.999


def test_an_arm_that_hardly_turned_has_no_axes():
    R = Rotation.from_rotvec(0.01 * np.random.default_rng(3).standard_normal((20, 3))).as_matrix()
    assert motion_axes(R).degenerate


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


def test_wrong_pairs_do_not_lend_their_axes_to_the_right_ones():
    """All pairs together turn about many axes, those that are right about one: the translation along it is unknown."""
    R, _ = cone(1, 0, (15, 30))
    rng = np.random.default_rng(1)
    said = np.tile(np.eye(4), (26, 1, 1))
    said[:20, :3, :3], said[:, :3, 3] = R, rng.uniform(-0.2, 0.2, (26, 3))
    said[20:, :3, :3] = Rotation.random(6, random_state=5).as_matrix()
    seen = twisted(rng, inverse(STANDING) @ said @ HELD, 1e-3, 1e-3)
    seen[20:, :3, 3] = rng.uniform(-0.5, 0.5, (6, 3))
    seen[20:, :3, :3] = Rotation.random(6, random_state=6).as_matrix()
    refuse_parallel_axes(said[:, :3, :3])
    with pytest.raises(CalibrationRefused, match="rotated about one axis only") as told:
        calibrate_pose_pairs(PosePairs(said, seen))
    assert told.value.data["reason"] == "parallel_axes"


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
