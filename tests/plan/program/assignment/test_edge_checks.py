"""Lines and ways across, proved once and asked again where something left."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.program.assignment.found import Stop
from plan.program.assignment.leg_costs import TransitEdge
from plan.program.assignment.sequencing import Progress
from plan.program.assignment.worlds import CubePlacement
from plan.trajectory.time_estimates import path_time
from plan.transit.optimise import TransitOptimiser
from plans.small_search import CASES, search_of


def test_a_leg_that_a_cube_blocks_is_open_again_when_the_cube_is_gone() -> None:
    search = search_of(*CASES["plain"])
    found = search.best()
    first, second = found.stops
    names = [search.stages.cubes[s.visit.pick].name for s in found.stops]

    def across(stop: Stop, there: frozenset[CubePlacement]) -> float:
        visit = stop.visit
        picks = frozenset(i for i in range(2) if CubePlacement(False, i) not in there)
        done = Progress(picks, frozenset(s.number for s in there if s.placed))
        time = search.costs.now().carry(visit.pick, visit.place, done)
        return float(time[visit.pick_way, visit.place_way])

    first_there, later = first.before, second.before
    error = ImpossibleError("too near", pair=["elbow", names[1]], role="transit")
    search.forbid(found.stops, 0, "across", error)  # while the other cube still stands where it is picked
    assert across(first, first_there) == np.inf
    gone = first_there - {CubePlacement(False, second.visit.pick)} | {CubePlacement(True, second.visit.place)}
    assert across(first, gone) < 100.0
    error = ImpossibleError("too near", pair=["elbow", names[0]], role="transit")
    search.forbid(found.stops, 1, "across", error)  # the first cube, where it was brought
    assert across(second, later) == np.inf
    assert (
        across(second, second.before - {CubePlacement(True, first.visit.place)} | {CubePlacement(False, 0)})
        < 100.0
    )
    search.forbid(
        found.stops, 1, "across", ImpossibleError("too near", pair=["elbow", "table"], role="transit")
    )
    assert across(second, frozenset(CubePlacement(False, i) for i in range(2))) == np.inf
    line = ImpossibleError("too near", pair=["palm", names[0]], role="approach")
    search.forbid(found.stops, 0, "out", line)  # its own cube is always there
    assert search.costs._closed(CubePlacement(False, first.visit.pick), frozenset()) == [first.visit.pick_way]


def test_a_way_that_is_polished_is_no_slower_and_keeps_its_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    search = search_of(*CASES["wall"])
    found = search.best()
    around = [way for stop in found.stops for way in (stop.out, stop.across) if len(way) > 2]
    assert around

    def polished(way: Array) -> tuple[TransitEdge, Array, float]:
        search.proofs._polished.clear()  # a way is polished once
        return search.proofs.polish(way, search._query)

    with monkeypatch.context() as patch:  # what is not clear, or is no faster, is not taken
        patch.setattr(TransitOptimiser, "shorten", lambda self, path, steps: None)
        assert all(polished(way)[1] is way for way in around)
        patch.setattr(TransitOptimiser, "shorten", lambda self, path, steps: path.copy())
        assert all(polished(way)[1] is way for way in around)
    for way in around:
        leg, better, saved = polished(way)
        moment = next(asked[1] for asked, known in search.proofs._ways.items() if known is better)
        crossing = search._query(leg)
        times = [path_time(w, search.limits, crossing.ends.enter, crossing.ends.leave) for w in (way, better)]
        assert times[0] - times[1] == pytest.approx(saved, abs=1e-9)
        assert saved >= 0.0
        world = search.proofs._world(crossing, moment)
        assert certify_curve(world, curve_of_waypoints(better), search.options.clearance).proved
