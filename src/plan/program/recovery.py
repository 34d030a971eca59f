"""Recovery motions after a stopped run, as programs.

If the jaws hold a cube: retract from where the cube is, carry it to its place, release it there, and return to the
start. If the jaws closed on nothing: retract along the approach.
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
    start = setting.at_counts("q", q)
    reach_stations(setting.robot, setting.planned, [target], options).require()
    cube = scene.cube(held.cube).at(mul(setting.robot.T_base_tool(start), held.T_tool_cube))
    others = tuple(c for c in scene.cubes if c.name != held.cube)
    program = Program(
        replace(scene, cubes=(*others, cube)),
        (
            _placing(target, held.cube, options),
            Target("home", q=np.asarray(q_home), role="home", cube=0, subject=held.cube),
        ),
        start,
        unit,
        limits,
        options,
        state=AttachmentState(held.cube, held.T_tool_cube, ()),
        provenance=provenance or {},
        task=task or {},
    )
    bodies = (*scene.bodies, *others)
    world = World(scene.robot_holding, bodies, cube, held.T_tool_cube)
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
        f"{held.cube}, which is in the jaws, cannot be brought to {target.name}: {'; '.join(reasons[:2])}",
        cube=held.cube,
        to=target.name,
        rejected=reasons,
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
