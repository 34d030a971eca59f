"""Recovery motions after a stopped run, as programs.

If the jaws hold a cube: retract from where the cube is, carry it to its place, release it there, and return to the
start. If the jaws closed on nothing: retract along the approach. If the arm rests on the approach to a place that has
moved: go on to where it is now, or return to the start with the cube.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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


@dataclass(frozen=True, eq=False)
class CarryPlanner:
    """Plans from rest with a cube in the jaws.

    Attributes:
        setting: with the present scene; it contains the held cube, whose pose there is ignored. Its limits are those at
            speed 1.
        q: where the arm is, (6,) rad.
        held: the cube.
        q_home: where plans end, (6,) rad.
        provenance, task: for the plan file; the held cube is the first of the `cubes` of `task`.
    """

    setting: Setting
    q: npt.ArrayLike
    held: InJaws
    q_home: npt.ArrayLike
    provenance: Mapping[str, Any] = field(default_factory=dict)
    task: Mapping[str, Any] = field(default_factory=dict)

    def to_place(self, target: Station) -> Plan:
        """Plan to a place, where the cube is released, and then home.

        Raises:
            ImpossibleError: `target` is out of reach, or no path was found; names the bodies and their distance.
        """
        setting = self.setting
        reach_stations(setting.robot, setting.planned, [target], setting.options).require()
        program = self._program(_placing(target, self.held.cube, setting.options))
        return _planned_clear_of(program, self.held, f"cannot be brought to {target.name}", to=target.name)

    def home(self) -> Plan:
        """Plan home, with the cube in the jaws.

        Raises:
            ImpossibleError: no path was found; names the bodies and their distance.
        """
        return _planned_clear_of(self._program(), self.held, "cannot be taken back to the start")

    def last_part(self, target: Station, approach: float) -> Plan:
        """Plan from the approach to a place that has moved since: straight to the approach where it is now, and home.

        Args:
            target: the place, with the one pose of the tool at its release.
            approach: length of the new approach, along the tool's axis there, m.

        Raises:
            ImpossibleError: no such motion is clear, or the arm cannot follow it; names the bodies and their distance.
        """
        (T_base_tool,) = target.T_base_tool
        here = Target("where it is", q=self.setting.at_counts("q", self.q), cube=0, subject=self.held.cube)
        place = _placing(target, self.held.cube, self.setting.options)
        place = replace(place, T_base_tool=T_base_tool, by="line", approach=approach)
        return plan_program(self._program(here, place)).plan()

    def _program(self, *goals: Target) -> Program:
        """Return the program of these goals, and home."""
        setting, held = self.setting, self.held
        start, scene = setting.at_counts("q", self.q), setting.scene
        cube = scene.cube(held.cube).at(mul(setting.robot.T_base_tool(start), held.T_tool_cube))
        others = tuple(c for c in scene.cubes if c.name != held.cube)
        home = Target("home", q=np.asarray(self.q_home), role="home", cube=0, subject=held.cube)
        return Program(
            replace(scene, cubes=(*others, cube)),
            (*goals, home),
            start,
            setting.unit,
            setting.limits,
            setting.options,
            state=AttachmentState(held.cube, held.T_tool_cube, ()),
            provenance=self.provenance,
            task=self.task,
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
