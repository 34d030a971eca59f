"""Motions from where a run could not go on, timed anew from rest and proved like any other.

With a cube in the jaws: out of where it is, across to its place, let go, and to where the arm starts; for an arm that
was stopped while it carried. With empty jaws: straight out of the place where they closed on nothing, for the approach
that brought them there was entered at speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.plan_file import GripperStep, Move, Plan
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.cartesian.line import Line, LineOptions, follow_line
from plan.cartesian.reachability import GraspCandidate
from plan.collision.search_margin import searched_clearance
from plan.collision.world import World
from plan.motion.builder import MotionBuilder
from plan.motion.phase import LinearPath, MotionPhase
from plan.options import PlanOptions
from plan.program.tasks import Planner, plan_of
from plan.scene import Scene, Station
from plan.transit.planner import plan_transit

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
        ImpossibleError: `target` is out of reach, or no way was found; says what is in the way and by how much.
    """
    planner = Planner(scene, np.asarray(q, dtype=float), unit, limits, options)
    table = planner.reach([target])
    table.require()
    at = planner.q_start
    cube = scene.cube(held.cube).at(mul(scene.robot_open.T_base_tool(at), held.T_tool_cube))
    others = tuple(c for c in scene.cubes if c.name != held.cube)
    scene = Scene(scene.robot_open, scene.robot_holding, scene.bodies, (*others, cube), scene.allowed)
    home = unit.positions(unit.counts(q_home))
    carry = _Carry(planner, scene, held, target, home)
    failures: list[ImpossibleError] = []
    for out in carry.ways_out():
        for choice in sorted(
            table[target.name].feasible(), key=lambda c: float(np.abs(c.q_offset - out[1]).max())
        ):
            try:
                steps = carry.steps(*out, choice)
            except ImpossibleError as error:
                failures.append(error)
                continue
            allowed = scene.allowed | {frozenset((held.cube, n)) for n in held.touches | target.touches}
            return plan_of(
                scene.allowing(allowed),
                steps,
                unit,
                limits,
                options,
                provenance,
                {"cubes": [], **(task or {})},
            )
    reasons = list(dict.fromkeys(str(e) for e in (*failures, *carry.failures)))
    raise ImpossibleError(
        f"no way to bring {held.cube}, which is in the jaws, to {target.name}: {'; '.join(reasons[:2])}",
        cube=held.cube,
        to=target.name,
        rejected=reasons,
    )


