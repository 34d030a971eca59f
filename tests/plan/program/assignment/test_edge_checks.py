"""Lines and transits, checked once and asked again where something left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.se3 import Array, rot_z, transform
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.world import World
from plan.program.assignment import edge_checks
from plan.program.assignment.edge_checks import Blocked, EdgeChecks
from plan.program.assignment.found import PlannedLeg
from plan.program.assignment.legs import AT_HOME, HOME, Arrangement, Leg, Site, Stop
from plan.program.assignment.search import TaskSearch
from plan.program.goals.leg_times import stacked, standing
from plan.program.setting import Setting
from plan.trajectory.time_estimates import path_time
from plan.transit.corners import FewCorners
from plan.transit.optimise import TransitOptimiser
from plan.transit.planner import TransitPlanner
from plan.transit.straight import StraightLine
from plans.small_search import CASES, OPTIONS, UNIT, beside_each_other, search_of
from tasks.task2 import Q_START, task2


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
        patch.setattr(TransitOptimiser, "shorten", lambda self, path, steps: path[[0, -1]])
        edges._doubted.update(edges._paths)  # as if they could not be certified before
        assert all(polished(planned)[0] is planned.path for planned in around)
        edges._doubted.clear()
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


SOURCE, OTHER, PLACE, PLACED = Site(False, 0), Site(False, 1), Site(True, 0), Site(True, 1)
LEG, HIGH = Leg(Stop(PLACE, 0), AT_HOME), Leg(Stop(PLACE, 1), Stop(HOME, 1))


def test_a_line_that_a_cube_blocks_is_blocked_whenever_it_is_there_and_only_then() -> None:
    """Whatever was asked before: cube 1 beside cube 0, which the open jaws have to grip across the gap."""
    search = search_of(beside_each_other(0), OPTIONS)
    with_it, without = frozenset((SOURCE, OTHER)), frozenset((SOURCE, PLACED))
    for arrangements in ((without, with_it, without), (with_it, without, with_it)):
        search.edges._clear_lines.clear()
        for now in arrangements:
            found = [search.edges.line(grasp, SOURCE, 0, now) for grasp in search.grasps[SOURCE]]
            if now is without:
                assert None in found
            else:
                assert all(blocked is not None and blocked.by == OTHER for blocked in found)


def test_what_blocks_a_line_is_its_own_cube_or_one_that_may_go() -> None:
    """The own cube is there whenever the line is used."""
    search = search_of(beside_each_other(0), OPTIONS)
    for site, now, by in ((OTHER, {OTHER}, None), (SOURCE, {SOURCE, OTHER}, OTHER)):
        found = search.edges.line(search.grasps[SOURCE][0], site, site.number, frozenset(now))
        assert found is not None
        assert found.by == by


@pytest.mark.parametrize("room", [2e-4, -2e-4])
def test_lines_keep_their_clearance(room: float) -> None:
    search, compared = search_of(beside_each_other(0), OPTIONS), 0
    everywhere = search.worlds.everywhere
    for grasp in search.grasps[OTHER]:
        worlds = list(search.edges._line_worlds(OTHER, 1, everywhere))
        least = min(world.distance(q).value for world in worlds for q in grasp.q_line)
        if least > 2e-3:
            search.edges._clear_lines.clear()
            search.edges.options = replace(OPTIONS, line_clearance=least - room)
            assert (search.edges.line(grasp, OTHER, 1, everywhere) is None) == (room > 0.0)
            compared += 1
    assert compared


def over_cube(search: TaskSearch, height: float) -> Array:
    """A short straight motion (2, n) whose middle is `height` m above the grasp of cube 1."""
    line = search.grasps[OTHER][0].q_line
    along = height / OPTIONS.offset * (len(line) - 1)
    at = np.array([np.interp(along, np.arange(len(line)), values) for values in line.T])
    return np.asarray(np.stack([at, at]) + np.array([[-0.3], [0.3]]) * np.eye(6)[0])


def between(search: TaskSearch, motion: Array, high: Array | None = None) -> EdgeChecks:
    """Checks of `LEG` and `HIGH` with these motions, from place 0 to home; nothing is known yet."""
    motions = np.stack([motion, motion if high is None else high])
    ends = {site: stacked([standing(q) for q in motions[:, k]]) for k, site in enumerate((PLACE, HOME))}
    setting = Setting(search.worlds.scene, UNIT, UNIT.limits(), OPTIONS)
    return EdgeChecks(setting, search.worlds, {**ends, OTHER: ends[HOME], SOURCE: ends[PLACE]})


def test_a_transit_that_a_cube_blocks_is_blocked_whenever_it_is_there_and_only_then() -> None:
    search = search_of(beside_each_other(0), OPTIONS)
    there, gone = frozenset((OTHER,)), frozenset((PLACED,))
    low, high = over_cube(search, 0.012), over_cube(search, 0.1)
    for arrangements in ((gone, there, gone), (there, gone, there)):
        edges = between(search, low, high)
        for now in arrangements:
            found = edges.straight(LEG, now)
            assert isinstance(found, Blocked) == (now is there)
            if isinstance(found, Blocked):
                assert (found.by, found.end) == (OTHER, False)
        # what is clear with cubes everywhere is checked once
        assert edges.straight(HIGH, there) is edges.straight(HIGH, gone)
    beside = low[0] + 0.625 * (low[1] - low[0])
    for motion in (np.stack([beside, low[0]]), np.stack([low[0], beside])):
        found = between(search, motion).straight(LEG, there)
        assert isinstance(found, Blocked)
        assert found.end
    found = between(search, low).straight(Leg(Stop(PLACE, 0), Stop(OTHER, 0)), there)
    assert isinstance(found, Blocked)
    assert found.by is None  # it is there whenever the leg is used


def test_with_the_least_margin_blocked_transits_are_checked_again() -> None:
    """A motion with more than the required clearance, and less than the margin of the search beyond it."""
    search = search_of(beside_each_other(0), OPTIONS)
    everywhere = search.worlds.everywhere
    world = search.worlds.empty(everywhere)
    for height in np.linspace(0.012, 0.03, 120):
        motion = over_cube(search, height)
        line = motion[0] + np.linspace(0.0, 1.0, 50)[:, None] * (motion[1] - motion[0])
        if OPTIONS.clearance + 3e-4 < min(world.distance(q).value for q in line) < OPTIONS.clearance + 9e-4:
            break
    else:
        pytest.fail("no height")
    edges = between(search, motion)
    assert isinstance(edges.straight(LEG, everywhere), Blocked)
    edges.least_margin()
    assert not isinstance(edges.straight(LEG, everywhere), Blocked)


def test_what_cannot_be_certified_is_forgotten_and_certified_the_next_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Samples that see nothing take a motion 4 mm above a cube, with 10 mm required, for clear."""
    search = search_of(beside_each_other(0), OPTIONS)
    low, now = over_cube(search, 0.012), search.worlds.everywhere
    edges = between(search, low, over_cube(search, 0.1))
    monkeypatch.setattr(
        edge_checks, "check_straight", lambda world, a, b, asked, margin: StraightLine(a, b, asked, True, 0.0)
    )
    paths = {leg: edges.straight(leg, now) for leg in (LEG, HIGH)}
    assert not any(isinstance(path, Blocked) for path in paths.values())
    assert edges.confirm(HIGH, now, paths[HIGH])  # type: ignore[arg-type]
    assert edges.straight(HIGH, now) is paths[HIGH]
    assert not edges.confirm(LEG, now, paths[LEG])  # type: ignore[arg-type]
    found = edges.straight(LEG, now)
    assert isinstance(found, Blocked)
    assert 0.0 < found.check.seen < OPTIONS.clearance
    assert found.by is not None
    # a detour that is as near is planned again, with proofs
    edges._doubted.clear()
    detour = edges._paths[LEG, now] = np.stack([low[0], low.mean(axis=0), low[1]])
    assert not edges.confirm(LEG, now, detour)
    assert (LEG, now) not in edges._paths
    assert edges._planner(LEG, now, OPTIONS.transit, ()).prove
    path = edges.around(LEG, now, [], thorough=False)
    assert path is not None
    assert certify_curve(search.worlds.empty(now), curve_of_waypoints(path), OPTIONS.clearance).proved
    assert edges.confirm(LEG, now, path)


