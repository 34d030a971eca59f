"""The arm that a plan file states, because no controller's unit and no cell file does: with it the plan is complete."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.controller.unit import Limits, Unit
from arm.errors import FileInputError, InputError
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import number, numbers
from arm.plan_file import Plan
from arm.robot.description import robot_from_json, robot_to_json
from arm.robot.model import Robot
from arm.se3 import Array
from plan.options import PlanOptions
from plan.scene import Scene, scene_from_json
from plan.trajectory.virtual_unit import NO_UNIT, virtual_unit


@dataclass(frozen=True, eq=False)
class StatedArm:
    """An arm as a plan needs it.

    Attributes:
        robot_open, robot_holding: the arm with open jaws, and with something in them; the same without jaws.
        unit: in whose counts the plan is.
        limits: of its joints at speed 1.
    """

    robot_open: Robot
    robot_holding: Robot
    unit: Unit
    limits: Limits

    def scene(self, plan: Plan) -> Scene:
        """Return the scene of a plan of this arm."""
        return scene_from_json(plan.scene, self.robot_open, self.robot_holding)


def arm_to_json(scene: Scene, limits: Limits) -> dict[str, Any]:
    """Return the arm of a scene and its limits as JSON types."""
    stated = {"limits": {name: value.tolist() for name, value in vars(limits).items()}}
    stated["open"] = robot_to_json(scene.robot_open)
    if scene.robot_holding.digest != scene.robot_open.digest:
        stated["holding"] = robot_to_json(scene.robot_holding)
    return stated


def stated_options(path: Path, plan: Plan) -> PlanOptions:
    """Return the speed of a plan and the fractions of the limits that it was planned with, as its provenance has them.

    Raises:
        FileInputError: one is missing or wrong.
    """
    node, share = Node(path, "provenance", plan.provenance, "plan again"), number("", 0.01, 1.0)
    return PlanOptions(
        speed=plan.speed,
        velocity_fraction=node.get("options.velocity_fraction", share),
        acceleration_fraction=node.get("options.acceleration_fraction", share),
    )


class _LimitKeys(Keys):
    lower: Array = key("lower", numbers(None))
    upper: Array = key("upper", numbers(None))
    velocity: Array = key("velocity", numbers(None))
    acceleration: Array = key("acceleration", numbers(None))


class _ArmKeys(Keys):
    limits: _LimitKeys = key("limits", Rule("limits", _LimitKeys.read))
    open: Robot = key("open", Rule("an arm", robot_from_json))
    holding: Robot | None = key("holding", Rule("an arm", robot_from_json), None)


def stated_arm(path: Path, plan: Plan) -> StatedArm:
    """Return the arm of a plan without a unit.

    Args:
        path: of the plan, for messages.
        plan: with the unit `NO_UNIT`.

    Raises:
        FileInputError: the file states no arm, or a wrong one.
    """
    if not plan.arm:
        rule = f"is missing, and a plan with unit {NO_UNIT} needs it"
        raise FileInputError(path, "arm", None, rule, "plan again with this version")
    node = Node(path, "arm", plan.arm, "plan again")
    keys = _ArmKeys.read(node)
    try:
        limits = Limits(**vars(keys.limits))
    except InputError as error:
        raise FileInputError(path, "arm.limits", None, str(error), node.help) from error
    robots = (keys.open, keys.holding or keys.open)
    for count in (len(limits.lower), *(len(robot.joint_names) for robot in robots)):
        if count != len(plan.speed_registers):
            rule = f"must be as many as the joints of the arm and their limits, {count}"
            raise FileInputError(path, "speed_registers", len(plan.speed_registers), rule, "plan again")
    return StatedArm(*robots, virtual_unit(keys.open, limits), limits)
