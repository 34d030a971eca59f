"""Paths of programs: there and back on one certified path of the joints, as sent on the curve and under its speed."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import Move, Pause
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Cylinder
from arm.robot.tool import urdf_limits
from arm.se3 import Array, transform
from arms.made_up import UR5, arm
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.paths import PathMoves
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.program.setting import Setting
from plan.scene import Scene
from plans.curves import CLEARANCE, LINE, PLATE, POST, arc
from plans.waypoints import Q_START, planned, refusal_of
from tasks.pose_lists import EFFORT, FAST, TABLE, check_plan, down

OFF_PATH = 1e-4  # m, largest deviation of the tool as it is sent
ENDS = 5e-5  # m and rad, of its ends: a path ends at whole counts, and within its tolerance
DRAWN = Target("draw", arc(), free="rz", by="path", back=True, dwell_s=0.4)
ASIDE = Body("post", Cylinder(0.01, 0.3), transform(t=(0.485, 0.02, 0.1)), "post")
# over this wall the pen has to lift
WALL = Body("wall", Box((0.2, 0.02, 0.1)), transform(t=(0.42, 0.01, 0.06)), "wall")


@pytest.fixture(scope="module")
def drawn(robot: Robot, crs97: Unit) -> Planned:
    return planned(robot, crs97, [TABLE], DRAWN, q_end=Q_START)


def along(plan: Planned, name: str = "along") -> list[Move]:
    """The moves along paths, out and back."""
    return [move for move in plan.moves if name in move.name]


def tools_of(plan: Planned, move: Move) -> tuple[Array, Array]:
    """Configurations and tool poses of a move at every ms, as sent."""
    q = plan.unit.positions(move.path.sample(1e-3))
    return q, np.stack([plan.robot.T_base_tool(one) for one in q])


def check_sent(plan: Planned, target: Target) -> None:
    """What holds for every path as it is sent."""
    for move in along(plan):
        _, tools = tools_of(plan, move)
        off = target.curve.deviation(tools)
        assert off.distance.max() <= OFF_PATH
        assert off.angle.max() <= 2e-3
        assert move.certified
        assert move.clearance >= CLEARANCE
        if target.speed is not None:
            speeds = np.linalg.norm(np.diff(tools[:, :3, 3], axis=0), axis=1) / 1e-3
            assert speeds.max() <= 1.01 * target.speed  # segments are in whole counts


def test_a_path_there_and_back_acts_at_its_far_end_and_goes_on_home(drawn: Planned, crs97: Unit) -> None:
    check_plan(drawn, [DRAWN], crs97.limits(), ENDS)
    check_sent(drawn, DRAWN)
    names = [(type(step).__name__, step.name) for step in drawn.steps]
    assert names == [
        ("Move", "to draw"),
        ("Move", "along draw"),
        ("Pause", "draw"),
        ("Move", "back along draw"),
        ("Move", "to q_end"),
    ]
    (pause,) = (step for step in drawn.steps if isinstance(step, Pause))
    assert pause.dwell_s == pytest.approx(DRAWN.dwell_s)
    far, end = drawn.reached[0].T_base_tool[:3, 3], DRAWN.curve.T_end[:3, 3]
    np.testing.assert_allclose(far, end, atol=OFF_PATH)
    assert np.array_equal(drawn.moves[-1].path.end, crs97.counts(Q_START))


def test_the_way_back_is_the_way_out(drawn: Planned) -> None:
    """In the joints: each configuration of the way back is one of the way out, to the rounding of both."""
    (out, back) = along(drawn)
    q_out, tools_out = tools_of(drawn, out)
    q_back, tools_back = tools_of(drawn, back)
    for one in q_back[::100]:
        assert np.abs(q_out - one).max(axis=1).min() < 1e-3
    for tools, order in ((tools_out, 1.0), (tools_back, -1.0)):
        places = DRAWN.curve.nearest(tools[:, :3, 3])
        assert (order * np.diff(places)).min() > -1e-5
        assert np.ptp(places) == pytest.approx(DRAWN.curve.length, abs=1e-3)


def test_the_same_list_gives_the_same_plan(drawn: Planned, robot: Robot, crs97: Unit) -> None:
    again = planned(robot, crs97, [TABLE], DRAWN, q_end=Q_START)
    assert [move.path for move in again.moves] == [move.path for move in drawn.moves]


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("more", "bodies"),
    [
        ({"free": "rz", "T_base_tool": arc()}, []),
        ({"ranges": {"z": (-0.09, 0.0)}, "free": "rz"}, [WALL]),
        ({"tilt": 0.5, "free": "rz"}, [POST]),
    ],
)
def test_the_tool_is_as_fast_as_allowed_and_no_faster(
    robot: Robot, crs97: Unit, more: dict[str, Any], bodies: list[Body]
) -> None:
    target = Target(**{"name": "p", "T_base_tool": LINE, "by": "path", "speed": 0.05, **more})
    plan = planned(robot, crs97, [TABLE, *bodies], target)
    check_sent(plan, target)
    (move,) = along(plan)
    assert move.path.duration_s < 1.5 * target.curve.length / 0.05 + 1.0


@pytest.mark.few(1)
@pytest.mark.parametrize("options", [PlanOptions(speed=1.0, jerk_time=0.2), PlanOptions(speed=0.6)])
def test_paths_follow_the_options_of_motions(robot: Robot, crs97: Unit, options: PlanOptions) -> None:
    target = Target("p", LINE, by="path", tilt=0.2, free="rz")
    check_sent(planned(robot, crs97, [TABLE], target, options=options), target)


@pytest.mark.slow
def test_the_clearance_may_be_the_aim(robot: Robot, crs97: Unit) -> None:
    """Past a post: of all bodies, or of the post alone."""
    found = {}
    for aim, of in (("time", ()), ("clearance", ()), ("clearance", ("post",))):
        target = Target("p", LINE, by="path", tilt=0.26, clearance_of=of)
        plan = planned(robot, crs97, [TABLE, ASIDE], target, options=PlanOptions(speed=1.0, aim=aim))
        check_sent(plan, target)
        (found[aim, of],) = (move.clearance for move in along(plan))
    assert min(found["clearance", ()], found["clearance", ("post",)]) > found["time", ()] + 5e-3


def test_a_path_without_a_stop_at_its_ends(robot: Robot, crs97: Unit) -> None:
    """The transit blends into the path: the arm is not at rest where they meet, with free positions too."""
    pin = Body("pin", Cylinder(0.01, 0.2), transform(t=(0.42, 0.01, 0.02)), "pin")
    for ranges, bodies in (({}, []), ({"x": (-0.09, 0.09)}, [pin])):
        target = Target("p", LINE, by="path", free="rz", ranges=ranges)
        plan = planned(robot, crs97, [TABLE, *bodies], target, q_end=Q_START)
        for before, after in pairwise(plan.moves):
            q = [plan.unit.positions(move.path.at([t])[0]) for move, t in ((before, 1e9), (after, 0.01))]
            assert np.abs(q[1] - q[0]).max() > 1e-3


@pytest.mark.slow
def test_paths_among_other_targets(robot: Robot, crs97: Unit) -> None:
    """Before a path there is a transit; after it a line may follow, from its end or with `back` from its start."""
    targets = [
        Target("over", down(0.4, -0.2, 0.15), free="rz"),
        Target("across", LINE, free="rz", by="path"),
        Target("up", LINE[1] @ transform(t=(0.0, 0.0, -0.04)), by="line", free="rz"),
        Target("draw", arc(), free="rz", by="path", back=True),
        Target("off", arc()[0] @ transform(t=(0.0, 0.0, -0.04)), by="line", free="rz"),
        Target("erase", arc()[::-1], free="rz", by="path"),
    ]
    plan = planned(robot, crs97, [TABLE], *targets)
    check_plan(plan, targets, crs97.limits(), ENDS)
    for index in (1, 5):
        for move in along(plan, f"along {targets[index].name}"):
            off = targets[index].curve.deviation(tools_of(plan, move)[1])
            assert off.distance.max() <= OFF_PATH
    assert [move.name for move in plan.moves][2:] == [
        "along across",
        "line to up",
        "to draw",
        "along draw",
        "back along draw",
        "line to off",
        "to erase",
        "along erase",
    ]


@pytest.mark.few(1)
@pytest.mark.parametrize("more", [{}, {"free": "rz", "tilt": 0.2}])
def test_a_path_goes_on_where_the_one_before_ends(robot: Robot, crs97: Unit, more: dict[str, Any]) -> None:
    """Round a corner: the arm stops there, but needs no transit."""
    aside = np.stack([LINE[1], transform(t=(-0.06, 0.0, 0.0)) @ LINE[1]])
    targets = [Target("a", LINE, by="path", **more), Target("b", aside, by="path", **more)]
    plan = planned(robot, crs97, [TABLE], *targets)
    assert [move.name for move in plan.moves][-2:] == ["along a", "along b"]
    for target in targets:
        (move,) = along(plan, f"along {target.name}")
        off = target.curve.deviation(tools_of(plan, move)[1])
        assert off.distance.max() <= OFF_PATH
        assert move.clearance >= CLEARANCE
    first, second = along(plan)
    assert first.path.end == second.path.start


def test_a_path_with_less_freedom_than_the_one_before_begins_with_a_transit(
    robot: Robot, crs97: Unit
) -> None:
    """The tool ends tilted and turned; the next path has to begin upright."""
    aside = np.stack([LINE[1], transform(t=(-0.03, 0.0, 0.0)) @ LINE[1]])
    targets = [Target("a", LINE, by="path", free="rz", tilt=0.5), Target("b", aside, by="path")]
    plan = planned(robot, crs97, [TABLE], *targets)
    assert [move.name for move in plan.moves][-3:] == ["along a", "to b", "along b"]


@pytest.mark.parametrize(
    ("target", "bodies", "says"),
    [
        (
            Target("p", LINE, by="path", free="rz"),
            [PLATE],
            r"path 'p': no sampled way .* from its start.* from plate",
        ),
        (
            Target("p", np.stack([down(0.4, 0.0, 0.1), down(0.9, 0.0, 0.1)]), by="path", free="rz"),
            [],
            r"path 'p': \d+ mm from its start, .* out of reach",
        ),
    ],
)
def test_refusals_name_the_place(
    robot: Robot, crs97: Unit, target: Target, bodies: list[Body], says: str
) -> None:
    error = refusal_of(robot, crs97, [TABLE, *bodies], target)
    assert error.data["target"] == "p"
    assert 0.0 < error.data["done_m"] < target.curve.length
    with pytest.raises(ImpossibleError, match=says):
        raise error


def moves_of(robot: Robot, unit: Unit, *targets: Target) -> PathMoves:
    scene = Scene(robot, robot, (TABLE,), ())
    return PathMoves(Setting(scene, unit, unit.limits(), FAST), AttachmentWorlds(scene, list(targets)))


def test_a_move_begins_where_its_solution_is_and_is_planned_once(robot: Robot, crs97: Unit) -> None:
    moves = moves_of(robot, crs97, Target("p", LINE, by="path", free="rz", tilt=0.2, speed=0.07))
    found = moves.solutions(0)
    assert 1 < len(found.q) <= 4
    assert len(set(found.branch)) == len(found.q)
    for q in found.q[:2]:
        move = moves.move(0, q)
        assert move is moves.move(0, q)
        assert (move.role, move.target, move.speed) == ("line", 0, 0.07)
        away = move.line.deviation(robot.T_base_tool(move.path.q[0])[None], None, np.zeros(1))
        assert away.distance[0] < 1e-5
        assert np.array_equal(move.reversed().path.q, move.path.q[::-1])
    assert not np.array_equal(moves.move(0, found.q[0]).path.q, moves.move(0, found.q[1]).path.q)


def test_an_arm_without_closed_form_is_refused(tmp_path: Path) -> None:
    robot = arm(tmp_path, UR5, [("l0", "l2")])
    with pytest.raises(InputError, match=r"target 'p': by = 'path': needs an arm with closed-form inverse"):
        plan_poses(
            robot,
            [],
            [Target("p", LINE, by="path")],
            [-0.9, -0.6, 1.2, 0.4, 1.57, 0.0],
            urdf_limits(robot, 4.0),
            options=FAST,
            effort=EFFORT,
        )