@pytest.mark.parametrize(("room", "passes"), [(5e-4, True), (-5e-4, False)])
def test_what_only_joint_1_moves_has_to_pass_with_the_required_clearance(
    monkeypatch: pytest.MonkeyPatch, room: float, passes: bool
) -> None:
    """A post beside the turret, nearer or further out: the search's margin is not required of it."""
    angle, asked = np.radians(28.0), OPTIONS.clearance + room
    turns = np.linspace(-1.0, 1.0, 400)[:, None] * np.eye(6)[0]
    q, low, high = Q_START * np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0]), 0.1, 0.2

    def post(radius: float) -> Body:
        place = (radius * np.cos(angle), radius * np.sin(angle), 0.14)
        return Body("low post", Box((0.03, 0.02, 0.28)), transform(rot_z(angle), place), "wall")

    for _ in range(20):
        middle = 0.5 * (low + high)
        world = World(task2().scene.robot_open, [post(middle)])
        pair = [i for i in range(len(world.pairs)) if world.pair_names(i) == ("shoulder", "low post")]
        least = min(float(world.pair_distances(q + turn, np.array(pair))[0]) for turn in turns[::10])
        low, high = (middle, high) if least < asked else (low, middle)
    search = search_of(task2(extra=[post(high)], cubes=1), OPTIONS)
    world = search.worlds.empty(frozenset())
    outer = next(body.name for body in world.robot.bodies if body.joint == 3)
    for other, counts in (("shoulder", True), (outer, False)):
        check = ClearanceCertificate(0.0, 0.0, (other, "low post"), 0.5, False, 1)
        found = search.edges._passed(q + turns[0], q + turns[-1], world, check)
        assert (found is None) == (passes or not counts)
    # a body on the third joint may be moved by it, though the second leaves its distance unchanged
    monkeypatch.setattr(World, "joint_of", lambda self, name: 3 if name == "shoulder" else 0)
    check = ClearanceCertificate(0.0, 0.0, ("shoulder", "low post"), 0.5, False, 1)
    assert search.edges._passed(q + turns[0], q + turns[-1], world, check) is None


def test_transits_are_checked_with_what_is_carried_and_proved_with_the_required_clearance() -> None:
    search = search_of(beside_each_other(0), OPTIONS)
    edges = between(search, over_cube(search, 0.1))
    robot, cube = search.worlds.scene.robot_holding, search.worlds.cubes[0].name
    carry = Leg(Stop(SOURCE, 0), Stop(PLACE, 0))
    world = edges._world(carry, frozenset((OTHER,)))
    assert (world.robot, world.joint_of(cube)) == (robot, robot.end_joint)
    assert cube not in edges._world(LEG, frozenset((OTHER,))).names
    for leg in (LEG, carry):
        planner = edges._planner(leg, frozenset(), OPTIONS.transit, ())
        assert OPTIONS.clearance <= planner.clearance - planner.slack < planner.clearance