class _Carry:
    """The legs of one cube that is carried from where it is."""

    def __init__(self, planner: Planner, scene: Scene, held: InJaws, target: Station, home: Array) -> None:
        self.planner, self.scene, self.held, self.target, self.home = planner, scene, held, target, home
        self.options, self.unit, self.robot = planner.options, planner.unit, scene.robot_open
        self.mover = MotionBuilder(self.robot, planner.unit, planner.planned, planner.sent, planner.options)
        self.failures: list[ImpossibleError] = []

    def world(self, touching: frozenset[str] = frozenset()) -> World:
        """What is in the way of the arm with the cube."""
        name = self.held.cube
        others = tuple(c for c in self.scene.cubes if c.name != name)
        cube = self.scene.cube(name)
        allowed = [frozenset((name, body)) for body in touching]
        bodies = (*self.scene.bodies, *others)
        return World(self.scene.robot_holding, bodies, cube, self.held.T_tool_cube, allowed)

    def ways_out(self) -> list[tuple[MotionPhase | None, Array]]:
        """Lines out of where the cube is, and where they end; where it is free it needs none."""
        at = self.planner.q_start
        if not self.world().in_collision(at, self.options.clearance):
            return [(None, at)]
        found: list[tuple[MotionPhase | None, Array]] = []
        touches, name = self.held.touches, self.held.cube
        clearance = max(self.options.line_clearance - BESIDE, 0.0)
        for part in _PARTS:
            try:
                line = self.line(at, self.robot.T_base_tool(at), part)
            except ImpossibleError as error:
                self.failures.append(error)
                continue
            world = self.world(touches)
            phase = MotionPhase(f"{name}: out", "retract", world, clearance, line, 0, name, touches)
            found.append((phase, np.asarray(line.path.q[-1])))
        return found

    def line(self, q: Array, T_start: Array, part: float = 1.0) -> LinearPath:
        """A line back along the tool's axis."""
        return line_back(
            self.robot, q, T_start, part * self.options.offset, self.planner.planned, self.options
        )

    def across(self, world: World, q_from: Array, q_to: Array) -> Array:
        options = self.options
        clearance = searched_clearance(world, (q_from, q_to), options.clearance)
        return plan_transit(
            world, q_from, q_to, self.planner.planned, clearance, options.seed, options.transit
        )

    def steps(
        self, out: MotionPhase | None, q_from: Array, choice: GraspCandidate
    ) -> list[Move | GripperStep]:
        """All steps by one way of standing at the target."""
        options, name, touches = self.options, self.held.cube, self.target.touches
        free = self.world()
        place = self.line(choice.q_hole, self.target.T_base_tool[choice.yaw])
        lowering = MotionPhase(
            f"{name}: approach {self.target.name}",
            "approach",
            self.world(touches),
            options.line_clearance,
            place.reversed(),
            0,
            name,
            touches,
        )
        way = self.across(free, q_from, choice.q_offset)
        carrying = MotionPhase(
            f"{name}: to {self.target.name}", "transit", free, options.clearance, way, 0, name
        )
        steps: list[Move | GripperStep] = [
            *self.mover.run([*([] if out is None else [out]), carrying, lowering])
        ]
        steps.append(GripperStep(f"{name}: let go", "open", 0, 0.0, options.settle_s))
        at = self.robot.T_base_tool(self.unit.positions(self.unit.counts(place.path.q[0])))
        stands = self.scene.cube(name).at(mul(at, self.held.T_tool_cube))
        others = tuple(c for c in self.scene.cubes if c.name != name)
        world = World(self.robot, (*self.scene.bodies, *others, stands))
        leaving = MotionPhase(
            f"{name}: retract from {self.target.name}", "retract", world, options.line_clearance, place, 0
        )
        back = self.across(world, choice.q_offset, self.home)
        homing = MotionPhase(f"{name}: home", "home", world, options.clearance, back, 0)
        steps += self.mover.run([leaving, homing])
        return steps


def line_back(
    robot: Robot, q: Array, T_start: Array, length: float, limits: Limits, options: PlanOptions
) -> LinearPath:
    """The line of the tool from `q` (n,) rad, where it is at `T_start`, back along its axis by `length` m.

    Raises:
        ImpossibleError: the arm cannot follow it.
    """
    T_end = np.array(T_start)
    T_end[:3, 3] -= length * T_start[:3, 2]
    line = Line(frozen(T_start), frozen(T_end))
    path = follow_line(robot, q, line.T_start, line.T_end, limits, LineOptions(slowest=options.slowest))
    return LinearPath(line, path, options.approach_speed * options.speed)


def plan_retreat(
    scene: Scene, q: npt.ArrayLike, unit: Unit, limits: Limits, options: PlanOptions
) -> tuple[Move, ...]:
    """The way from rest at `q` (6,) rad, `options.offset` back along the tool's axis, with open jaws.

    Args:
        scene: as it stands.
        q: where the jaws are, a whole number of counts.
        unit: whose counts.
        limits: at speed 1.
        options: speed, fractions, offset and clearance of lines.

    Raises:
        ImpossibleError: the arm cannot follow the line, or something is in its way; by how much.
    """
    planner = Planner(scene, np.asarray(q, dtype=float), unit, limits, options)
    robot = scene.robot_open
    line = line_back(robot, np.asarray(q), robot.T_base_tool(q), options.offset, planner.planned, options)
    world = World(robot, (*scene.bodies, *scene.cubes))
    phase = MotionPhase("back out", "retract", world, max(options.line_clearance - BESIDE, 0.0), line)
    return tuple(MotionBuilder(robot, unit, planner.planned, planner.sent, options).stopping([phase]))
