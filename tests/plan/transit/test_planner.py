"""Transits: straight where that is clear, else around, always proved, always the same."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.robot.shapes import Body, Box
from arm.se3 import Array, transform
from plan.budget import TransitBudget
from plan.collision.bezier import Curve, curve_of_waypoints
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.world import World
from plan.trajectory.time_estimates import path_time, straight_time
from plan.transit import planner
from plan.transit.edges import SampledEdges
from plan.transit.planner import TransitPlanner, plan_transit
from plan.transit.proofs import PathProof
from plans.transits import LEFT, LIMITS, LOW_WALL, RIGHT, ROBOT, inside, near_limits, world_with

# higher than it can go over without folding up
PILLAR = Body("pillar", Box((0.08, 0.08, 1.2)), transform(t=(0.45, 0.0, 0.6)), "post")


def closest(world: World, waypoints: Array) -> float:
    u = np.linspace(0.0, 1.0, 150)[:, None]
    return min(world.distance(q).value for a, b in itertools.pairwise(waypoints) for q in a + u * (b - a))


def test_a_free_transit_is_straight() -> None:
    way = plan_transit(world_with(), RIGHT, LEFT, LIMITS, 0.011, seed=0)
    assert np.array_equal(way, [RIGHT, LEFT])


@pytest.mark.few(3)
@pytest.mark.parametrize("obstacle", [LOW_WALL, PILLAR], ids=lambda b: b.name)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_transit_avoids_obstacles(obstacle: Body, seed: int) -> None:
    world = world_with(obstacle)
    assert closest(world, np.stack([RIGHT, LEFT])) < 0.0
    way = plan_transit(world, RIGHT, LEFT, LIMITS, 0.011, seed)
    assert np.array_equal(way[0], RIGHT)
    assert np.array_equal(way[-1], LEFT)
    assert np.all(way >= LIMITS.lower)
    assert np.all(way <= LIMITS.upper)
    assert closest(world, way) >= 0.011
    assert certify_curve(world, curve_of_waypoints(way), 0.011).proved


def test_the_way_over_a_low_wall_costs_little() -> None:
    """Median over seeds: the way up and down again is short."""
    times = [
        path_time(plan_transit(world_with(LOW_WALL), RIGHT, LEFT, LIMITS, 0.011, seed), LIMITS)
        for seed in range(5)
    ]
    assert np.median(times) < 1.3 * float(straight_time(LEFT - RIGHT, LIMITS))


def test_optimisation_never_makes_a_path_slower() -> None:
    world = world_with(LOW_WALL)
    rough = plan_transit(world, RIGHT, LEFT, LIMITS, 0.011, 3, TransitBudget(steps=0))
    better = plan_transit(world, RIGHT, LEFT, LIMITS, 0.011, 3)
    assert path_time(better, LIMITS) < path_time(rough, LIMITS)
    assert certify_curve(world, curve_of_waypoints(better), 0.011).proved


def test_the_same_seed_gives_the_same_way() -> None:
    ways = [plan_transit(world_with(LOW_WALL), RIGHT, LEFT, LIMITS, 0.011, seed) for seed in (5, 5, 6)]
    assert np.array_equal(ways[0], ways[1])
    assert not np.array_equal(ways[0], ways[2])


def test_a_blocked_end_is_named() -> None:
    at_goal = Body("crate", Box((0.1, 0.1, 0.1)), transform(t=ROBOT.T_base_tool(LEFT)[:3, 3]), "wall")
    with pytest.raises(
        ImpossibleError, match=r"the end of the motion is itself too near: \w+ and crate"
    ) as caught:
        plan_transit(world_with(at_goal), RIGHT, LEFT, LIMITS, 0.011, 0)
    assert caught.value.data["end"] == "to"
    assert caught.value.data["distance_m"] < 0.011
    with pytest.raises(ImpossibleError, match="the start of the motion") as caught:
        plan_transit(world_with(at_goal), LEFT, RIGHT, LIMITS, 0.011, 0)
    assert caught.value.data["end"] == "from"


def test_a_failed_transit_names_the_obstructing_pair() -> None:
    """Sheets before and behind the arm leave no room to turn past them."""
    walls = [
        Body("partition", Box((3.0, 0.02, 3.0)), transform(t=(1.62, 0.0, 1.5)), "wall"),
        Body("partition behind", Box((3.0, 0.02, 3.0)), transform(t=(-1.62, 0.0, 1.5)), "wall"),
    ]
    budget = TransitBudget(corners=200, corner_edges=20, rrt=60)
    with pytest.raises(ImpossibleError, match=r"no path around partition: \w+ comes within") as caught:
        plan_transit(world_with(*walls), RIGHT, LEFT, LIMITS, 0.011, 0, budget)
    assert caught.value.data["pair"][1] == "partition"
    there = world_with(*walls).distance(caught.value.data["at"]["q"])
    assert there.value == pytest.approx(caught.value.data["distance_m"], abs=1e-9)
    assert caught.value.exit_code == 3


def test_ways_stay_within_limits_that_are_near() -> None:
    found = []
    for seed in range(8):
        limits = near_limits(np.random.default_rng(seed))
        world = world_with(LOW_WALL)
        try:
            way = plan_transit(world, RIGHT, LEFT, limits, 0.011, seed, TransitBudget(rrt=300))
        except ImpossibleError:
            continue
        assert inside(way[None], limits).all()
        assert certify_curve(world, curve_of_waypoints(way), 0.011).proved
        found.append(float(np.minimum(way - limits.lower, limits.upper - way)[1:-1].min()))
    assert len(found) >= 4
    assert min(found) < 0.02  # rad: a limit is what keeps a way from being faster


def planner_of(world: World, slack: float = 0.0, known: list[Array] | None = None) -> TransitPlanner:
    rng = np.random.default_rng(0)
    return TransitPlanner(world, LIMITS, 0.011, rng, TransitBudget(rrt=400), known=known, slack=slack)


OPEN = ClearanceCertificate(0.0, 1.0, ("palm", "wall"), 0.5, False, 1)  # neither proved nor refuted


def test_what_is_not_proved_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though no sample, and nothing that the proof computed, was too near."""
    world, path = world_with(), np.stack([RIGHT, (RIGHT + LEFT) / 2, LEFT])
    monkeypatch.setattr(planner, "certify_curve", lambda *asked: OPEN)
    monkeypatch.setattr(planner.PathProof, "mended", lambda self, path: None)
    one = planner_of(world)
    assert not one.proved(path)
    assert one.fastest_accepted([path], np.inf) is None
    assert one.by_trees(RIGHT, LEFT) is None
    with pytest.raises(ImpossibleError, match="no path around wall"):
        plan_transit(world, RIGHT, LEFT, LIMITS, 0.011, 0)


