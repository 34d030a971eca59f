"""What callers give to the planner: configurations, limits, poses, options. Wrong input is refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Limits, load_unit
from arm.errors import InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from arms.made_up import RAIL, arm
from plan.budget import TransitBudget
from plan.cartesian.reachability import reach
from plan.collision.bezier import Curve, curve_of_waypoints
from plan.collision.certificate import BUDGET, certify_curve
from plan.collision.world import World
from plan.kinematics.configuration import check_configuration
from plan.kinematics.ik import explain_pose, inverse_kinematics
from plan.kinematics.numeric_ik import solve_ik
from plan.options import PlanOptions
from plan.pick_place.go_to import plan_joint_motion
from plan.pick_place.planner import plan_task
from plan.scene import Scene, Station
from plan.transit.planner import plan_transit
from plan.waypoints.planner import plan_poses
from plan.waypoints.target import Target
from tasks.task2 import Q_START, TABLE, Task2, task2

UNIT = load_unit("crs93")
LIMITS = UNIT.limits()
NAN, INF = float("nan"), float("inf")
HOME = np.array(Q_START)
BEYOND = HOME + np.array([np.radians(300.0) - Q_START[0], 0.0, 0.0, 0.0, 0.0, 0.0])
NO_CONFIGURATION = {
    "three numbers": [0.0, 1.0, 2.0],
    "two rows": np.zeros((2, 6)),
    "nothing": None,
    "text": "home",
    "texts": ["0"] * 6,
    "nan": [NAN, *HOME[1:]],
    "inf": [*HOME[:5], INF],
    "huge": np.full(6, 1e300),
    "empty": [],
    "ragged": [[0.0], [0.0, 1.0]],
}


@pytest.fixture(scope="module")
def case() -> Task2:
    return task2()


@pytest.fixture(scope="module")
def world(robot: Robot) -> World:
    return World(robot, [TABLE])


@pytest.mark.parametrize("which", [*NO_CONFIGURATION, "beyond"])
def test_every_door_refuses_a_place_where_the_arm_cannot_stand(
    which: str, case: Task2, world: World, robot: Robot
) -> None:
    q = BEYOND if which == "beyond" else NO_CONFIGURATION[which]
    target = Target("a", robot.T_base_tool(HOME))
    doors = {
        "q_start": [
            lambda: plan_task(case.scene, case.transfers, q, UNIT),
            lambda: plan_poses(robot, [], [target], q, LIMITS),
        ],
        "q_end": [lambda: plan_poses(robot, [], [target], HOME, LIMITS, q_end=q)],
        "q_from": [
            lambda: plan_joint_motion(case.scene, q, HOME, UNIT),
            lambda: plan_transit(world, q, HOME, LIMITS, 0.01, 0),
        ],
        "q_to": [
            lambda: plan_joint_motion(case.scene, HOME, q, UNIT),
            lambda: plan_transit(world, HOME, q, LIMITS, 0.01, 0),
        ],
    }
    for name, calls in doors.items():
        for call in calls if not (name == "q_end" and q is None) else []:
            with pytest.raises(InputError, match=f"^{name}") as caught:
                call()
            if which == "beyond":
                assert "joint J1 = 300.00 deg: must be from -168.52 to 171.48 deg" in str(caught.value)
                assert "-60.00 deg puts the tool at the same pose" in str(caught.value)
                assert caught.value.data["joint"] == robot.joint_names[0]
                assert caught.value.data["value"] == pytest.approx(np.radians(300.0))
                assert caught.value.data["high"] == LIMITS.upper[0]


def test_the_limit_itself_is_allowed_and_what_is_just_beyond_is_not(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        q = rng.uniform(LIMITS.lower, LIMITS.upper)
        k, upper = int(rng.integers(6)), bool(rng.integers(2))
        q[k] = LIMITS.upper[k] if upper else LIMITS.lower[k]
        assert np.array_equal(check_configuration("q", q, robot, LIMITS), q)
        q[k] += 1e-9 if upper else -1e-9
        with pytest.raises(InputError, match=f"joint {robot.joint_names[k]}"):
            check_configuration("q", q, robot, LIMITS)


def test_a_sliding_joint_is_told_of_in_millimetres(tmp_path) -> None:  # type: ignore[no-untyped-def]
    rail = arm(tmp_path, RAIL)
    limits = Limits(np.full(5, -0.6), np.full(5, 0.6), np.ones(5), np.ones(5))
    with pytest.raises(InputError, match=r"joint q1 = 700\.00 mm: must be from -600\.00 to 600\.00 mm"):
        check_configuration("q", [0.7, 0.0, 0.0, 0.0, 0.0], rail, limits)


def test_limits_of_another_arm_are_refused(world: World, case: Task2, robot: Robot) -> None:
    five = Limits(*(getattr(LIMITS, key)[:5] for key in ("lower", "upper", "velocity", "acceleration")))
    for call in (
        lambda: plan_transit(world, HOME, HOME, five, 0.01, 0),
        lambda: plan_task(case.scene, case.transfers, HOME, UNIT, five),
        lambda: plan_joint_motion(case.scene, HOME, HOME, UNIT, five),
        lambda: plan_poses(robot, [], [Target("a", robot.T_base_tool(HOME))], HOME, five),
        lambda: reach(robot, five, {"a": [robot.T_base_tool(HOME)]}, 0.1),
    ):
        with pytest.raises(InputError, match="given for 5 joints, the arm has 6"):
            call()


@pytest.mark.parametrize("which", [k for k in NO_CONFIGURATION if k != "huge"])
def test_a_world_is_asked_about_configurations(which: str, world: World) -> None:
    q = NO_CONFIGURATION[which]
    for call in (
        lambda: world.distances_below(q, 0.1),
        lambda: world.distance(q),
        lambda: world.in_collision(q, 0.01),
        lambda: world.pair_distances(q, np.arange(1)),
    ):
        with pytest.raises(InputError, match=r"^q.*must be 6 finite numbers"):
            call()


def test_a_row_of_a_plan_is_a_configuration(world: World) -> None:
    row = world.distances_below(HOME[None], 0.5)
    assert [d.value for d in row] == [d.value for d in world.distances_below(HOME, 0.5)]
    assert row
    assert world.distances_below(HOME.tolist(), INF)
    for limit in (NAN, "a", None):
        with pytest.raises(InputError, match="limit = "):
            world.distances_below(HOME, limit)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="clearance = "):
            world.in_collision(HOME, limit)  # type: ignore[arg-type]
    for q in (HOME, HOME[None, :3], np.full((1, 6), NAN)):
        with pytest.raises(InputError, match=r"must be \(m, 6\) finite numbers"):
            world.near(q, 0.1)


def test_a_world_is_made_of_bodies_at_poses(robot: Robot) -> None:
    held = Body("crate", Box((0.02, 0.02, 0.02)), transform(), "cube")
    for message, call in (
        ("T_tool_held.*lengths", lambda: World(robot, [], held, np.diag([2.0, 2.0, 2.0, 1.0]))),
        ("T_tool_held.*4x4", lambda: World(robot, [], held, np.eye(3))),
        (
            r"robot\.T_end_tool.*right-handed",
            lambda: World(replace(robot, T_end_tool=np.diag([-1.0, 1, 1, 1])), []),
        ),
        ("bodies: 'table': must be a Body", lambda: World(robot, ["table"])),  # type: ignore[list-item]
        ("padding = nan", lambda: World(robot, [], padding=NAN)),
        ("padding = -0.01 m", lambda: World(robot, [], padding=-0.01)),
        ("allowed: 'finger_l'.*pairs", lambda: World(robot, [TABLE], allowed=["finger_l", "table"])),  # type: ignore[list-item]
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_contacts_that_are_no_pairs_are_refused(robot: Robot) -> None:
    T = robot.T_base_tool(HOME)
    with pytest.raises(
        InputError, match="target 'a': allowed_collisions: 'finger_l': must be pairs of two names"
    ):
        Target("a", T, allowed_collisions=["finger_l", "table"])
    with pytest.raises(InputError, match="scene: allowed: 'finger_l': must be pairs of two names"):
        Scene(robot, robot, (TABLE,), (), ["finger_l", "table"])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="station 'a': touches = 'table'"):
        Station("a", (T,), "table")  # type: ignore[arg-type]


BROKEN = {
    "3x3": (np.eye(3), "4x4"),
    "scaled": (np.diag([2.0, 2.0, 2.0, 1.0]), "lengths 2, 2, 2"),
    "mirrored": (np.diag([1.0, -1.0, 1.0, 1.0]), "right-handed"),
    "nan": (np.full((4, 4), NAN), "not finite"),
    "text": ("pose", "4x4"),
    "nothing": (None, "4x4"),
}


@pytest.mark.parametrize("which", BROKEN)
def test_a_pose_to_reach_is_rigid(which: str, robot: Robot) -> None:
    T, message = BROKEN[which]
    good = robot.T_base_tool(HOME)
    with pytest.raises(InputError, match=rf"station '01-02/3': T_base_tool\[1\].*{message}"):
        Station("01-02/3", (good, T))
    with pytest.raises(InputError, match=f"hole 'h': pose 0.*{message}"):
        reach(robot, LIMITS, {"h": [T]}, 0.1)
    for solve in (inverse_kinematics, explain_pose, solve_ik):
        with pytest.raises(InputError, match=f"T_base_tool.*{message}"):
            solve(robot, T, LIMITS.lower, LIMITS.upper)
    if T is not None and np.shape(T) == (4, 4):
        with pytest.raises(InputError, match=rf"T_base_tool\[1\].*{message}"):
            inverse_kinematics(robot, [good, T], LIMITS.lower, LIMITS.upper)


def test_a_station_has_poses_in_a_row(robot: Robot) -> None:
    good = robot.T_base_tool(HOME)
    for wrong in ((), good, None, "abc"):
        with pytest.raises(InputError, match=r"station 'a'.*tuple of 4x4 poses"):
            Station("a", wrong)  # type: ignore[arg-type]
    assert Station("a", [good.tolist()]).T_base_tool[0].tolist() == good.tolist()  # type: ignore[arg-type]
    for wrong in (np.eye(4).ravel(), np.zeros((2, 3, 4, 4))):
        with pytest.raises(InputError, match="T_base_tool"):
            inverse_kinematics(robot, wrong, LIMITS.lower, LIMITS.upper)
    with pytest.raises(InputError, match=r"lower.*must be 6"):
        inverse_kinematics(robot, good, LIMITS.lower[:3], LIMITS.upper)


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("seed", [-1, 1.5, "x", None, True, NAN]),
        ("segment_ms", [40.5, "a", None, NAN, 10]),
        ("transit", [None, 3, "x"]),
        *(
            (key, ["a", None, NAN, -1.0, True, [0.5], INF])
            for key in (
                *(
                    "speed",
                    "velocity_fraction",
                    "acceleration_fraction",
                    "clearance",
                    "line_clearance",
                    "offset",
                ),
                *("approach_speed", "jerk_time", "fraction_closed", "settle_s"),
            )
        ),
        ("look", ["x", 0, 1.5, None, NAN]),
        ("order", [None, 3, ["free"]]),
    ],
)
def test_options_are_checked_when_they_are_made(key: str, values: list[object]) -> None:
    for value in values:
        with pytest.raises(InputError, match=f"^{key} = .*must be"):
            PlanOptions(**{key: value})  # type: ignore[arg-type]


def test_budgets_are_counts() -> None:
    for value in (-1, 1.5, "x", None, True):
        with pytest.raises(InputError, match=r"transit\.rrt = .*whole number from 0 on"):
            TransitBudget(rrt=value)  # type: ignore[arg-type]
    made = PlanOptions(seed=np.int64(3), speed=np.float32(0.5), segment_ms=np.int32(80))  # type: ignore[arg-type]
    assert [type(v) for v in (made.seed, made.speed, made.segment_ms)] == [int, float, int]
    with pytest.raises(InputError, match="seed = -1"):
        plan_transit(World(task2().scene.robot_open, []), HOME, HOME, LIMITS, 0.01, -1)


def test_a_curve_has_two_way_points_or_more_of_finite_numbers(world: World) -> None:
    for wrong in (
        [HOME],
        [],
        HOME,
        np.zeros((2, 0)),
        "way",
        None,
        [[0.0] * 6, [0.0] * 5],
        np.zeros((2, 2, 6)),
    ):
        with pytest.raises(InputError, match=r"waypoints = .*must be \(m, n\), two or more rows"):
            curve_of_waypoints(wrong)
    for bad in (NAN, INF):
        with pytest.raises(InputError, match=r"waypoints\[1\].*finite"):
            curve_of_waypoints([HOME, np.full(6, bad)])
        with pytest.raises(InputError, match="curve: a control point is not finite"):
            certify_curve(world, Curve(np.full((1, 4, 6), bad), np.ones(1)), 0.01)
        with pytest.raises(InputError, match="clearance = "):
            certify_curve(world, curve_of_waypoints([HOME, HOME]), bad)
    for n in (5, 7):
        with pytest.raises(
            InputError, match=r"must be \(m, 4, 6\) and \(m,\), m at least 1, for an arm of 6 joints"
        ):
            certify_curve(world, curve_of_waypoints(np.zeros((2, n))), 0.01)
    for curve in (
        Curve(np.zeros((0, 4, 6)), np.zeros(0)),
        Curve(np.zeros((4, 6)), np.zeros(1)),
        Curve(np.zeros((2, 4, 6)), np.zeros(1)),
    ):
        with pytest.raises(InputError, match="curve: control points of shape"):
            certify_curve(world, curve, 0.01)


def test_a_budget_that_is_spent_proves_nothing(monkeypatch, world: World) -> None:  # type: ignore[no-untyped-def]
    spin = curve_of_waypoints(
        [HOME, HOME + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2000.0])]
    )  # the jaws, round and round
    checked = certify_curve(world, spin, 0.005)
    assert checked.proved
    assert checked.evaluations < BUDGET
    monkeypatch.setattr("plan.collision.certificate.BUDGET", 20)
    spent = certify_curve(world, spin, 0.005)
    assert not spent.proved
    assert spent.clearance < 0.005 <= spent.seen  # not proved, which is not the same as too near
    assert spent.evaluations < checked.evaluations
