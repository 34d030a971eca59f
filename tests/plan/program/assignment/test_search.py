"""The search over a whole task: against trying everything, what it calls proved, its bound, and cubes in the way."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise, permutations, product

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, frozen, inverse, rot_z, transform
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.world import World
from plan.options import PlanOptions
from plan.program.assignment.edge_checks import _POLISH, MARGIN, Blocked
from plan.program.assignment.found import Found
from plan.program.assignment.legs import HOME, Arrangement, Leg, Site, Stop
from plan.program.assignment.search import _ALLOWED, TaskSearch
from plan.program.assignment.sequencing import best_grasps, best_order
from plan.program.tasks import plan_task
from plan.transit.optimise import TransitOptimiser
from plans.small_search import CASES, OPTIONS, UNIT, beside_each_other, search_of
from tasks.task2 import CUBE, Q_START, Task2, task2


@cache
def searched(name: str) -> tuple[TaskSearch, Found]:
    search = search_of(*CASES[name])
    return search, search.best()


def pairs_of(found: Found) -> list[tuple[int, int]]:
    """Numbers of the source and the place of each cube, in order."""
    carries = [planned.leg.sites for planned in found.legs if planned.leg.carries]
    return [(source.number, place.number) for source, place in carries]


class Truth:
    """Worlds and proofs of a task, made anew."""

    def __init__(self, case: Task2, options: PlanOptions) -> None:
        self.case, self.options = case, options
        self.cubes = [case.scene.cube(t.cube) for t in case.transfers]
        moved = {c.name for c in self.cubes}
        self.still = [*case.scene.bodies, *(c for c in case.scene.cubes if c.name not in moved)]
        self.seen: dict[object, bool] = {}

    def world(
        self, picks: tuple[int, ...], places: tuple[int, ...], held: int | None, touching: frozenset[str]
    ) -> World:
        """With cubes at those picks and places."""
        bodies = [*self.still, *(self.cubes[i] for i in picks)]
        for j in places:
            T = self.case.transfers[j].place.T_base_tool[0] @ self.T_tool_cube(j)
            bodies.append(Body(f"at place {j}", self.cubes[j].shape, frozen(T), "cube"))
        scene = self.case.scene
        if held is None:
            return World(scene.robot_open, bodies)
        cube = self.cubes[held]
        allowed = [frozenset((cube.name, name)) for name in touching]
        return World(scene.robot_holding, bodies, cube, self.T_tool_cube(held), allowed)

    def T_tool_cube(self, i: int) -> Array:
        return inverse(self.case.transfers[i].pick.T_base_tool[0]) @ self.cubes[i].T_base_body

    def clear(self, key: object, q: Array, clearance: float, worlds: Callable[[], list[World]]) -> bool:
        if key not in self.seen:
            curve = curve_of_waypoints(q)
            self.seen[key] = all(certify_curve(world, curve, clearance).proved for world in worlds())
        return self.seen[key]


Ways = tuple[tuple[int, int], tuple[int, int], tuple[int, ...]]


def every_sequence(search: TaskSearch) -> Iterator[tuple[float, Ways]]:
    """Times of all orders, places, yaws and branches, the least first, as if nothing were in the way."""
    heap: list[tuple[float, Ways]] = []
    t, looks = search.costs.free, search.options.look == "each"
    for (i, k), (j, m) in product(permutations(range(2)), repeat=2):
        picks, places = (Site(False, i), Site(False, k)), (Site(True, j), Site(True, m))
        sizes = [len(search.grasps[site]) for site in (picks[0], places[0], picks[1], places[1])]
        a = t[HOME, picks[0]][0][:, None] + t[picks[0], places[0]]
        between = t[places[0], HOME] + t[HOME, picks[1]] if looks else t[places[0], picks[1]]
        b = t[picks[1], places[1]] + t[places[1], HOME][:, 0]
        total = a[:, :, None, None] + between[None, :, :, None] + b[None, None]
        assert total.shape == tuple(sizes)
        heap += [
            (float(time), ((i, k), (j, m), ways))
            for ways, time in zip(np.ndindex(*sizes), total.ravel(), strict=True)
        ]
    heapq.heapify(heap)
    while heap:
        yield heapq.heappop(heap)


def straight_and_clear(search: TaskSearch, truth: Truth, ways: Ways) -> bool:
    """Whether all lines, and all straight ways between them, are proved."""
    (i, k), (j, m), (a, b, c, d) = ways
    options, transfers = truth.options, truth.case.transfers
    asked, line = options.clearance + MARGIN, options.line_clearance
    pick_1, place_1 = search.grasps[Site(False, i)][a].q_line, search.grasps[Site(True, j)][b].q_line
    pick_2, place_2 = search.grasps[Site(False, k)][c].q_line, search.grasps[Site(True, m)][d].q_line
    none: frozenset[str] = frozenset()
    home = search.costs.lines[HOME].offset[0]
    w = truth.world
    legs = [
        (
            ("l1", i, a),
            pick_1,
            line,
            lambda: [w((0, 1), (), None, none), w((k,), (), i, transfers[i].pick.touches)],
        ),
        (
            ("l2", i, j, b),
            place_1,
            line,
            lambda: [w((k,), (), i, transfers[j].place.touches), w((k,), (j,), None, none)],
        ),
        (
            ("l3", k, j, c),
            pick_2,
            line,
            lambda: [w((k,), (j,), None, none), w((), (j,), k, transfers[k].pick.touches)],
        ),
        (
            ("l4", k, m, d),
            place_2,
            line,
            lambda: [w((), (j,), k, transfers[m].place.touches), w((), (0, 1), None, none)],
        ),
        (("c1", i, j, a, b), np.stack([pick_1[-1], place_1[-1]]), asked, lambda: [w((k,), (), i, none)]),
        (("c2", k, m, c, d), np.stack([pick_2[-1], place_2[-1]]), asked, lambda: [w((), (j,), k, none)]),
        (("begin", i, a), np.stack([home, pick_1[-1]]), asked, lambda: [w((0, 1), (), None, none)]),
        (("end", m, d), np.stack([place_2[-1], home]), asked, lambda: [w((), (0, 1), None, none)]),
    ]
    if options.look == "each":
        stops = [("a", j, k, b), ("b", j, k, c)]
        ends = [np.stack([place_1[-1], home]), np.stack([home, pick_2[-1]])]
    else:
        stops, ends = [("go on", j, k, b, c)], [np.stack([place_1[-1], pick_2[-1]])]
    legs += [(key, q, asked, lambda: [w((k,), (j,), None, none)]) for key, q in zip(stops, ends, strict=True)]
    return all(truth.clear(*leg) for leg in legs)


@pytest.mark.few(1)
@pytest.mark.parametrize("name", CASES)
def test_no_straight_sequence_is_faster(name: str) -> None:
    """All orders, places, yaws and branches are tried, the fastest first, until one is proved leg by leg."""
    search, found = searched(name)
    truth = Truth(*CASES[name])
    least = next(time for time, ways in every_sequence(search) if straight_and_clear(search, truth, ways))
    assert found.time <= least + 1e-6
    if all(len(planned.path) == 2 for planned in found.legs):
        assert found.time == pytest.approx(least, abs=1e-6)
    assert found.bound <= found.time


@pytest.mark.parametrize("assume_alike", [False, True])
def test_what_is_known_of_the_legs_is_what_the_sequence_takes(
    assume_alike: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of ways around that were made faster at the end; here only then."""
    shorten, made = TransitOptimiser.shorten, list[int]()

    def late(optimiser: TransitOptimiser, path: Array, steps: int) -> Array:
        made.append(steps)
        return shorten(optimiser, path, steps) if steps == _POLISH else path

    monkeypatch.setattr(TransitOptimiser, "shorten", late)
    search = search_of(*CASES["wall"])
    search.costs.assume_alike = assume_alike
    found = search.best()
    assert _POLISH in made
    known = best_grasps(pairs_of(found), search.costs.now())
    assert found.time * (1.0 - _ALLOWED) <= known.time <= found.time + 1e-6