@pytest.mark.parametrize("slack", [0.0, 0.0005])
def test_paths_are_proved_with_the_clearance_less_the_slack(
    slack: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By samples and by trees."""
    world, asked = world_with(LOW_WALL), list[float]()

    class Recorded(PathProof):
        def mended(self, path: Array) -> Array | None:
            asked.append(self.clearance)
            return super().mended(path)

    def recorded(world: World, curve: Curve, clearance: float) -> ClearanceCertificate:
        asked.append(clearance)
        return certify_curve(world, curve, clearance)

    monkeypatch.setattr(planner, "PathProof", Recorded)
    monkeypatch.setattr(planner, "certify_curve", recorded)
    one = planner_of(world, slack)
    for find in (lambda: one.around(RIGHT, LEFT, 0.5), lambda: one.by_trees(RIGHT, LEFT)):
        asked.clear()
        path = find()
        assert path is not None
        assert set(asked) == {0.011 - slack}
        assert certify_curve(world, curve_of_waypoints(path), 0.011 - slack).proved


def test_without_proofs_paths_of_trees_are_clear_at_finer_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where finer samples are not clear, the path is proved after all."""
    one, proved = planner_of(world_with(LOW_WALL)), list[Array]()
    one.prove = False
    monkeypatch.setattr(planner.PathProof, "mended", lambda self, path: proved.append(path))
    path = one.by_trees(RIGHT, LEFT)
    assert path is not None
    assert SampledEdges(one.too_near, 0.05).path_clear(path)
    assert not proved
    monkeypatch.setattr(planner.SampledEdges, "path_clear", lambda self, path: False)
    assert one.by_trees(RIGHT, LEFT) is None
    assert proved


def test_known_corners_are_looked_at_and_the_fastest_free_ones_come_first() -> None:
    world = world_with(LOW_WALL)
    way = plan_transit(world, RIGHT, LEFT, LIMITS, 0.011, 0)
    blocked, longer = (RIGHT + LEFT)[None] / 2, way[1:-1] - np.radians([0.0, 0.0, 0.0, 10.0, 0.0, 0.0])
    assert planner_of(world, known=[blocked]).over_known_corners(RIGHT, LEFT) is None
    found = planner_of(world, known=[longer, way[1:-1], blocked]).over_known_corners(RIGHT, LEFT)
    assert found is not None
    assert np.array_equal(found, way)


def test_samples_have_a_margin_only_where_both_ends_have_it() -> None:
    world = world_with()
    has = min(world.distance(q).value for q in (RIGHT, LEFT))
    margins = [planner._margin(world, (RIGHT, LEFT), has - room) for room in (2e-3, 5e-4, 1e-4)]
    assert margins == [1e-3, 2.5e-4, 0.0]


def test_ends_beyond_limits_are_refused() -> None:
    out = RIGHT + np.array([0.0, 9.0, 0.0, 0.0, 0.0, 0.0])
    for ends, name in (((out, LEFT), "q_from"), ((LEFT, out), "q_to")):
        with pytest.raises(InputError, match=f"{name}: joint J2"):
            plan_transit(world_with(), *ends, LIMITS, 0.011, 0)
