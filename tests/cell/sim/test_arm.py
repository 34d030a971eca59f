"""Errors of the true arm: each has the stated size, and follows what it should."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.robot.model import load_a465
from cell.files.world import World
from cell.sim.arm import Arrival, JointErrors, leverage
from pictures.rendered import changed, world_with

SIX = np.ones(6)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return world_with(tmp_path, "seed = 3\nbuild_seed = 7\n")


def test_an_arm_without_keys_has_no_errors(world: World) -> None:
    errors = JointErrors(world)
    assert not errors.depends_on_arrival
    assert not errors.at(SIX, Arrival(50, (1,) * 6), 10**6).any()


def test_scatter_is_drawn_once_for_each_arrival(world: World) -> None:
    errors = JointErrors(changed(world, "arm", scatter=1e-4 * SIX))
    assert errors.depends_on_arrival
    drawn = np.array([errors.at(SIX, Arrival(ms), 0) for ms in range(0, 40000, 100)])
    assert drawn.std(axis=0) == pytest.approx(1e-4 * SIX, rel=0.12)
    assert np.abs(drawn.mean(axis=0)).max() < 2e-5
    assert np.array_equal(errors.at(0 * SIX, Arrival(300), 900), drawn[3])


def test_errors_are_those_of_the_arm_and_those_of_an_arrival(world: World) -> None:
    errors = JointErrors(changed(world, "arm", scatter=1e-4 * SIX, backlash=1e-3 * SIX, eccentricity=SIX))
    arrival = Arrival(70, (1, -1, 0, 1, 1, -1))
    backlash, scatter = errors.of_arrival(arrival)
    assert backlash == pytest.approx(-0.5e-3 * np.array(arrival.directions))
    assert np.array_equal(errors.at(SIX, arrival, 900), errors.steady(SIX, 900) + backlash + scatter)


def test_eccentricity_repeats_once_per_turn_and_belongs_to_the_arm(world: World) -> None:
    amplitude = 1e-3 * np.arange(1, 7)
    errors = JointErrors(changed(world, "arm", eccentricity=amplitude))
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    seen = np.array([errors.at(q * SIX, Arrival(), 0) for q in turn])
    assert np.abs(seen).max(axis=0) == pytest.approx(amplitude, rel=1e-3)
    assert seen[0] == pytest.approx(seen[-1], abs=1e-12)
    assert seen[90] == pytest.approx(-seen[270], abs=1e-12)
    phases = np.abs(seen).argmax(axis=0)
    assert len(set(phases)) > 3


def test_gravity_pulls_the_wrist_down_in_proportion_to_its_lever(world: World) -> None:
    robot, rng = load_a465(0.134112, 0.06), np.random.default_rng(5)

    def height(q: np.ndarray) -> float:
        return float(robot.joint_poses(q)[5][2, 3])

    errors = JointErrors(changed(world, "arm", sag=np.array([1e-3, 5e-4])))
    for _ in range(20):
        q, h = rng.uniform(-1.5, 1.5, 6), 1e-6
        slopes = [(height(q + h * e) - height(q - h * e)) / (2 * h) for e in np.eye(6)[1:3]]
        assert -leverage(q) * (0.3048 + 0.3302, 0.3302) == pytest.approx(slopes, abs=1e-6)
        sag = errors.at(q, Arrival(), 0)
        assert sag[1:3] == pytest.approx(leverage(q) * (1e-3, 5e-4))
        assert not sag[[0, 3, 4, 5]].any()
        assert height(q + 0.1 * sag) < height(q)


def test_backlash_lags_behind_the_last_motion_by_half_of_it(world: World) -> None:
    errors = JointErrors(changed(world, "arm", backlash=2e-3 * SIX))
    assert errors.at(SIX, Arrival(5, (1, -1, 0, 1, -1, 0)), 0) == pytest.approx(
        [-1e-3, 1e-3, 0, -1e-3, 1e-3, 0]
    )


def test_a_warm_arm_has_other_zeros(world: World) -> None:
    errors = JointErrors(changed(world, "arm", warm_up=1e-3 * SIX, warm_up_s=100.0))
    at = [errors.at(SIX, Arrival(), ms)[0] for ms in (0, 100_000, 10**7)]
    assert at == pytest.approx([0.0, 1e-3 * (1 - np.exp(-1)), 1e-3])


def test_errors_along_motions_are_those_of_arrivals_at_their_ends_and_change_steadily_between(
    world: World,
) -> None:
    arm = changed(
        world, "arm", scatter=1e-4 * SIX, backlash=1e-3 * SIX, eccentricity=1e-4 * SIX, sag=1e-3 * SIX[:2]
    )
    errors = JointErrors(changed(arm, "arm", warm_up=1e-3 * SIX, warm_up_s=2.0))
    times = np.concatenate([np.arange(5, 605), np.arange(2000, 2400)])
    q = np.sin(times[:, None] / 200.0 + np.arange(6)) * SIX
    q[:, 5] = 0.3  # never moves
    found = errors.along(q, times)
    for end in (599, 999):
        directions = tuple(int(s) for s in np.sign(q[end] - q[end - 1]))
        assert found[end] == pytest.approx(
            errors.at(q[end], Arrival(int(times[end]), directions), int(times[end]))
        )
    lagging = errors.steady(q, times) - found
    drawn = [errors.of_arrival(Arrival(ms))[1] for ms in (0, 604, 2399)]
    assert -lagging[0, 5] == pytest.approx(drawn[0][5])
    assert -lagging[300, 5] == pytest.approx((drawn[0] + drawn[1])[5] / 2.0, abs=1e-6)
    assert -lagging[600, 5] == pytest.approx(drawn[1][5])
    assert len(errors.along(q[:0], times[:0])) == 0