@pytest.mark.parametrize("name", CASES)
def test_certified_motions_are_clear_at_samples(name: str) -> None:
    found, truth = searched(name)[1], Truth(*CASES[name])
    none: frozenset[str] = frozenset()
    for planned in found.legs:
        (origin, goal), there, grasp = planned.leg.sites, planned.there, planned.grasp
        numbers = [tuple(sorted(s.number for s in there if s.placed is placed)) for placed in (False, True)]
        held = origin.number if planned.leg.carries else None
        looked = [(planned.path, 0.011, truth.world(*numbers, held, none))]
        if grasp is not None:
            pick = goal.number if held is None else held
            others = tuple(i for i in numbers[0] if i != pick)
            full = (others, (*numbers[1], goal.number)) if goal.placed else numbers
            station = truth.case.transfers[goal.number]
            touches = (station.place if goal.placed else station.pick).touches
            looked.append((grasp.q_line, 0.005, truth.world(*full, None, none)))
            looked.append((grasp.q_line, 0.005, truth.world(others, numbers[1], pick, touches)))
        for path, clearance, world in looked:
            for a, b in pairwise(path):
                count = max(3, int(np.abs(b - a).sum() / 0.04))
                for u in np.linspace(0.0, 1.0, count):
                    assert not world.in_collision(a + u * (b - a), clearance - 1e-6)
    assert sum(planned.leg.carries for planned in found.legs) == 2
    assert found.legs[-1].leg.goal.site == HOME


