"""What is proved no sample contradicts, what is refuted has a witness; shares of limits are those of samples."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from arm.controller.unit import Limits
from arms.trajectories import OVER, START, trajectory, world
from cell.foreign.judge import Asked, certified, first_lost, peaks_of, refusal_of
from cell.foreign.trajectory_file import JointTrajectory


@pytest.mark.few(3)
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
    assert peaks_of(JointTrajectory(of.times, of.q, None), limits).acceleration is None


def test_the_moment_of_a_refusal_is_the_first_at_which_the_clearance_is_seen_to_be_lost() -> None:
    of, cell = trajectory([START, OVER, START], [0.0, 20.0, 40.0]), world()
    times = np.linspace(0.0, 40.0, 4001)
    distances = np.array([cell.distance(q).value for q in of.at(times)[0]])
    required = (
        (distances[0] + distances.min()) / 2.0
        if distances[0] > distances.min() + 1e-4
        else distances[0] + 1e-3
    )
    check = certified(cell, of.curve, required)
    assert not check.proved
    first = first_lost(cell, of, required, check)
    expected = times[np.flatnonzero(distances < required)[0]]
    assert first.time == pytest.approx(expected, abs=0.011)
    assert first.seen < required


@pytest.mark.parametrize(
    ("lasts", "speed", "advice"),
    [
        (4.0, 0.1, r"make the trajectory [\d.]+ times as slow, or give --speed 0\.\d+; its clearance"),
        (0.5, 0.5, "as slow; its"),
    ],
)
def test_a_limit_is_told_with_what_suffices_and_with_the_clearance(
    tmp_path: Path, lasts: float, speed: float, advice: str
) -> None:
    of, cell = trajectory([START, START + 0.1], [0.0, lasts]), world()
    limits = Limits(np.full(6, -9.0), np.full(6, 9.0), np.full(6, 0.3), np.full(6, 3.0))
    asked, check = Asked(0.01, speed, True), certified(cell, of.curve, 0.01)
    refused = refusal_of(tmp_path, list("abcdef"), asked, peaks_of(of, limits.scaled(speed)), check)
    assert refused is not None
    assert re.search(advice, str(refused)), refused
    if found := re.search(r"--speed ([\d.]+)", str(refused)):
        enough = replace(asked, speed=float(found[1]))
        assert (
            refusal_of(tmp_path, list("abcdef"), enough, peaks_of(of, limits.scaled(enough.speed)), check)
            is None
        )
    slower = float(re.search(r"([\d.]+) times", str(refused))[1])  # type: ignore[index]
    slow = trajectory([START, START + 0.1], [0.0, slower * lasts])
    assert refusal_of(tmp_path, list("abcdef"), asked, peaks_of(slow, limits.scaled(speed)), check) is None


def test_times_in_another_unit_are_told_as_such(tmp_path: Path) -> None:
    limits = Limits(*np.array([[-3.0], [3.0], [9.0], [9.0]]) * np.ones(6))
    for lasts, fast, slow in (
        (4e-6, True, False),
        (4.0, False, False),
        (4000.0, False, True),
        (40.0, False, False),
    ):
        of = trajectory([START, START + 0.1], [0.0, lasts])
        peaks, check = peaks_of(of, limits), certified(world(), of.curve, 0.0)
        refused = refusal_of(tmp_path, list("abcdef"), Asked(0.0, 1.0, True), peaks, check)
        assert ("it lasts 4e-06 s: are its times in another unit?" in str(refused)) == fast, refused
        assert ("it lasts 4000 s, and no joint needs more than 0.0" in peaks.slow()) == slow, peaks.slow()
        assert bool(peaks.slow()) == slow


def test_a_trajectory_that_does_not_move_is_told() -> None:
    limits = Limits(*np.array([[-3.0], [3.0], [9.0], [9.0]]) * np.ones(6))
    for by, told in ((0.0, True), (1e-3, False)):
        of = trajectory([START, START + by], [0.0, 4.0])
        assert ("no joint moves" in peaks_of(of, limits).slow()) == told


@pytest.mark.parametrize(
    ("joint", "value", "told"),
    [
        (0, 0.5 + 2.0 * np.pi, " (less a whole turn it would be within)"),
        (0, -0.5 - 2.0 * np.pi, " (less a whole turn it would be within)"),
        (1, 60.0, " (a thousandth would be within: positions are in rad, m where a joint slides)"),
        (0, 120.0, " (are these degrees? positions are in rad)"),
        (0, 3.5, ""),
        (1, 0.15, ""),
    ],
)
def test_what_positions_beyond_their_limits_may_be_is_told(joint: int, value: float, told: str) -> None:
    limits = Limits(np.array([-2.5, -0.1]), np.array([2.5, 0.1]), np.full(2, 9.0), np.full(2, 9.0))
    q = np.zeros((2, 2))
    q[:, joint] = value
    assert peaks_of(trajectory(q, [0.0, 4.0]), limits).meant == told


def test_velocities_in_degrees_are_told_as_such(tmp_path: Path) -> None:
    limits = Limits(*np.array([[-3.0], [3.0], [0.5], [9.0]]) * np.ones(6))
    of = trajectory([START, START + 0.1, START + 0.2], [0.0, 1.0, 2.0])
    for factor, told in ((np.degrees(1.0), True), (1.0, False)):
        velocity = np.stack([np.zeros(6), np.full(6, 0.1), np.zeros(6)]) * factor
        stated = replace(of, velocity=velocity)
        check = certified(world(), stated.curve, 0.0)
        refused = refusal_of(tmp_path, list("abcdef"), Asked(0.0, 1.0, True), peaks_of(stated, limits), check)
        assert (
            "are the velocities in deg/s? They are 57 times those from point to point" in str(refused)
        ) == told


def test_velocities_against_the_motion_or_all_0_are_told() -> None:
    limits = Limits(*np.array([[-3.0], [3.0], [9.0], [9.0]]) * np.ones(6))
    of = trajectory([START, START + 0.1, START + 0.2], [0.0, 1.0, 2.0])
    for factor, told in ((-1.0, "other sign? They are against"), (0.0, "inner points are 0"), (1.0, "")):
        velocity = np.stack([np.zeros(6), np.full(6, 0.1), np.zeros(6)]) * factor
        peaks = peaks_of(replace(of, velocity=velocity), limits)
        assert told in peaks.in_deg()
        assert bool(peaks.in_deg()) == bool(told)
        assert ("other sign" in peaks.slow()) == (factor < 0.0)


def test_positions_in_degrees_are_told_as_such(tmp_path: Path) -> None:
    limits = Limits(*np.array([[-3.0], [3.0], [9.0], [9.0]]) * np.ones(6))
    for factor, told in ((np.degrees(1.0), True), (4.0, False)):
        of = trajectory(factor * np.array([START, START + 0.1]), [0.0, 4.0])
        check = certified(world(), of.curve, 0.0)
        refused = refusal_of(tmp_path, list("abcdef"), Asked(0.0, 1.0, True), peaks_of(of, limits), check)
        assert ("(are these degrees? positions are in rad)" in str(refused)) == told, refused
