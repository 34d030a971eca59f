"""What is proved no sample contradicts, what is refuted has a witness; shares of limits are those of samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from arm.controller.unit import Limits
from arms.trajectories import OVER, trajectory, world
from cell.foreign.judge import certified, peaks_of
from cell.foreign.trajectory_file import JointTrajectory


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("cubics", [True, False])
def test_what_is_proved_no_sample_contradicts_and_what_is_refuted_has_a_witness(
    seed: int, cubics: bool
) -> None:
    rng = np.random.default_rng(seed)
    points = OVER + np.cumsum(rng.normal(0.0, 0.12, (5, 6)), axis=0)
    of, cell = trajectory(points, np.arange(5.0), cubics), world()
    least = min(cell.distance(q).value for q in of.at(np.linspace(0.0, 4.0, 400))[0])
    for required in (max(least - 5e-4, 0.0), least + 5e-4):
        check = certified(cell, of.curve, required)
        assert check.proved == (least > required)
        if check.proved:
            assert check.clearance <= least + 1e-6
        else:
            witness = cell.distance(of.at(np.array([check.time]))[0][0])
            assert witness.value == pytest.approx(check.seen, abs=1e-6)
            assert check.seen < required
            assert set(witness.pair) == set(check.pair)


@pytest.mark.parametrize("seed", range(5))
def test_shares_of_limits_are_those_of_dense_samples(seed: int) -> None:
    rng = np.random.default_rng(seed)
    of = trajectory(rng.normal(0.0, 1.0, (6, 3)), np.cumsum(rng.uniform(0.2, 1.0, 6)))
    limits = Limits(*(np.full(3, v) for v in (-1.0, 1.0, 0.7, 2.0)))
    spline = CubicHermiteSpline(of.times, of.q, of.velocity)
    at = np.linspace(of.times[0], of.times[-1], 200_001)
    peaks = peaks_of(of, limits)
    q = spline(at)
    beyond = np.maximum(q.max(axis=0) - 1.0, -1.0 - q.min(axis=0))
    np.testing.assert_allclose(peaks.beyond, beyond, atol=1e-6)
    np.testing.assert_allclose(peaks.velocity, np.abs(spline(at, 1)).max(axis=0) / 0.7, rtol=1e-4)
    # accelerations jump at points: samples see the ends of pieces to within their distance
    np.testing.assert_allclose(peaks.acceleration, np.abs(spline(at, 2)).max(axis=0) / 2.0, rtol=1e-3)
    assert np.isnan(peaks_of(JointTrajectory(of.times, of.q, None), limits).acceleration).all()
