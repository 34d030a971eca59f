"""What a search notes about legs: what is forgotten when it starts again with more effort, and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.se3 import Array, frozen
from plan.options import PlanOptions
from plan.program.assignment.leg_costs import POSTPONED, Detours, LegCosts
from plan.program.assignment.legs import HOME, Leg, Site, Stop
from plan.program.goals.leg_times import line_ends, standing
from plan.trajectory.time_estimates import path_time

LIMITS = load_unit("crs93").limits()
SOURCE, PLACE = Site(False, 0), Site(True, 0)


def costs() -> LegCosts:
    """One cube and one place with two grasps each."""
    line = np.linspace(0.0, 0.1, 5)[:, None] * np.ones(6)
    ends = line_ends([frozen(line), frozen(line + 0.2)], 0.1, LIMITS, None)
    lines = {HOME: standing(np.zeros(6)), SOURCE: ends, PLACE: ends}
    return LegCosts(lines, LIMITS, PlanOptions())


def carry(source_grasp: int, place_grasp: int) -> Leg:
    return Leg(Stop(SOURCE, source_grasp), Stop(PLACE, place_grasp))


def times(noted: LegCosts) -> Array:
    """What carrying takes, by the grasps at both ends."""
    return noted.now()(SOURCE, PLACE, frozenset())


@pytest.mark.parametrize("by", [None, SOURCE])
def test_what_had_no_budget_is_asked_again_and_what_could_not_be_proved_is_not(
    by: Site | None,
) -> None:
    noted = costs()
    legs = [carry(*grasps) for grasps in ((0, 0), (0, 1), (1, 0), (1, 1))]
    noted.block(legs[0], by, POSTPONED)
    noted.block(legs[1], by, np.inf)
    noted.forbid(legs[2], by)
    noted.block(legs[3], by, 2.5)

    noted.retry()

    assert [noted.time(leg, by) for leg in legs] == [None, None, np.inf, 2.5]


def test_only_a_forbidden_leg_has_infinite_cost() -> None:
    noted = costs()
    before = times(noted)
    noted.forbid(carry(1, 0), None)
    noted.retry()
    after = times(noted)
    assert np.isfinite(before).all()
    assert np.isinf(after[1, 0])
    untouched = np.array([[True, True], [False, True]])
    assert (after[untouched] == before[untouched]).all()


def test_legs_between_the_same_stations_are_taken_to_be_blocked_alike_until_one_is_clear() -> None:
    noted = costs()
    before = times(noted)
    leg = carry(0, 0)
    noted.block(leg, None, float(before[0, 0]) + 2.0, "wall")
    assert times(noted) == pytest.approx(before + 2.0)
    noted.assume_alike = False
    only = np.array([[2.0, 0.0], [0.0, 0.0]])
    assert times(noted) == pytest.approx(before + only)
    noted.assume_alike = True
    assert times(noted) == pytest.approx(before + 2.0)
    noted.clear(carry(1, 1))
    assert times(noted) == pytest.approx(before + only)


def test_what_a_cube_blocks_says_nothing_of_other_legs() -> None:
    noted = costs()
    before = times(noted)
    noted.block(carry(0, 0), PLACE, float(before[0, 0]) + 2.0, "cube 1")
    assert (times(noted) == before).all()


def through(noted: LegCosts, leg: Leg, rng: np.random.Generator) -> Array:
    """A detour of a leg over one drawn way-point."""
    q_from, q_to = (end.offset[0] for end in noted.ends(leg))
    return np.stack([q_from, rng.uniform(-1.0, 1.0, 6), q_to])


@pytest.mark.parametrize("seed", range(5))
def test_a_detour_takes_what_a_leg_over_its_corners_takes(seed: int) -> None:
    """It leaves one line and enters another, both at speed."""
    rng, noted, leg = np.random.default_rng(seed), costs(), carry(0, 1)
    noted.block(leg, None, None, "wall")
    noted.found(leg, None, through(noted, leg, rng))
    over = noted.detours.over(noted.detours.known("wall"), noted.ends(leg))
    assert noted.time(leg, None) == pytest.approx(over[0], abs=1e-6)


@pytest.mark.parametrize("by", [None, PLACE])
def test_what_a_detour_around_a_cube_takes_says_nothing_of_fixed_bodies(by: Site | None) -> None:
    """A short detour around the wall makes others seem short, one around a cube does not."""
    rng, noted = np.random.default_rng(1), costs()
    noted.assume_alike = False
    noted.detours.learn("wall", True, through(noted, carry(0, 0), rng), 30.0, -np.inf)
    noted.block(carry(0, 0), None, None, "wall")
    before = times(noted)[0, 0]
    noted.block(carry(1, 1), by, None, "wall" if by is None else "cube 1")
    q_from, q_to = (end.offset[0] for end in noted.ends(carry(1, 1)))
    noted.found(carry(1, 1), by, np.stack([q_from, 0.5 * (q_from + q_to), q_to]))
    assert (times(noted)[0, 0] < before) == (by is None)


@pytest.mark.parametrize(("look", "home"), [("never", ()), (2, (2,)), (3, (3,)), ("each", (1, 2, 3))])
def test_the_arm_goes_home_after_the_cubes_after_which_it_looks(
    look: str | int, home: tuple[int, ...]
) -> None:
    """After one, two and three of four cubes, of which those that are left stand at their sources."""
    ends = costs().lines[SOURCE]
    lines = {HOME: standing(np.zeros(6)), PLACE: ends, **{Site(False, i): ends for i in range(4)}}
    noted = LegCosts(lines, LIMITS, PlanOptions(look=look))
    direct, to_home, from_home = (noted.free[s] for s in ((PLACE, SOURCE), (PLACE, HOME), (HOME, SOURCE)))
    for done in (1, 2, 3):
        left = frozenset(Site(False, i) for i in range(4 - done))
        time = noted.now()(PLACE, SOURCE, left)
        assert np.array_equal(time, to_home + from_home if done in home else direct)


def test_a_way_that_was_made_tells_what_others_around_the_same_body_take() -> None:
    """Over its own corners a leg takes what its way took, back too; around another body, nothing is known."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        start, goal = standing(rng.uniform(-1.0, 1.0, 6)), standing(rng.uniform(-1.0, 1.0, 6))
        corners = rng.uniform(-1.0, 1.0, (3, 6))
        way = np.concatenate([start.offset, corners, goal.offset])
        detours = Detours(LIMITS)
        detours.learn("wall", True, way, 1.5, -np.inf)
        for ends, points in (((start, goal), way), ((goal, start), way[::-1])):
            over = detours.over(detours.nearest("wall", ends), ends)
            assert over.min() <= path_time(points, LIMITS) + 1e-6
            assert over[-1] == pytest.approx(over.min(), abs=2e-6)
        assert detours.median("wall", True) == 1.5
        assert detours.known("crate") == []
        assert np.isinf(detours.median("wall", False))
