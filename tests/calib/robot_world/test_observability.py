"""Axes of motion: parallel ones are refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm.errors import CalibrationRefused
from arm.se3 import inverse
from calib.robot_world.observability import motion_axes, refuse_parallel_axes
from calib.robot_world.solve import PosePairs, calibrate_pose_pairs
from recorded.posed_pairs import HELD, STANDING, cone, twisted


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
