"""Noise of pose pairs: which ones count, and where errors depend on the pose."""

import numpy as np
import pytest

from calib.robot_world.noise_model import Covariances, NoiseModel
from calib.robot_world.reml import Closed, _Likelihood, fit_pairs
from calib.robot_world.solve import PosePairs, calibrate_pose_pairs
from recorded.posed_pairs import HELD, STANDING, drawn, nees, twisted, views


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
    sizes = one.covariances.prior()[:, 0]
    assert one.solve(sizes).step == pytest.approx(other.solve(sizes).step, abs=1e-12)
    assert one.solve(sizes).inverse == pytest.approx(other.solve(sizes).inverse, rel=1e-9, abs=1e-18)
    assert one(sizes)[0] == pytest.approx(other(sizes)[0], abs=1e-8)
    assert one(sizes)[1] == pytest.approx(other(sizes)[1], abs=1e-8)


@pytest.mark.slow
def test_an_arm_whose_errors_depend_on_its_pose_is_told_and_hurts_less():
    scores, with_it, without = [], [], []
    for seed in range(2):
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
