"""Read a scene, cell, task, arm or plan file for an export: the arm, its limits and the bodies around it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm.controller.unit import UNITS, Limits, Unit, load_unit
from arm.errors import FileInputError
from arm.io.node import Node
from arm.plan_file import Plan
from arm.robot.gripper import HAND
from arm.robot.model import Robot
from arm.robot.tool import padded
from arm.se3 import Array
from cell.config.arm_file import ARM, ArmFile, read_arm_file
from cell.config.cell import tool_bodies
from cell.config.cell_values import ARM_PADDING_MM
from cell.config.fixed_tool import fixed_tool_of_inputs
from cell.config.tool_keys import gripper_of_inputs
from cell.export.urdf import Surroundings
from cell.files.observation import read_observation, require_boards
from cell.files.scene import read_scene_file
from cell.files.task import POSES, Task, is_task_file, read_place
from cell.program.planning import program_scene
from cell.program.program_file import ProgramTask, is_program_file, read_program
from cell.scene.build import build_scene
from cell.scene.fingerprint import NO_CALIBRATION
from cell.task.plan_matches import require_arm
from plan.program.stated_arm import StatedArm, stated_arm
from plan.scene import Scene
from plan.trajectory.virtual_unit import NO_UNIT
from vision.observation import Observation

_GIVE_CELL = "give --cell FILE, the cell or task file that the plan was made for"


def surroundings_of_file(path: Path, look: Path | None) -> Surroundings:
    """Read a scene or arm file, or a cell or task file (jaws open), with an observation if `look` is given.

    Raises:
        InputError: the file is none of them, or invalid.
    """
    root = Node.of_toml(path, "scene", "cell", "task", "program", "arm")
    if is_task_file(root) or "q_start_deg" in root or "camera" in root:
        return _of_cell(read_place(path), look)
    if is_program_file(root):
        return _of_program(read_program(path), look)
    if look is not None:
        kind = "an arm" if ARM in root else "a scene"
        rule = f"is {kind} file, which already contains its bodies; leave out --look"
        raise FileInputError(path, "", None, rule)
    if ARM in root:
        arm = read_arm_file(path)
        return Surroundings(arm.robot, arm.limits, arm.bodies, states={"q_start": arm.q_start})
    scene = read_scene_file(path)
    return Surroundings(
        robot=scene.robot,
        limits=scene.unit.limits(),
        bodies=scene.bodies,
        held=scene.held,
        T_tool_held=scene.T_tool_held,
        allowed=scene.allowed,
        states={"home": scene.unit.soft_home},
        padding=scene.padding,
    )


def _of_cell(task: Task, look: Path | None) -> Surroundings:
    cell = task.cell
    observation = Observation() if look is None else read_observation(look, cell)
    if look is not None and task.kind != POSES:
        require_boards(observation, task, look)
    states = {"home": cell.unit.soft_home, "q_start": cell.q_start}
    return _around(build_scene(cell, observation), cell.limits, states)


def _of_program(task: ProgramTask, look: Path | None) -> Surroundings:
    cell = task.cell
    observation = Observation() if look is None else read_observation(look, cell)
    states = {"home": cell.unit.soft_home, "q_start": cell.q_start}
    return _around(program_scene(task, observation), cell.limits, states)


def _around(scene: Scene, limits: Limits, states: dict[str, Array]) -> Surroundings:
    """Return what is exported of a scene, jaws open."""
    return Surroundings(scene.robot_open, limits, scene.present, allowed=scene.allowed, states=states)


def surroundings_of_plan(path: Path, plan: Plan, place: Task | ArmFile | None) -> Surroundings:
    """Return the bodies, cubes and arm (jaws open) of a plan, at its start.

    Args:
        path: of the plan, for messages.
        plan: the plan.
        place: cell or task that the plan was made for; needed if the plan file does not describe the arm.

    Raises:
        InputError: the arm is not that of the plan.
    """
    arm = arm_of_plan(path, plan, place)
    require_arm_of_plan(path, plan, arm)
    states = {} if plan.unit == NO_UNIT else {"home": arm.unit.soft_home}
    states["q_start"] = arm.unit.positions(plan.start)
    return _around(arm.scene(plan), arm.limits, states)


def require_arm_of_plan(path: Path, plan: Plan, arm: StatedArm) -> None:
    """Require that an arm is that of a plan.

    Raises:
        InputError: it is not.
    """
    if plan.scene.get("robot_open") != arm.robot_open.digest:
        help = "plan again" if plan.unit == NO_UNIT else _GIVE_CELL
        raise FileInputError(path, "scene.robot_open", None, "does not match this arm", help)


def arm_of_plan(path: Path, plan: Plan, place: Task | ArmFile | None) -> StatedArm:
    """Return the arm of a plan: that of the cell, or else the one that the plan file describes.

    Raises:
        InputError: the plan is for another unit, or its file does not describe the arm.
        ImpossibleError: it is not for the arm of the arm file.
    """
    if plan.unit == NO_UNIT:
        return _stated(path, plan, place)
    place = _cell_only(path, plan, place)
    unit = unit_of_plan(path, plan, place)
    velocity = unit.velocity(plan.speed_registers)
    acceleration = unit.acceleration(plan.acceleration_registers)
    limits = Limits(unit.lower, unit.upper, velocity, acceleration)
    return StatedArm(*_robots(path, plan, place), unit, limits)


def _stated(path: Path, plan: Plan, place: Task | ArmFile | None) -> StatedArm:
    if isinstance(place, Task):
        rule = f"is the plan's own, which needs no cell; leave out {place.file}"
        raise FileInputError(path, "arm", None, rule)
    if place is not None:
        require_arm(place, plan)
    return stated_arm(path, plan)


def _cell_only(path: Path, plan: Plan, place: Task | ArmFile | None) -> Task | None:
    if isinstance(place, ArmFile):
        rule = f"must be {NO_UNIT} for a plan of an arm file, such as {place.file}"
        raise FileInputError(path, "unit", plan.unit, rule, _GIVE_CELL)
    return place


def unit_of_plan(path: Path, plan: Plan, place: Task | ArmFile | None) -> Unit:
    """Return the unit in whose counts the plan is; a calibrated one requires its cell.

    Raises:
        InputError: the plan is for another unit, or for a calibrated one and no cell is given.
    """
    if plan.unit == NO_UNIT:
        return _stated(path, plan, place).unit
    place = _cell_only(path, plan, place)
    if place is None and plan.unit not in UNITS:
        raise FileInputError(
            path, "unit", plan.unit, "is no shipped unit, so its counts are not known", _GIVE_CELL
        )
    unit = load_unit(plan.unit) if place is None else place.cell.unit
    if plan.unit != unit.name:
        raise FileInputError(path, "unit", plan.unit, f"must be that of the cell, {unit.name}", _GIVE_CELL)
    if plan.provenance.get("unit") != unit.digest:
        calibrated = plan.provenance.get("calibration_id", NO_CALIBRATION)
        if place is None and calibrated != NO_CALIBRATION:
            rule = f"is of a calibrated arm ({calibrated}), whose counts become angles with that calibration only"
            raise FileInputError(path, "", None, rule, _GIVE_CELL)
        of = "as it is in its own file" if place is None else f"of {place.file.name}"
        stated = str(plan.provenance.get("unit"))[:12]
        rule = f"must be {unit.digest[:12]}, the unit {of}; its counts would give other angles"
        raise FileInputError(path, "provenance.unit", stated, rule, _GIVE_CELL)
    return unit


def _robots(path: Path, plan: Plan, place: Task | None) -> tuple[Robot, Robot]:
    """The arm with open jaws, and the arm with a cube in the jaws."""
    if place is not None:
        return place.cell.robot(), place.cell.robot_holding()
    inputs = plan.provenance.get("inputs")
    cell_keys = inputs.get("cell") if isinstance(inputs, Mapping) else None
    padding = _metres(cell_keys, "arm_padding_mm")
    padding = ARM_PADDING_MM / 1e3 if padding is None else padding
    tool = fixed_tool_of_inputs(cell_keys) if isinstance(cell_keys, Mapping) else None
    if tool is not None:
        robot = padded(tool.robot(), padding, but=tool_bodies(tool))
        return robot, robot
    gripper, cube = gripper_of_inputs(cell_keys), _metres(cell_keys, "cube.size_mm")
    if gripper is None or cube is None:
        raise FileInputError(path, "provenance.inputs", None, "does not describe the arm's tool", _GIVE_CELL)
    opened, holding = (padded(gripper.robot(width), padding, but=HAND) for width in (gripper.opening, cube))
    return opened, holding


def _metres(keys: Any, key: str) -> float | None:
    value = keys.get(key) if isinstance(keys, Mapping) else None
    return float(value) / 1e3 if isinstance(value, int | float) and not isinstance(value, bool) else None
