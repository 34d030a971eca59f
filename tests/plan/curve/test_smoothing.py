"""Smoothing: never slower, and the tool stays on the curve, the joints within limits, and both clear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.se3 import Array, frozen, transform
from plan.collision.world import Near, World
from plan.curve.graph import CurveGraph
from plan.curve.smoothing import Demand, Followed, Smoothing
from plan.curve.step_program import Rows
from plan.curve.tool_curve import ToolCurve, directions
from plan.kinematics.freedom import Freedom
from plans.curves import CLEARANCE, LINE, POST, arc, some_coordinates
from tasks.pose_lists import TABLE

MARGIN = 5e-4  # m, of the chain beyond the clearance of the smoothing
LOW = ToolCurve(transform(t=(0.0, 0.0, -0.14)) @ LINE, Freedom({"z": (-0.02, 0.005)}))  # over the table
CASES = {
    "turning": (ToolCurve(arc(), free=("rz",)), []),
    "tilting": (ToolCurve(LINE, Freedom({}, 0.5), ("rz",)), [POST]),
    "shifting": (ToolCurve(LINE, Freedom({"x": (-0.06, 0.06), "y": (-0.03, 0.06)})), []),
    "ranges": (ToolCurve(arc(), Freedom({"rx": (-0.3, 0.1), "rz": (-1.0, 0.3), "z": (-0.02, 0.0)})), []),
}
GAIN = {"turning": 1.0, "tilting": 0.8, "shifting": 0.6, "ranges": 0.65}  # of the chain's time, at most


@pytest.fixture(scope="module", params=list(CASES))
def case(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def begun(robot: Robot, crs97: Unit, case: str) -> tuple[Smoothing, Followed]:
    return way_along(robot, crs97, *CASES[case])


def way_along(robot: Robot, unit: Unit, curve: ToolCurve, bodies: list[Body]) -> tuple[Smoothing, Followed]:
    """The smoothing of a curve, and its fastest chain as it begins."""
    world, limits = World(robot, [TABLE, *bodies]), unit.limits()
    chain = next(CurveGraph(robot, curve, world, CLEARANCE + MARGIN, limits).chains())
    smoothing = Smoothing(
        robot, curve, world, [Demand(CLEARANCE, np.ones(len(world.pairs), dtype=bool))], limits
    )
    coordinates = np.array(chain.coordinates)
    coordinates[:, 5] = np.unwrap(coordinates[:, 5])
    way = smoothing.at(chain.places, coordinates, chain.q)
    assert way is not None
    return smoothing, way


def check(robot: Robot, smoothing: Smoothing, way: Followed) -> None:
    """What holds for every way."""
    tools = np.stack([robot.T_base_tool(q) for q in way.q])
    np.testing.assert_allclose(tools, smoothing.curve.placed(way.places, way.coordinates), atol=1e-6)
    away, turned = smoothing.curve.excess(way.places, tools)
    assert max(away.max(), turned.max()) < 2e-6
    assert (way.q >= smoothing.limits.lower).all()
    assert (way.q <= smoothing.limits.upper).all()
    for demand in smoothing.demands:
        for q in np.concatenate([way.q, 0.5 * (way.q[1:] + way.q[:-1])]):
            assert smoothing.world.distance(q).value >= demand.clearance


@pytest.mark.few(2)
def test_a_smoothed_way_is_faster_on_the_curve_within_limits_and_clear(
    robot: Robot, begun: tuple[Smoothing, Followed], case: str
) -> None:
    smoothing, way = begun
    check(robot, smoothing, way)
    times = [smoothing.time(way)]
    for rounds in (1, 1, 4, 14):
        way = smoothing.smoothed(way, rounds)
        check(robot, smoothing, way)
        times.append(smoothing.time(way))
    assert times == sorted(times, reverse=True)
    assert times[-1] <= GAIN[case] * times[0]


def test_a_step_into_a_body_is_not_taken(robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Distances are linearised, so a step may come too near: here the program knows of none."""
    smoothing, way = way_along(robot, crs97, *CASES["tilting"])
    whole = Rows.of_distances

    def none(near: Near, D: Array, room: Array, missing: bool) -> Rows:
        return whole(near.chosen(near.distance < -np.inf), D, room[:0], missing)

    monkeypatch.setattr(Rows, "of_distances", staticmethod(none))
    check(robot, smoothing, smoothing.smoothed(way, 8))
    check(robot, smoothing, smoothing.widened(way, 4, smoothing.world.pairs_of(["table"])))


