"""Chains through the layered graph of a curve: the fastest clear ones, and why there is none."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.se3 import Array, frozen, rot_z, transform
from plan.collision.world import World
from plan.curve.graph import CurveGraph
from plan.curve.tool_curve import ToolCurve
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches
from plan.kinematics.freedom import Freedom
from plan.kinematics.ik import nearest_turns
from plans.curves import CLEARANCE, LINE, PLATE, POST, arc
from tasks.pose_lists import TABLE, down

JUMP, HALF = 0.5, 0.12  # rad; a longer motion to the next station is no edge; its middle is checked too
TILTED = ToolCurve(LINE, Freedom({}, np.radians(30.0)), ("rz",))
ON_THE_SPOT = frozen(np.stack([down(0.42, 0.0, 0.12), down(0.42, 0.0, 0.12) @ transform(rot_z(0.8))]))


class PartlyBlocked:
    """A world in which a share of all configurations, always the same, is blocked."""

    def __init__(self, share: float, seed: int) -> None:
        self.share, self.seed = share, seed

    def blocked(self, q: Array) -> bool:
        return zlib.crc32(np.round(q, 7).tobytes(), self.seed) < self.share * 2**32

    def too_near(self, clearance: float) -> Callable[[Array], bool]:
        return self.blocked


def graph_of(robot: Robot, unit: Unit, curve: ToolCurve, *bodies: Body) -> CurveGraph:
    return CurveGraph(robot, curve, World(robot, [TABLE, *bodies]), CLEARANCE, unit.limits())


def eager(
    graph: CurveGraph, branch: int, blocked: Callable[[Array], bool], stations: int | None = None
) -> float:
    """Time of the fastest chain of a branch, of which all nodes and edges are checked; infinite if there is none.

    With `stations` it leads through the first ones only.
    """
    q, near = graph.q[:stations, :, branch], graph.samples.neighbours
    is_open = graph.reached[:stations, :, branch] & ~np.apply_along_axis(blocked, 2, q)
    best = np.where(is_open[0], 0.0, np.inf)
    for i in range(1, len(q)):
        after = np.full(len(best), np.inf)
        for b in np.flatnonzero(is_open[i]).tolist():
            for a in set(near[b].tolist()):
                step = q[i, b] - q[i - 1, a]
                size = np.abs(step).max()
                if np.isinf(best[a]) or size > JUMP:
                    continue
                if size > HALF and blocked(0.5 * (q[i, b] + q[i - 1, a])):
                    continue
                after[b] = min(after[b], best[a] + np.abs(step / graph.limits.velocity).max())
        best = after
    return float(best.min())


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
@pytest.mark.parametrize(
    "curve",
    [
        ToolCurve(LINE, Freedom({}), ("rz",)),
        ToolCurve(ON_THE_SPOT, Freedom({}, 0.2)),
        ToolCurve(ON_THE_SPOT, Freedom({"rz": (-0.5, 0.5), "x": (-0.02, 0.02)})),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_a_chain_is_as_fast_as_if_all_had_been_checked(
    robot: Robot, crs97: Unit, curve: ToolCurve, share: float, seed: int
) -> None:
    world = PartlyBlocked(share, seed)
    graph = CurveGraph(robot, curve, world, CLEARANCE, crs97.limits())  # type: ignore[arg-type]
    expected = [eager(graph, b, world.blocked) for b in range(len(BRANCH_NAMES))]
    found = list(graph.chains())
    assert {chain.branch for chain in found} == {
        name for name, time in zip(BRANCH_NAMES, expected, strict=True) if np.isfinite(time)
    }
    assert [chain.time for chain in found] == sorted(chain.time for chain in found)
    for chain in found:
        assert chain.time == pytest.approx(expected[BRANCH_NAMES.index(chain.branch)], abs=1e-6)
        assert not any(map(world.blocked, chain.q))
        for one, two in pairwise(chain.q):
            size = np.abs(two - one).max()
            assert size <= JUMP
            assert size <= HALF or not world.blocked(0.5 * (one + two))


@pytest.mark.parametrize(
    "curve", [TILTED, ToolCurve(arc(), Freedom({"z": (-0.03, 0.0)}), ("rz",)), ToolCurve(arc())]
)
def test_a_chain_has_the_tool_on_the_curve_and_the_joints_within_limits(
    robot: Robot, crs97: Unit, curve: ToolCurve
) -> None:
    graph, limits = graph_of(robot, crs97, curve), crs97.limits()
    found = list(graph.chains())
    assert found
    for chain in found:
        assert (chain.places[0], chain.places[-1]) == (0.0, curve.length)
        tools = np.stack([robot.T_base_tool(q) for q in chain.q])
        np.testing.assert_allclose(tools, curve.placed(chain.places, chain.coordinates), atol=1e-6)
        away, turned = curve.excess(chain.places, tools)
        assert max(away.max(), turned.max()) < 1e-6
        assert (chain.q >= limits.lower).all()
        assert (chain.q <= limits.upper).all()
        steps = np.abs(np.diff(chain.q, axis=0)) / limits.velocity
        assert chain.time == pytest.approx(steps.max(axis=1).sum(), abs=1e-6)


def test_a_chain_goes_round_what_blocks_it_in_one_place(robot: Robot, crs97: Unit) -> None:
    free = next(graph_of(robot, crs97, TILTED).chains())
    round_it = next(graph_of(robot, crs97, TILTED, POST).chains())
    world = World(robot, [TABLE, POST])
    assert any(world.in_collision(q, CLEARANCE) for q in free.q)
    assert not any(world.in_collision(q, CLEARANCE) for q in round_it.q)
    assert round_it.time > free.time


def test_a_path_out_of_reach_is_refused_with_its_first_place_that_is(robot: Robot, crs97: Unit) -> None:
    far = ToolCurve(np.stack([down(0.42, 0.0, 0.12), down(0.9, 0.0, 0.12)]), free=("rz",))
    graph = graph_of(robot, crs97, far)
    assert not list(graph.chains())
    error = graph.impossible("cut", CLEARANCE)
    done = error.data["done_m"]
    assert f"path 'cut': {1e3 * done:.0f} mm from its start, at ({420 + 1e3 * done:.0f}, 0, 120) mm" in str(
        error
    )
    assert "is out of reach with everything that is free there: in the nearest of all branches " in str(error)
    assert f"{1e3 * error.data['outside_m']:.1f} mm further than the links reach" in str(error)
    rng, T = np.random.default_rng(0), graph.curve.poses(np.array([done]))
    some = [
        all_branches(robot, T @ transform(rot_z(rng.uniform(-np.pi, np.pi)))).outside.min() for _ in range(50)
    ]
    assert 0.0 < error.data["outside_m"] <= min(some) + 0.002  # of samples at most 0.26 rad apart
    reached = graph.reached.any(axis=(1, 2))
    assert reached[graph.places < done].all()
    assert not reached[graph.places >= done].any()


def test_a_path_beyond_a_joint_limit_names_the_joint_of_the_best_branch_and_turn(
    robot: Robot, crs97: Unit
) -> None:
    """J1 has to turn further than it may, whatever else the tool does; J6 only fits with a turn that is free."""
    limits, place = crs97.limits(), np.array([0.42, 0.3])
    lower, upper = np.array(limits.lower), np.array(limits.upper)
    lower[0], upper[0] = -0.2, 0.2
    middle = nearest_turns(all_branches(robot, down(*place, 0.12)[None]).q[0], np.zeros(6))[0, 5] + 2.0
    lower[5], upper[5] = middle - 0.3, middle + 0.3
    limits = replace(limits, lower=frozen(lower), upper=frozen(upper))
    curve = ToolCurve(np.stack([down(*place, 0.12), down(*place, 0.15)]), free=("rz",))
    error = CurveGraph(robot, curve, World(robot, [TABLE]), CLEARANCE, limits).impossible("cut", CLEARANCE)
    assert error.data["joint"] == "J1"
    assert error.data["excess_rad"] == pytest.approx(np.arctan2(0.3, 0.42) - 0.2, abs=1e-6)
    assert f"has joint J1 {np.degrees(error.data['excess_rad']):.1f} deg beyond its limit" in str(error)


def test_a_blocked_path_is_refused_with_place_pair_and_distance(robot: Robot, crs97: Unit) -> None:
    """Every pose at the named place is nearer to something, and none by less than what is named."""
    graph = graph_of(robot, crs97, ToolCurve(LINE, free=("rz",)), PLATE)
    assert not list(graph.chains())
    error = graph.impossible("cut", 0.004)
    assert f"no sampled way along it keeps {1e3 * graph.clearance:g} mm (4 mm required" in str(error)
    assert error.data["clearance_m"] == 0.004
    assert error.data["pair"][1] == "plate"
    assert f"{error.data['pair'][0]} {1e3 * error.data['distance_m']:.1f} mm from plate" in str(error)
    done = error.data["done_m"]
    assert f"{1e3 * done:.0f} mm from its start, at (420, {1e3 * done - 100:.0f}, 120) mm" in str(error)
    i = int(np.argmin(np.abs(graph.places - done)))
    world = World(robot, [TABLE, PLATE])
    there = [world.distance(q).value for q in graph.q[i][graph.reached[i]]]
    assert max(there) < CLEARANCE
    assert error.data["distance_m"] == pytest.approx(max(there), abs=1e-6)


def test_a_path_on_which_no_solution_continues_is_refused_where_they_end(robot: Robot, crs97: Unit) -> None:
    """Every place can be reached, but not by one branch from end to end."""
    poses = np.stack([down(0.42, -0.1, 0.12), down(0.42, 0.12, 0.12)])
    ends = ToolCurve(poses, Freedom({"x": (-0.03, 0.03), "y": (-0.03, 0.03)}))
    graph = graph_of(robot, crs97, ends)
    assert graph.reached.any(axis=(1, 2)).all()
    assert not list(graph.chains())
    error = graph.impossible("cut", CLEARANCE)
    assert "no solution continues" in str(error)
    assert f"{1e3 * error.data['done_m']:.0f} mm from its start" in str(error)
    i = int(np.argmin(np.abs(graph.places - error.data["done_m"])))
    times = [
        [eager(graph, b, lambda q: False, last) for b in range(len(BRANCH_NAMES))] for last in (i, i + 1)
    ]
    assert np.isfinite(min(times[0]))
    assert np.isinf(min(times[1]))
