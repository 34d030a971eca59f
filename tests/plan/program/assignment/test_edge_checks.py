"""Lines and transits, checked once and asked again where something left."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.program.assignment.found import PlannedLeg
from plan.program.assignment.legs import Arrangement
from plan.trajectory.time_estimates import path_time
from plan.transit.corners import FewCorners
from plan.transit.optimise import TransitOptimiser
from plan.transit.planner import TransitPlanner
from plans.small_search import CASES, search_of


def test_a_leg_that_a_cube_blocks_is_open_again_when_the_cube_is_gone() -> None:
    search = search_of(*CASES["plain"])
    found = search.best()
    number = [k for k, planned in enumerate(found.legs) if planned.leg.carries]
    first, second = (found.legs[k] for k in number)
    names = [search.worlds.cubes[planned.leg.origin.site.number].name for planned in (first, second)]

    def time(planned: PlannedLeg, there: Arrangement) -> float:
        return float(search.costs.now()(*planned.leg.sites, there)[planned.leg.grasps])

    error = ImpossibleError("too near", pair=["elbow", names[1]], role="transit")
    search.forbid(found.legs, number[0], error)  # while the other cube still stands where it is picked
    assert time(first, first.there) == np.inf
    assert time(first, frozenset((second.leg.goal.site,))) < 100.0
    error = ImpossibleError("too near", pair=["elbow", names[0]], role="transit")
    search.forbid(found.legs, number[1], error)  # the first cube, where it was brought
    assert time(second, second.there) == np.inf
    assert time(second, frozenset((first.leg.origin.site,))) < 100.0
    search.forbid(found.legs, number[1], ImpossibleError("too near", pair=["elbow", "table"], role="transit"))
    assert time(second, frozenset((first.leg.origin.site,))) == np.inf
    line = ImpossibleError("too near", pair=["palm", names[0]], role="approach")
    search.forbid(found.legs, 0, line)  # its own cube is always there
    assert search.costs._closed(first.leg.origin.site, frozenset()) == [first.leg.origin.grasp]


def test_a_path_that_is_polished_is_no_slower_and_keeps_its_clearance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = search_of(*CASES["wall"])
    found, edges = search.best(), search.edges
    around = [planned for planned in found.legs if len(planned.path) > 2]
    assert around

    def polished(planned: PlannedLeg) -> tuple[Array, float]:
        edges._polished.clear()  # a path is polished once
        return edges.polish(planned.leg, planned.there, planned.path)

    with monkeypatch.context() as patch:  # what is not clear, or is no faster, is not taken
        patch.setattr(TransitOptimiser, "shorten", lambda self, path, steps: None)
        assert all(polished(planned)[0] is planned.path for planned in around)
        patch.setattr(TransitOptimiser, "shorten", lambda self, path, steps: path.copy())
        assert all(polished(planned)[0] is planned.path for planned in around)
    for planned in around:
        leg, (better, saved) = planned.leg, polished(planned)
        there = next(there for (_, there), known in edges._paths.items() if known is better)
        out, into = search.costs.ends(leg)
        before, after = (
            path_time(path, edges.limits, out.velocity[0], -into.velocity[0])
            for path in (planned.path, better)
        )
        assert before - after == pytest.approx(saved, abs=1e-9)
        assert saved >= 0.0
        world = edges._world(leg, there)
        assert certify_curve(world, curve_of_waypoints(better), search.options.clearance).proved


def test_a_detour_passes_known_corners_where_that_path_is_clear(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many more promising ones are blocked; nothing else is searched."""
    search = search_of(*CASES["wall"])
    edges, found = search.edges, search.best()
    edges.alike = True
    planned = next(planned for planned in found.legs if len(planned.path) > 2)
    leg, path = planned.leg, planned.path
    key = _, there = edges._key(leg, planned.there, path)
    middle = path[:1] + edges._blocked[key].check.time * (path[-1:] - path[:1])
    monkeypatch.setattr(FewCorners, "paths", lambda *_: iter(()))
    monkeypatch.setattr(TransitPlanner, "by_trees", lambda *_: None)
    for known, passes in (([path[1:-1], *[middle] * 10], True), ([middle] * 10, False)):
        del edges._paths[key]
        over = edges.around(leg, there, known, thorough=False)
        assert (over is not None) == passes
