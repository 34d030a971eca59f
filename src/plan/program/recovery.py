"""Motions from where a run could not go on, as programs.

With a cube in the jaws: out of where it is, across to its place, let go, and to where the arm starts; for an arm that
was stopped while it carried. With empty jaws: straight out of the place where they closed on nothing, for the approach
that brought them there was entered at speed.
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

# The approach kept the lines' clearance; this one runs beside it by both lines' tolerances, m.
BESIDE = 5e-4

# Lengths of the line out of where the cube is, as parts of a whole one: it may have been stopped on its way.
_PARTS = (1.0, 0.6, 0.3)


@dataclass(frozen=True, eq=False)
class InJaws:
    """What the jaws hold.

    Attributes:
        cube: its name in the scene.
        T_tool_cube: how they hold it.
        touches: bodies that it may touch where it is now: it is half out of a pocket, or about to stand in one.
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
    """From rest at `q` (6,) rad with a cube in the jaws to `target`, where it is let go, and to `q_home`.

    Args:
        scene: as it stands; the held cube is one of its cubes, its pose there does not matter.
        limits: at speed 1.
        task: for the plan file; the held cube is the first of its `cubes`.

    Raises:
        ImpossibleError: `target` is out of reach, or no path was found; says what is in the way and by how much.
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
    for part in (0.0,) if free else _PARTS:
        try:
            ways_out = (_way_out(start, held, part, options),) if part else ()
            return plan_program(replace(program, goals=(*ways_out, *program.goals))).plan()
        except ImpossibleError as error:
            failures.append(str(error))
    reasons = list(dict.fromkeys(failures))
    raise ImpossibleError(
        f"no way to bring {held.cube}, which is in the jaws, to {target.name}: {'; '.join(reasons[:2])}",
        cube=held.cube,
        to=target.name,
        rejected=reasons,
    )


def _way_out(q: Array, held: InJaws, part: float, options: PlanOptions) -> Target:
    """The line back along the tool's axis, out of where the cube is."""
    return Target(
        "where it is",
        q=q,
        retract=part * options.offset,
        line_clearance=max(options.line_clearance - BESIDE, 0.0),
        allowed_collisions=[(held.cube, name) for name in sorted(held.touches)],
        cube=0,
        subject=held.cube,
    )


def _placing(target: Station, cube: str, options: PlanOptions) -> Target:
    """A station where the cube is let go."""
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
    """The motion from rest at `q` (6,) rad, `options.offset` back along the tool's axis, with open jaws.

    Args:
        scene: as it stands.
        q: where the jaws are, a whole number of counts.
        unit: whose counts.
        limits: at speed 1.
        options: speed, fractions, offset and clearance of lines.

    Raises:
        ImpossibleError: the arm cannot follow the line, or something is in its way; by how much.
    """
    back = Target(
        "the place of the jaws",
        q=np.asarray(q),
        retract=options.offset,
        line_clearance=max(options.line_clearance - BESIDE, 0.0),
    )
    return plan_program(Program(scene, (back,), q, unit, limits, options)).moves