@pytest.mark.parametrize("name", CASES)
def test_no_plan_is_faster_than_the_bound(name: str) -> None:
    case, options = CASES[name]
    plan = plan_task(case.scene, case.transfers, Q_START, UNIT, options=options)
    motion = sum(move.path.duration_s for move in plan.moves)
    bound = plan.task["no_plan_is_faster_than_s"]
    assert 0.7 * motion < bound <= motion
    assert searched(name)[1].time == pytest.approx(motion, rel=0.03)  # the estimate that ranks sequences


@pytest.mark.parametrize("look", ["never", "each", 2])
def test_lines_and_legs_are_checked_among_the_cubes_of_their_time(
    look: str | int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is carried rests nowhere, what was brought rests at its place; the jaws are open around both."""
    search = search_of(task2(cubes=3), replace(OPTIONS, look=look))
    lines, legs = list[tuple[Site, Arrangement]](), list[tuple[Site, Arrangement]]()
    monkeypatch.setattr(
        search.edges, "line", lambda grasp, site, pick, now: lines.append((site, now)) or None
    )
    monkeypatch.setattr(
        search.edges, "straight", lambda leg, now: legs.append((leg.goal.site, now)) or np.zeros((2, 6))
    )
    ordered = best_order(search.choices, search.costs.now())
    found = search._legs(ordered)
    resting = {Site(False, i) for i in range(3)}
    expected_lines, expected_legs = list[tuple[Site, Arrangement]](), list[tuple[Site, Arrangement]]()
    for number, (pick, place) in enumerate(ordered.pairs, start=1):
        source, goal = Site(False, pick), Site(True, place)
        expected_lines.append((source, frozenset(resting)))
        expected_legs.append((source, frozenset(resting)))
        resting.remove(source)
        expected_legs.append((goal, frozenset(resting)))
        resting.add(goal)
        expected_lines.append((goal, frozenset(resting)))
        if number == 3 or look == "each" or number == look:
            expected_legs.append((HOME, frozenset(resting)))
    assert lines == expected_lines
    assert legs == expected_legs
    assert found is not None
    assert [(planned.leg.goal.site, planned.there) for planned in found] == legs


LEG = Leg(Stop(Site(False, 0), 0), Stop(Site(True, 0), 0))


@pytest.mark.parametrize("points", [2, 3])
def test_only_a_straight_motion_makes_the_legs_beside_it_clear(
    points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A detour that is known says nothing of other legs between the same two sites."""
    search = search_of(task2(cubes=2), OPTIONS)
    path = np.zeros((points, 6))
    monkeypatch.setattr(search.edges, "straight", lambda leg, now: path)
    assert search._path(LEG, search.worlds.start) is path
    unchecked = [leg.sites for leg in search.costs.fastest_unchecked()]
    assert (LEG.sites in unchecked) == (points == 3)


@pytest.mark.parametrize(("by", "end"), [(None, False), (None, True), (Site(False, 1), False)])
def test_only_what_blocks_at_every_time_is_learnt_from_a_sample(
    by: Site | None, end: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cube may be gone when the leg is used; and of a leg without a detour the others are no copies."""
    search = search_of(task2(cubes=2), OPTIONS)
    check = ClearanceCertificate(0.0, 0.0, ("palm", "wall"), 0.5, False, 1)
    blocked = Blocked(by, check, search.worlds.empty(search.worlds.start), np.zeros(6), end)
    monkeypatch.setattr(search.edges, "straight", lambda leg, now: blocked)
    legs = list(search.costs.fastest_unchecked())
    search._probe()
    assert {search.costs.is_blocked(leg, None) for leg in legs} == {by is None and not end}
    assert not any(search.costs.is_blocked(leg, by) for leg in legs if by is not None)


def test_a_sequence_takes_less_by_what_polishing_its_detours_saves(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sequence, and the estimates of its legs."""
    search = search_of(*CASES["wall"])
    found = search.best()
    monkeypatch.setattr(search.edges, "polish", lambda leg, there, path: (path[::-1], 0.25))
    before = best_grasps(pairs_of(found), search.costs.now()).time
    faster = search._polished(found)
    around = [len(planned.path) > 2 for planned in found.legs]
    assert sum(around)
    assert faster.time == pytest.approx(found.time - 0.25 * sum(around))
    assert best_grasps(pairs_of(found), search.costs.now()).time == pytest.approx(before - 0.25 * sum(around))
    for one, other, polished in zip(found.legs, faster.legs, around, strict=True):
        assert np.array_equal(other.path, one.path[::-1] if polished else one.path)


@pytest.mark.parametrize(("edge", "assignment"), [(CUBE, "free"), (CUBE, "given"), (0.9 * CUBE, "free")])
def test_only_cubes_that_are_alike_change_places(edge: float, assignment: str) -> None:
    case = task2(cubes=3)
    cubes = (replace(case.scene.cubes[0], shape=Box((edge,) * 3)), *case.scene.cubes[1:])
    case = replace(case, scene=replace(case.scene, cubes=cubes))
    search = search_of(case, replace(OPTIONS, assignment=assignment))
    given = edge != CUBE or assignment == "given"
    assert search.choices.assignment == (not given)
    if given:
        assert all(pick == place for pick, place in pairs_of(search.best()))


def test_a_cube_in_the_way_of_a_line_goes_first() -> None:
    changed = []
    for hemmed in (0, 1):
        case = beside_each_other(hemmed)
        q = case.transfers[hemmed].pick.T_base_tool[0]
        # the jaws move along the tool's y: across the gap or along it
        assert abs(apply(q, (0.0, 1.0, 0.0))[1] - q[1, 3]) > 0.9
        search = search_of(case, OPTIONS)
        free = best_order(search.choices, search.costs.now())  # nothing is known to be in the way yet
        found = search.best()
        order = [planned.leg.origin.site.number for planned in found.legs if planned.leg.carries]
        assert order == [1 - hemmed, hemmed]
        changed.append(free.stops[0].site.number == hemmed)
        assert found.time >= free.time - 1e-9
    assert any(changed)  # for one of the two, the order is another than without the cube in the way


def test_an_obstacle_that_joint_1_cannot_pass_is_named_without_a_search() -> None:
    """A post beside the turret, as high as the shoulder's rim: its corner comes by, whatever the other joints do."""
    way = np.radians(28.0)
    wall = Body(
        "low post",
        Box((0.03, 0.02, 0.28)),
        transform(rot_z(way), (0.122 * np.cos(way), 0.122 * np.sin(way), 0.14)),
        "wall",
    )
    case = task2(extra=[wall], cubes=1)
    with pytest.raises(ImpossibleError) as caught:
        plan_task(case.scene, case.transfers, Q_START, load_unit("crs93"), options=PlanOptions(look="never"))
    said = [entry["reason"] for entry in caught.value.data["rejected"]]
    assert any("joint 1 has to pass where shoulder" in reason and "low post" in reason for reason in said), (
        said
    )
