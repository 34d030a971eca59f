"""RRT-Connect alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from arm.se3 import Array
from plan.budget import SearchBudget, TransitBudget, allowed
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from plan.transit import rrt_connect
from plan.transit.edges import SampledEdges
from plan.transit.planner import plan_transit
from plan.transit.rrt_connect import RrtConnect
from plans.transits import (
    LEFT,
    LIMITS,
    LOW_WALL,
    RIGHT,
    WINDOW_START,
    arm_with_hand,
    through_window,
    world_with,
)


def search(
    world: World, start: Array, goal: Array, seed: int, nodes: int, clearance: float = 0.011
) -> Array | None:
    edges = SampledEdges(world.too_near(clearance), 0.15)
    return RrtConnect(LIMITS, edges, np.random.default_rng(seed)).search(start, goal, nodes)


def test_rrt_connect_alone_finds_a_path() -> None:
    world = world_with(LOW_WALL)
    way = plan_transit(world, RIGHT, LEFT, LIMITS, 0.011, 0, TransitBudget(corner_edges=0))
    assert np.array_equal(way[0], RIGHT)
    assert np.array_equal(way[-1], LEFT)
    assert certify_curve(world, curve_of_waypoints(way), 0.011).proved


@pytest.mark.parametrize("seed", range(4))
def test_trees_are_free_at_samples_and_within_limits(seed: int) -> None:
    world = world_with(LOW_WALL)
    for start, goal in ((RIGHT, LEFT), (LEFT, RIGHT)):
        path = search(world, start, goal, seed, 3000)
        assert path is not None
        assert np.array_equal(path[[0, -1]], [start, goal])
        assert SampledEdges(world.too_near(0.011), 0.15).path_clear(path)
        assert ((path >= LIMITS.lower) & (path <= LIMITS.upper)).all()
        again = search(world, start, goal, seed, 3000)
        assert again is not None
        assert np.array_equal(path, again)


@pytest.mark.parametrize("seed", range(3))
def test_a_hand_goes_through_a_window(seed: int) -> None:
    """10 x 6 cm through 17 cm, 5 mm asked; only a fold of the whole arm leads out again."""
    world, goals = through_window(arm_with_hand(), 0.17, 0.005)
    assert len(goals) >= 2
    with allowed(SearchBudget()) as meter:
        way = plan_transit(world, WINDOW_START, goals[seed % len(goals)], LIMITS, 0.005, seed)
    assert certify_curve(world, curve_of_waypoints(way), 0.005).proved
    assert meter.effort_s < 1.5  # 2.7 to 10 without targets that keep some joints


def test_trees_that_never_meet_end_when_both_have_their_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall of configurations with room on both sides."""
    trees = list[Any]()

    class Noted(rrt_connect._Tree):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            trees.append(self)

    monkeypatch.setattr(rrt_connect, "_Tree", Noted)
    edges = SampledEdges(lambda q: bool(abs(q[0]) < 0.2), 0.15)
    ends = np.zeros((2, 6))
    ends[:, 0] = -1.0, 1.0
    assert RrtConnect(LIMITS, edges, np.random.default_rng(0)).search(*ends, 50) is None
    assert 50 < min(map(len, trees)) <= max(map(len, trees)) < 150


def test_a_hopeless_search_ends() -> None:
    """Nothing leads out of a shell about the goal: its tree stays small, and targets are limited as well."""
    calls = 0

    def too_near(q: Array) -> bool:
        nonlocal calls
        calls += 1
        return bool(0.01 < np.abs(q - LEFT).max() < 0.5)

    edges = SampledEdges(too_near, 0.15)
    assert RrtConnect(LIMITS, edges, np.random.default_rng(0)).search(RIGHT, LEFT, 60) is None
    assert 60 < calls < 60 * 10 * 3
