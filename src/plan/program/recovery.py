"""Recovery motions after a stopped run, as programs.

If the jaws hold a cube: retract from where the cube is, carry it to its place, release it there, and return to the
start. If the jaws closed on nothing: retract along the approach. If the arm rests on the approach to a place that has
moved: go on to where it is now, or return to the start with the cube.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.plan_file import Move, Plan
from arm.se3 import Array
from plan.cartesian.reachability import reach_stations
from plan.collision.world import World
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentState
from plan.program.goals.target import Target
from plan.program.program import Program, plan_program
from plan.program.setting import Setting
from plan.scene import Scene, Station

# m, by which this line may deviate from the approach, which kept the clearance of lines: both lines' tolerances.
BESIDE = 5e-4

# Lengths of the retract as fractions of a full one: the arm may have stopped part of the way along a line.
_PARTS = (1.0, 0.6, 0.3)


@dataclass(frozen=True, eq=False)
class InJaws:
    """The cube in the jaws.

    Attributes:
        cube: its name in the scene.
        T_tool_cube: its pose in the tool frame.
        touches: bodies that it may touch where it is now, such as a plate with the cube half in a pocket.
    """

    cube: str
    T_tool_cube: Array
    touches: frozenset[str] = frozenset()


def place_held_object(
    scene: Scene,
    q: npt.ArrayLike,
    held: InJaws,
    target: Station,
    q_home: npt.ArrayLike,
    unit: Unit,
    limits: Limits,
    options: PlanOptions,
    provenance: Mapping[str, Any] | None = None,
    task: Mapping[str, Any] | None = None,
) -> Plan:
    """Plan from rest at `q` (6,) rad with a cube in the jaws to `target`, where it is released, and then to `q_home`.

    Args:
        scene: the present scene; it contains the held cube, whose pose there is ignored.
        limits: joint limits at speed 1.
        task: for the plan file; the held cube is the first of its `cubes`.

    Raises:
        ImpossibleError: `target` is out of reach, or no path was found; names the bodies and their distance.
    """
    setting = Setting(scene, unit, limits, options)
    reach_stations(setting.robot, setting.planned, [target], options).require()
    goals = (_placing(target, held.cube, options), _home(q_home, held))
    program = _holding(setting, q, held, goals, provenance, task)
    return _planned_clear_of(program, held, f"cannot be brought to {target.name}", to=target.name)


def return_held_object(
    scene: Scene,
    q: npt.ArrayLike,
    held: InJaws,
    q_home: npt.ArrayLike,
    unit: Unit,
    limits: Limits,
    options: PlanOptions,
    provenance: Mapping[str, Any] | None = None,
    task: Mapping[str, Any] | None = None,
) -> Plan:
    """Plan from rest at `q` (6,) rad to `q_home`, with the cube in the jaws; arguments as of `place_held_object`.

    Raises:
        ImpossibleError: no path was found; names the bodies and their distance.
    """
    setting = Setting(scene, unit, limits, options)
    program = _holding(setting, q, held, (_home(q_home, held),), provenance, task)
    return _planned_clear_of(program, held, "cannot be taken back to the start")


def finish_placement(
    scene: Scene,
    q: npt.ArrayLike,
    held: InJaws,
    target: Station,
    approach: float,
    q_home: npt.ArrayLike,
    unit: Unit,
    limits: Limits,
    options: PlanOptions,
    provenance: Mapping[str, Any] | None = None,
    task: Mapping[str, Any] | None = None,
) -> Plan:
    """Plan from rest on the approach to a place that has moved since: straight to the approach where it is now.

    Args:
        scene, q, held, q_home, unit, limits, options, provenance, task: see `place_held_object`.
        target: the place, with the one pose of the tool at its release.
        approach: length of the new approach, along the tool's axis there, m.

    Raises:
        ImpossibleError: no such motion is clear, or the arm cannot follow it; names the bodies and their distance.
    """
    setting = Setting(scene, unit, limits, options)
    (T_base_tool,) = target.T_base_tool
    goals = (
        Target("where it is", q=setting.at_counts("q", q), cube=0, subject=held.cube),
        replace(_placing(target, held.cube, options), T_base_tool=T_base_tool, by="line", approach=approach),
        _home(q_home, held),
    )
    return plan_program(_holding(setting, q, held, goals, provenance, task)).plan()


def _holding(
    setting: Setting,
    q: npt.ArrayLike,
    held: InJaws,
    goals: tuple[Target, ...],
    provenance: Mapping[str, Any] | None,
    task: Mapping[str, Any] | None,
) -> Program:
    """Return the program that begins at rest at `q` with a cube in the jaws."""
    start, scene = setting.at_counts("q", q), setting.scene
    cube = scene.cube(held.cube).at(mul(setting.robot.T_base_tool(start), held.T_tool_cube))
    others = tuple(c for c in scene.cubes if c.name != held.cube)
    return Program(
        replace(scene, cubes=(*others, cube)),
        goals,
        start,
        setting.unit,
        setting.limits,
        setting.options,
        state=AttachmentState(held.cube, held.T_tool_cube, ()),
        provenance=provenance or {},
        task=task or {},
    )


def _planned_clear_of(program: Program, held: InJaws, failed: str, **data: Any) -> Plan:
    """Plan a program that begins with a cube in the jaws, after a retract if the cube is too near to something.

    Raises:
        ImpossibleError: there is no plan; its message begins with the cube, and what `failed`.
    """
    scene, start, options = program.scene, program.q_start, program.options
    others = (*scene.bodies, *(c for c in scene.cubes if c.name != held.cube))
    world = World(scene.robot_holding, others, scene.cube(held.cube), held.T_tool_cube)
    free = not world.in_collision(start, options.clearance)
    failures: list[str] = []
    out = {
        "allowed_collisions": [(held.cube, name) for name in sorted(held.touches)],
        "cube": 0,
        "subject": held.cube,
    }
    for part in (0.0,) if free else _PARTS:
        try:
            retracts = (
                (_retract("where it is", start, part * options.offset, options, **out),) if part else ()
            )
            return plan_program(replace(program, goals=(*retracts, *program.goals))).plan()
        except ImpossibleError as error:
            failures.append(str(error))
    reasons = list(dict.fromkeys(failures))
    raise ImpossibleError(
        f"{held.cube}, which is in the jaws, {failed}: {'; '.join(reasons[:2])}",
        cube=held.cube,
        rejected=reasons,
        **data,
    )


def _home(q_home: npt.ArrayLike, held: InJaws) -> Target:
    return Target("home", q=np.asarray(q_home), role="home", cube=0, subject=held.cube)


def _retract(name: str, q: npt.ArrayLike, length: float, options: PlanOptions, **more: Any) -> Target:
    """Return the goal that retracts along the tool's axis from where the arm is, `length` m."""
    clearance = max(options.line_clearance - BESIDE, 0.0)
    return Target(name, q=np.asarray(q), retract=length, line_clearance=clearance, **more)


def _placing(target: Station, cube: str, options: PlanOptions) -> Target:
    """Return the goal that releases the cube at a station."""
    return Target(
        target.name,
        np.stack(target.T_base_tool),
        approach=options.offset,
        retract=options.offset,
        detach=True,
        jaws=0.0,
        settle_s=options.settle_s,
        allowed_collisions=[(cube, name) for name in sorted(target.touches)],
        cube=0,
        subject=cube,
    )


def plan_retreat(
    scene: Scene, q: npt.ArrayLike, unit: Unit, limits: Limits, options: PlanOptions
) -> tuple[Move, ...]:
    """Plan the retract by `options.offset` along the tool's axis, from rest at `q` (6,) rad, with open jaws.

    Args:
        scene: the present scene.
        q: present configuration, at whole counts.
        unit: unit of the counts.
        limits: joint limits at speed 1.
        options: speed, fractions, offset and clearance of lines.

    Raises:
        ImpossibleError: the arm cannot follow the line, or a body is too near to it; names both and their distance.
    """
    back = _retract("the place of the jaws", q, options.offset, options)
    return plan_program(Program(scene, (back,), q, unit, limits, options)).moves
