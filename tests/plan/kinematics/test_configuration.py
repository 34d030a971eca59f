"""Configurations: one finite number per joint, within the limits."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Limits, load_unit
from arm.errors import InputError
from arm.robot.model import Robot
from arms.made_up import RAIL, arm
from plan.cartesian.reachability import reach
from plan.collision.world import World
from plan.kinematics.configuration import check_configuration
from plan.program.go_to import plan_joint_motion
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from plan.program.tasks import plan_task
from plan.transit.planner import plan_transit
from plans.given import HOME, NO_CONFIGURATION
from tasks.task2 import Q_START, TABLE, Task2, task2

UNIT = load_unit("crs93")

LIMITS = UNIT.limits()

BEYOND = HOME + np.array([np.radians(300.0) - Q_START[0], 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def case() -> Task2:
    return task2()


@pytest.fixture(scope="module")
def world(robot: Robot) -> World:
    return World(robot, [TABLE])


@pytest.mark.parametrize("which", [*NO_CONFIGURATION, "beyond"])
def test_every_planner_refuses_an_invalid_configuration(
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


def test_a_prismatic_joint_is_reported_in_millimetres(tmp_path) -> None:  # type: ignore[no-untyped-def]
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