def test_a_step_that_does_not_help_is_not_taken(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every step leads the other way."""
    for case in (CASES["ranges"], (LOW, [])):
        smoothing, way = way_along(robot, crs97, *case)
        step, of = smoothing._step, smoothing.demands[0].pairs
        monkeypatch.setattr(smoothing, "_step", lambda *given, step=step, **named: -step(*given, **named))
        assert smoothing.time(smoothing.smoothed(way, 4)) <= smoothing.time(way)
        assert smoothing.least(smoothing.widened(way, 4, of), of) >= smoothing.least(way, of)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("curve", "bodies", "names"),
    [(*CASES["tilting"], ()), (LOW, [], ("table",))],
)
def test_a_widened_way_has_more_distance_and_keeps_what_is_asked_for(
    robot: Robot, crs97: Unit, curve: ToolCurve, bodies: list[Body], names: tuple[str, ...]
) -> None:
    """Of all pairs, or of those of the table alone."""
    smoothing, way = way_along(robot, crs97, curve, bodies)
    of = smoothing.world.pairs_of(names) if names else smoothing.demands[0].pairs
    alone = smoothing.world.only(names) if names else smoothing.world
    least = [smoothing.least(way, of)]
    for rounds in (1, 15):
        way = smoothing.widened(way, rounds, of)
        check(robot, smoothing, way)
        least.append(smoothing.least(way, of))
        assert least[-1] == pytest.approx(min(alone.distance(q).value for q in way.all_q), abs=1e-9)
    assert least == sorted(least)
    assert least[-1] > least[0] + 3e-3


def test_a_step_is_within_the_trust_region_and_what_is_free(
    robot: Robot, begun: tuple[Smoothing, Followed]
) -> None:
    smoothing, way = begun
    low, high = smoothing.curve.box()
    for region in (1.0, 0.3):
        step = smoothing._step(way, smoothing._program(way, None), region, False)
        assert step is not None
        for k, column in enumerate(smoothing.columns):
            assert np.abs(step[:, k]).max() <= region * (0.006 if column < 3 else 0.25) + 1e-9
            c = way.coordinates[:, column] + step[:, k]
            assert (c >= low[column] - 1e-6).all()
            assert (c <= high[column] + 1e-6).all()


@pytest.mark.parametrize(("case", "side", "joint"), [("tilting", -1, 3), ("ranges", -1, 4)])
def test_a_step_keeps_room_to_a_joint_limit_that_it_would_cross(
    robot: Robot, crs97: Unit, case: str, side: int, joint: int
) -> None:
    """Else its curvature, and what lies between stations, ends beyond the limit, and no step is taken."""
    smoothing, way = way_along(robot, crs97, *CASES[case])
    faster = smoothing.smoothed(way, 24)
    limit = (side * way.q[:, joint]).max()  # where the way touches it
    assert (side * faster.q[:, joint]).max() > limit + 0.05
    limits = smoothing.limits
    bound = np.array(limits.upper if side > 0 else limits.lower)
    bound[joint] = side * limit
    limits = replace(limits, **{"upper" if side > 0 else "lower": frozen(bound)})
    near = Smoothing(robot, smoothing.curve, smoothing.world, smoothing.demands, limits)
    step = near._step(way, near._program(way, None), 1.0, False)
    assert step is not None
    then = way.q[:, joint] + (near._derivatives(way) @ step[..., None])[:, joint, 0]
    assert (side * then).max() <= limit - 0.9e-3
    assert near.time(near.smoothed(way, 24)) < 0.95 * near.time(way)


def test_the_derivatives_keep_the_tool_where_the_coordinates_say(
    robot: Robot, begun: tuple[Smoothing, Followed]
) -> None:
    """The joints that follow a small change of the coordinates lead to the changed pose, to second order."""
    smoothing, way = begun
    D, size = smoothing._derivatives(way), 1e-4
    assert D.shape == (len(way.q), 6, len(smoothing.columns))
    for k, column in enumerate(smoothing.columns):
        coordinates = np.array(way.coordinates)
        coordinates[:, column] += size
        wanted = smoothing.curve.placed(way.places, coordinates)
        tools = np.stack([robot.T_base_tool(q) for q in way.q + size * D[:, :, k]])
        np.testing.assert_allclose(tools, wanted, atol=20.0 * size**2)


def test_a_finer_way_keeps_its_stations_and_has_more_where_they_are_asked_for(
    robot: Robot, begun: tuple[Smoothing, Followed]
) -> None:
    smoothing, way = begun
    steps = np.random.default_rng(1).uniform(size=len(way.places) - 1) < 0.4
    finer = smoothing.finer(way, steps)
    assert finer is not None
    middles = 0.5 * (way.places[1:] + way.places[:-1])[steps]
    np.testing.assert_allclose(finer.places, np.sort(np.concatenate([way.places, middles])), atol=1e-12)
    old = np.isin(finer.places, way.places)
    assert old.sum() == len(way.places)
    np.testing.assert_allclose(finer.coordinates[old], way.coordinates, atol=1e-12)
    np.testing.assert_allclose(finer.q[old], way.q, atol=1e-6)
    tools = np.stack([robot.T_base_tool(q) for q in finer.q])
    away, turned = smoothing.curve.excess(finer.places, tools)
    assert max(away.max(), turned.max()) < 2e-6


@pytest.mark.parametrize("seed", range(3))
def test_coordinates_are_moved_into_their_limits_and_not_within_them(case: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    curve = CASES[case][0]
    smoothing = object.__new__(Smoothing)  # the limits of a curve alone
    smoothing.columns, smoothing.tilt = directions(curve), curve.freedom.tilt
    smoothing.low, smoothing.high = (side[smoothing.columns] for side in curve.box())
    inside = some_coordinates(rng, curve, 50)
    kept = np.array(inside)
    smoothing._within(kept)
    np.testing.assert_allclose(kept, inside, atol=1e-12)
    beyond = np.zeros((50, 6))
    beyond[:, smoothing.columns] = rng.normal(size=(50, len(smoothing.columns)))
    smoothing._within(beyond)
    places = np.zeros(50)
    away, turned = curve.excess(places, curve.placed(places, beyond))
    assert max(away.max(), turned.max()) < 1e-9


def test_what_has_no_freedom_is_not_smoothed(robot: Robot, crs97: Unit) -> None:
    smoothing, way = way_along(robot, crs97, ToolCurve(LINE), [])
    assert smoothing.smoothed(way, 5) is way


def test_a_way_is_refused_that_the_joints_cannot_follow(robot: Robot, crs97: Unit) -> None:
    smoothing, way = way_along(robot, crs97, *CASES["turning"])
    low = replace(smoothing.limits, upper=frozen(way.q.max(axis=0) - 0.01))
    cramped = Smoothing(robot, smoothing.curve, smoothing.world, [], low)
    assert cramped.at(way.places, way.coordinates, way.q) is None
    turned = np.array(way.coordinates)
    turned[:, 5] += 1.0  # farther than a solution near q may be
    assert smoothing.at(way.places, turned, way.q) is None


class AllBut:
    """A world in which one configuration is too near to something, and no other."""

    def __init__(self, one: Array) -> None:
        self.one, self.pairs = one, np.zeros((1, 2), dtype=np.intp)

    def near(self, q: Array, limits: Array) -> Near:
        row = np.flatnonzero((q == self.one).all(axis=1))
        return Near(row, np.zeros_like(row), np.full(len(row), CLEARANCE / 2.0), np.zeros((len(row), 6)))


def test_a_way_is_blocked_at_a_station_or_between_two(robot: Robot, crs97: Unit) -> None:
    smoothing, way = way_along(robot, crs97, *CASES["ranges"])
    assert not smoothing.blocked(way)

    smoothing.demands = (Demand(CLEARANCE, np.ones(1, dtype=bool)),)
    for one, blocked in (
        (way.q[7], True),
        (0.5 * (way.q[7] + way.q[8]), True),
        (way.q[7] + 1e-6, False),
    ):
        smoothing.world, smoothing._seen = AllBut(one), None  # type: ignore[assignment]
        assert smoothing.blocked(way) == blocked
