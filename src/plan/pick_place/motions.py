"""Writes the steps of a sequence, cube by cube, with everything where whole counts put it."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Limits, Unit
from arm.errors import A465Error, ImpossibleError
from arm.numerics.products import mul
from arm.plan_file import GripperStep, Move, Step
from arm.robot.shapes import Body
from arm.se3 import Array, frozen, inverse
from plan.cartesian.line import Line, LineOptions, follow_line
from plan.cartesian.reachability import GraspCandidate
from plan.collision.world import World
from plan.motion.builder import ApproachLine, MotionBuilder, MotionPhase, RestToRestPath
from plan.options import PlanOptions
from plan.pick_place.search import Stop
from plan.pick_place.worlds import TaskWorlds
from plan.scene import Scene, Station


class ClearanceLost(A465Error):
    """A leg of a sequence does not keep its clearance once it is timed.

    Args:
        stop: number of the stop in the sequence.
        which: ``out``, ``across`` or ``home``.
        why: what was found.
    """

    def __init__(self, stop: int, which: str, why: ImpossibleError) -> None:
        super().__init__(str(why), **why.data)
        self.stop, self.which, self.why = stop, which, why


class MotionWriter:
    """Where things stand while steps are written.

    Args:
        scene: at the start of the task.
        unit: the arm's counts.
        planned, sent: limits that motion is timed with, and that hold on what is sent.
        options: of planning.
        q_home: where the task starts and ends, a whole number of counts, (n,) rad.
    """

    def __init__(
        self, scene: Scene, unit: Unit, planned: Limits, sent: Limits, options: PlanOptions, q_home: Array
    ) -> None:
        self.scene, self.unit, self.planned, self.options, self.q_home = scene, unit, planned, options, q_home
        self.mover = MotionBuilder(scene.robot_open, unit, planned, sent, options)
        self.cubes = {cube.name: cube for cube in scene.cubes}
        self.left: tuple[MotionPhase, ApproachLine] | None = (
            None  # the line away from the last place, not run yet
        )
        self.world = World(scene.robot_open, (*scene.bodies, *scene.cubes))

    def stop(self, index: int, stop: Stop, stages: TaskWorlds) -> list[Step]:
        """Steps of one cube.

        Raises:
            Unprovable: a leg does not keep its clearance.
        """
        options = self.options
        transfer, target = stages.transfers[stop.visit.pick], stages.places[stop.visit.place]
        name = transfer.cube
        pick, place = self.grip(transfer.pick, stop.pick), self.grip(target, stop.place)
        T_tool_held = frozen(mul(inverse(self.executed(pick)), self.cubes[name].T_base_body))
        cube = self.cubes[name]
        others = [c for c in self.cubes.values() if c.name != name]

        def moving(held: Body, touching: frozenset[str] = frozenset()) -> World:
            allowed = [frozenset((name, body)) for body in touching]
            bodies = (*self.scene.bodies, *others)
            return World(self.scene.robot_holding, bodies, held, T_tool_held, allowed)

        def line(role: str, text: str, world: World, touching: frozenset[str] | None = None) -> MotionPhase:
            held = None if touching is None else name
            return MotionPhase(
                f"{name}: {text}", role, index, world, options.line_clearance, held, touching or frozenset()
            )

        free = self.world
        steps: list[Step] = []
        steps += self.leg(
            index,
            "out",
            RestToRestPath(
                self.left,
                MotionPhase(f"{name}: to {transfer.pick.name}", "transit", index, free, options.clearance),
                stop.out,
                (line("approach", f"approach {transfer.pick.name}", free), pick),
            ),
        )
        steps.append(
            GripperStep(f"{name}: close on it", "close", index, options.fraction_closed, options.settle_s)
        )
        lifting = moving(cube, transfer.pick.touches)
        lowering = moving(cube, target.touches)
        steps += self.leg(
            index,
            "across",
            RestToRestPath(
                (line("retract", f"lift off {transfer.pick.name}", lifting, transfer.pick.touches), pick),
                MotionPhase(
                    f"{name}: to {target.name}", "transit", index, moving(cube), options.clearance, name
                ),
                stop.across,
                (line("approach", f"approach {target.name}", lowering, target.touches), place),
            ),
        )
        steps.append(GripperStep(f"{name}: let go", "open", index, 0.0, options.settle_s))
        self.cubes[name] = cube.at(mul(self.executed(place), T_tool_held))
        self.world = World(self.scene.robot_open, (*self.scene.bodies, *self.cubes.values()))
        self.left = (line("retract", f"retract from {target.name}", self.world), place)
        if stop.home is not None:
            home = MotionPhase(f"{name}: home", "home", index, self.world, options.clearance)
            steps += self.leg(index, "home", RestToRestPath(self.left, home, stop.home, None))
            self.left = None
        return steps

    def leg(self, index: int, which: str, leg: RestToRestPath) -> list[Move]:
        try:
            return self.mover.run(leg)
        except ImpossibleError as error:
            raise ClearanceLost(index, which, error) from error

    def grip(self, station: Station, choice: GraspCandidate) -> ApproachLine:
        """The line of a choice, followed from the station outwards."""
        T_start = station.T_base_tool[choice.yaw]
        T_end = np.array(T_start)
        T_end[:3, 3] -= self.options.offset * T_start[:3, 2]
        path = follow_line(
            self.scene.robot_open,
            choice.q_hole,
            T_start,
            T_end,
            self.planned,
            LineOptions(slowest=self.options.slowest),
        )
        return ApproachLine(Line(frozen(T_start), frozen(T_end)), path)

    def executed(self, grip: ApproachLine) -> Array:
        """Pose of the tool at the station as whole counts give it."""
        return self.scene.robot_open.T_base_tool(self.unit.positions(self.unit.counts(grip.path.q[0])))
