"""What callers give to the planner: configurations, limits, poses, options. Wrong input is refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.budget import TransitBudget
from plan.cartesian.reachability import reach
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import BUDGET, certify_curve
from plan.collision.world import World
from plan.kinematics.ik import explain_pose, inverse_kinematics
from plan.kinematics.numeric_ik import solve_ik
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.scene import Scene, Station
from plan.transit.planner import plan_transit
from plans.given import HOME, INF, NAN, NO_CONFIGURATION
from tasks.task2 import TABLE, task2

UNIT = load_unit("crs93")

LIMITS = UNIT.limits()


@pytest.fixture(scope="module")
def world(robot: Robot) -> World:
    return World(robot, [TABLE])


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


def test_contacts_must_be_pairs(robot: Robot) -> None:
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
        ("solver", [None, "quadprog", "OSQP"]),
        ("timing", [None, "topp", True]),
    ],
)
def test_options_are_checked_when_they_are_made(key: str, values: list[object]) -> None:
    for value in values:
        with pytest.raises(InputError, match=f"^{key} = .*must be"):
            PlanOptions(**{key: value})  # type: ignore[arg-type]


def test_budgets_are_counts() -> None:
    for value in (-1, 1.5, "x", None, True):
        with pytest.raises(InputError, match=r"transit\.rrt = .*whole number, 0 or more"):
            TransitBudget(rrt=value)  # type: ignore[arg-type]
    made = PlanOptions(seed=np.int64(3), speed=np.float32(0.5), segment_ms=np.int32(80))  # type: ignore[arg-type]
    assert [type(v) for v in (made.seed, made.speed, made.segment_ms)] == [int, float, int]
    with pytest.raises(InputError, match="seed = -1"):
        plan_transit(World(task2().scene.robot_open, []), HOME, HOME, LIMITS, 0.01, -1)


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
