"""A plan of no unit states its arm: the file alone gives the worlds and the limits again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import FileInputError
from arm.plan_file import Plan, read_plan, write_plan
from arm.robot.model import load_a465
from plan.options import PlanOptions
from plan.program.go_to import plan_joint_motion
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.program import Program, plan_program
from plan.program.stated_arm import stated_arm, stated_options
from plan.scene import Scene
from plan.trajectory.virtual_unit import NO_UNIT, virtual_unit
from plan.verify import replay
from plans.other_arms import OTHER_ARMS, six_joints

FILE = Path("plan.json")


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return six_joints(tmp_path_factory.mktemp("arm")).plan()


@pytest.mark.parametrize("make", OTHER_ARMS.values(), ids=OTHER_ARMS)
def test_the_file_alone_verifies_the_plan(make: Callable[[Path], Planned], tmp_path: Path) -> None:
    planned = make(tmp_path)
    write_plan(tmp_path / "plan.json", planned.plan())
    read = read_plan(tmp_path / "plan.json")
    assert (read, read.unit) == (planned.plan(), NO_UNIT)
    arm = stated_arm(tmp_path / "plan.json", read)
    assert arm.robot_open.joint_names == planned.robot.joint_names
    for name, value in vars(planned.setting.limits).items():
        assert np.array_equal(getattr(arm.limits, name), value), name
    verified = replay(read, arm.scene(read), arm.unit, arm.limits)
    assert [m.move.name for m in verified] == [m.name for m in planned.moves]
    assert all(m.check.clearance >= m.move.clearance - 2e-6 for m in verified)
    options, asked = stated_options(tmp_path / "plan.json", read), planned.setting.options
    assert (options.speed, options.velocity_fraction) == (asked.speed, asked.velocity_fraction)


def test_jaws_that_differ_are_both_stated_and_a_unit_is_enough_of_an_arm() -> None:
    robots = load_a465(0.134112, 0.06), load_a465(0.134112, 0.04)
    scene, limits = Scene(*robots, (), ()), load_unit("crs93").limits()
    q = np.radians([[-60, -40, -80, 0, -60, 0], [-50, -40, -80, 0, -60, 0]])
    goal = (Target("aside", q=q[1]),)
    options = PlanOptions(speed=1.0)
    unit = virtual_unit(robots[0], limits)
    stated = plan_program(Program(scene, goal, q[0], unit, limits, options)).plan()
    arm = stated_arm(FILE, stated)
    assert [r.digest for r in (arm.robot_open, arm.robot_holding)] == [r.digest for r in robots]
    assert arm.robot_open.locked != arm.robot_holding.locked
    of_unit = plan_joint_motion(scene, q[0], q[1], load_unit("crs93"), options=options)
    assert of_unit.arm == {}
    assert '"arm"' not in of_unit.to_json()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda arm: {}, "arm: is missing, and a plan with unit none needs it (plan again"),
        (lambda arm: {"open": arm["open"]}, "arm.limits: is missing"),
        (lambda arm: _limits(arm, velocity=[1.0, 0.0, 1, 1, 1, 1]), "arm.limits: limits: velocity[1] = 0: must be"),
        (lambda arm: _limits(arm, lower=[9.0] * 6), "arm.limits: limits: lower[0] = 9 is above"),
        (lambda arm: _limits(arm, **{k: [1.0] for k in arm["limits"]}), "speed_registers = 6: must be as many as"),
        (lambda arm: {**arm, "holding": _shorter(arm["open"])}, "speed_registers = 6: must be as many as"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_stated_arm_is_told(plan: Plan, change: Any, told: str) -> None:
    with pytest.raises(FileInputError) as refusal:
        stated_arm(FILE, replace(plan, arm=change(plan.arm)))
    assert f"plan.json: {told}" in str(refusal.value)


def test_the_speed_and_both_fractions_are_those_of_the_file(plan: Plan) -> None:
    stated = {"options": {"velocity_fraction": 0.6, "acceleration_fraction": 0.3}}
    options = stated_options(FILE, replace(plan, speed=0.25, provenance=stated))
    assert (options.speed, options.velocity_fraction, options.acceleration_fraction) == (0.25, 0.6, 0.3)


def test_fractions_of_the_limits_have_to_be_stated(plan: Plan) -> None:
    with pytest.raises(FileInputError, match=r"provenance.options.velocity_fraction: is missing"):
        stated_options(FILE, replace(plan, provenance={"options": {}}))
    with pytest.raises(FileInputError, match=r"plan.json: provenance.options"):
        stated_options(FILE, replace(plan, provenance={}))


def _limits(arm: dict[str, Any], **changed: Any) -> dict[str, Any]:
    return {**arm, "limits": {**arm["limits"], **changed}}


def _shorter(robot: dict[str, Any]) -> dict[str, Any]:
    joints = robot["joints"][:-1]
    bodies = [body for body in robot["bodies"] if body["joint"] <= len(joints)]
    return {**robot, "joints": joints, "bodies": bodies, "digest": "other"}
