"""Independent verification of a plan file: replay its steps on its scene and check again everything it would send.

The clearances that the file states, of moves and of single segments, are proved again. A value that does not hold is
refused, not lowered: such a file is not the planner's, and nothing else in it can be trusted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from arm.controller.segments import CountPath, chain
from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.numerics.products import mul, norm
from arm.plan_file import GripperStep, LookStep, Motion, Move, Pause, Plan, Step, touching_pairs
from arm.robot.jaws import after_closing
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.se3 import Array, angle_between, frozen, inverse
from plan.collision.certificate import ArmErrors, ClearanceCertificate, certify_move
from plan.collision.world import World
from plan.scene import Scene
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.rounding import vertex_jump

STATED_SLACK = 1e-6  # m, by which a stated clearance may exceed the proved one
# The same for one segment, m: the bisection here differs from the planner's and ends at a resolution of 20 um.
SEGMENT_SLACK = 5e-5
ON_LINES = ("approach", "retract")
LIMIT_SLACK = 1e-9
LINE_SAMPLE_S = 0.01
LINE_ASIDE, LINE_TURN = 1e-4, np.radians(0.05)  # largest deviation from a line, m and rad
# m, tolerance of a line's length; a line is entered or left at speed, at a whole millisecond
LINE_LENGTH = 5e-4
GRASP_REACH = 0.05  # from the tool frame to the centre of a cube between the jaws, m


@dataclass(frozen=True)
class ReplayedMove:
    """One verified move.

    Attributes:
        move: the move of the plan.
        check: the new certificate.
        peak_velocity, peak_acceleration: largest fractions of the limits at the plan's speed.
        erring: certificate of the arm with its errors; None if none were given.
    """

    move: Move
    check: ClearanceCertificate
    peak_velocity: float
    peak_acceleration: float
    erring: ClearanceCertificate | None = None


@dataclass(frozen=True, eq=False)
class Standing:
    """What there is before a step of a plan.

    Attributes:
        scene: with the arm's jaws as the steps before have left them.
        resting: the cubes that are there and not held, where the steps before have put them.
        held: the cube in the jaws and its pose in the tool frame, or None.
    """

    scene: Scene
    resting: tuple[Body, ...]
    held: tuple[Body, Array] | None

    @property
    def robot(self) -> Robot:
        """The arm, with its jaws open or around a cube."""
        return self.scene.robot_open if self.held is None else self.scene.robot_holding


@dataclass(frozen=True, eq=False)
class MoveScene(Standing):
    """A move and what it moves through."""

    move: Move

    def world(self) -> World:
        """Return the world of the move.

        Raises:
            ImpossibleError: the move states that bodies may touch which must not in this scene.
        """
        touching = touching_pairs(self.move)
        if touching and (
            self.move.role not in (*ON_LINES, "line") or not self.scene.allowed.issuperset(touching)
        ):
            pairs = sorted(" and ".join(sorted(pair)) for pair in touching)
            why = f"{self.move.name!r} lets touch {', '.join(pairs)}, which the scene does not allow there; plan again"
            raise ImpossibleError(why, step=self.move.name, touching=pairs)
        bodies = (*self.scene.bodies, *self.resting)
        held, T_tool_held = self.held or (None, None)
        if self.move.threaded is not None:
            thread = self.scene.thread(self.move.threaded)
            moving = [b.name for b in self.robot.bodies] + ([] if held is None else [held.name])
            touching, bodies = touching | thread.exempt(moving), (*bodies, *thread.rays)
        return World(self.robot, bodies, held, T_tool_held, touching)


def move_scenes(plan: Plan, scene: Scene, unit: Unit) -> Iterator[tuple[Move, World, tuple[Body, ...]]]:
    """Yield every move, its world and the cubes that are not held; as `scenes_of_moves`, and raises as `world`."""
    return ((of.move, of.world(), of.resting) for of in scenes_of_moves(plan, scene, unit))


def scenes_of_moves(
    plan: Plan, scene: Scene, unit: Unit, begins_with: str | None = None
) -> Iterator[MoveScene]:
    """Yield every move with its scene; as `before_steps`, and raises as it does."""
    for step, before in before_steps(plan, scene, unit, begins_with):
        if isinstance(step, Move):
            yield MoveScene(before.scene, before.resting, before.held, step)


def before_steps(
    plan: Plan, scene: Scene, unit: Unit, begins_with: str | None = None
) -> Iterator[tuple[Step, Standing]]:
    """Yield every step with what there is before it.

    If the jaws close on no cube of the task, their opening is unknown from then on (`after_closing`), and so it is
    around a supplied cube. The next cube of a supply comes when the one in front of it is put down.

    Args:
        plan, scene, unit: the plan, its scene, and the unit of its counts.
        begins_with: name of a cube of the scene that is in the jaws before the first step.

    Raises:
        ImpossibleError: the jaws close where no cube is, a step attaches a cube that is not there yet, or a move states
            another held cube than the steps give.
    """
    any_jaws = after_closing(scene.robot_open)
    queues = [list(supply) for supply in scene.supplies]
    supplied = {name for queue in queues for name in queue}
    cubes = {cube.name: cube for cube in scene.cubes}
    coming = {name: cubes.pop(name) for queue in queues for name in queue[1:]}
    q, held, T_tool_held = unit.positions(plan.start), begins_with, np.eye(4)
    if begins_with is not None:
        T_tool_held = frozen(mul(inverse(scene.robot_open.T_base_tool(q)), cubes[begins_with].T_base_body))
    for step in plan.steps:
        if isinstance(step, Move) and step.held != held:
            why = (
                f"{step.name!r} says that it holds {step.held or 'nothing'}, but the steps before it leave "
                f"{held or 'nothing'} in the jaws; plan again"
            )
            raise ImpossibleError(why, step=step.name, held=held)
        resting = tuple(cube for name, cube in cubes.items() if name != held)
        yield step, Standing(scene, resting, None if held is None else (cubes[held], T_tool_held))
        match step:
            case GripperStep(action="close", cube=None):
                scene = replace(scene, robot_open=any_jaws)
            case GripperStep(action="close"):
                T_base_tool = scene.robot_open.T_base_tool(q)
                held, T_tool_held = _gripped(cubes, T_base_tool, step.name)
            case Pause(attached=str() as name) if name in coming:
                why = f"{step.name!r} takes {name}, which is not there before the one in front of it is put down"
                raise ImpossibleError(f"{why}; plan again", step=step.name, held=name)
            case Pause(attached=str() as name) if name in cubes:
                held, T_base_tool = name, scene.robot_open.T_base_tool(q)
                T_tool_held = frozen(mul(inverse(T_base_tool), cubes[name].T_base_body))
                if name in supplied:
                    scene = replace(scene, robot_holding=scene.robot_open)
            case GripperStep(action="open") | Pause(detached=str()):
                if held is not None:
                    cubes[held] = cubes[held].at(mul(scene.robot_open.T_base_tool(q), T_tool_held))
                for queue in queues:
                    if held is not None and held in queue[:1]:
                        cubes.update({name: coming.pop(name) for name in queue[1:2]})
                        del queue[0]
                held = None
            case Move():
                q = unit.positions(step.path.end)


def placed_cubes(plan: Plan, scene: Scene, unit: Unit) -> dict[str, Array]:
    """Return T_base_cube of every cube at the end of the plan, by name.

    Raises:
        ImpossibleError: as `scenes_of_moves`.
    """
    found = {cube.name: cube.T_base_body for cube in scene.cubes}
    for of in scenes_of_moves(plan, scene, unit):
        found.update((cube.name, cube.T_base_body) for cube in of.resting)
    return found


@dataclass(frozen=True)
class RequiredClearance:
    """The cell's requirements on a plan: clearance of transits and of lines, and length of approach and retract, m.

    Without a length (None), these need not be lines along the tool's axis.
    """

    clearance: float
    line_clearance: float
    offset: float | None


def replay(
    plan: Plan,
    scene: Scene,
    unit: Unit,
    limits: Limits,
    asked: RequiredClearance | None = None,
    errors: ArmErrors | None = None,
) -> tuple[ReplayedMove, ...]:
    """Verify every move of a plan as it would be sent.

    Args:
        plan: the plan to verify.
        scene: scene of the plan, with the cell's arms.
        unit: unit of the plan.
        limits: limits under the plan's registers at speed 1.
        asked: requirements besides the plan's own statements, or None.
        errors: of the arm, for a second certificate of every move; nothing is required of it.

    Raises:
        InputError: a move does not start where the one before it ends.
        ImpossibleError: a move has less clearance than the plan states, exceeds a limit at the plan's speed, or has a
            jump of velocity at a join or at rest, or a ring is not on the wire that the plan says it stays on; data:
            step, pair or joint, and the excess.
    """
    scaled, joints = limits.scaled(plan.speed), scene.robot_open.joint_names
    chain([move.path for move in plan.moves])
    jump = vertex_jump(limits.acceleration)
    peaks = [_peaks(move, unit, scaled, jump, joints) for move in plan.moves]
    for motion in plan.motions:
        _require_meetings(motion, unit, jump, joints)
    replayed, lines = [], _whole_approaches(plan)
    for (move, world, _), peak in zip(move_scenes(plan, scene, unit), peaks, strict=True):
        if move.threaded is not None:
            begin = unit.positions(move.path.start)
            scene.thread(move.threaded).require_threaded(world.robot, begin, move.name)
        if asked is not None:
            _require_clearances(move, asked)
            if asked.offset is not None:
                _require_line(move, scene, unit, asked.offset, lines.get(id(move)))
        erring = None
        if errors is not None:
            erring = certify_move(world, move.path, unit, 0.0, errors=errors)
        replayed.append(ReplayedMove(move, _proved(move, world, unit), *peak, erring))
    return tuple(replayed)


def _proved(move: Move, world: World, unit: Unit) -> ClearanceCertificate:
    """Certify a move again: the whole, and every segment that states more clearance than the whole has."""
    segments = move.path.segments
    if move.clearances and len(move.clearances) != len(segments):
        raise ImpossibleError(
            f"{move.name!r} states {len(move.clearances)} clearances for {len(segments)} segments; plan again",
            step=move.name,
        )
    whole = certify_move(world, move.path, unit, max(move.clearance - STATED_SLACK, 0.0), tight=False)
    if not whole.proved:
        raise _too_near(move, whole, move.clearance)
    begin_s = 0.0
    for start, segment, stated in zip(move.path.knots(), segments, move.clearances, strict=False):
        if stated - SEGMENT_SLACK > whole.clearance:
            part = CountPath(tuple(int(c) for c in start), (segment,))
            check = certify_move(world, part, unit, stated - SEGMENT_SLACK, tight=False)
            if not check.proved:
                raise _too_near(move, replace(check, time=begin_s + check.time), stated)
        begin_s += segment.duration_ms / 1e3
    return whole


def _too_near(move: Move, check: ClearanceCertificate, stated: float) -> ImpossibleError:
    why = (
        f"{move.name!r}: {check.pair[0]} comes within {check.seen * 1e3:.2f} mm of {check.pair[1]} after "
        f"{check.time:.2f} s; the plan states {stated * 1e3:.2f} mm there; plan again"
    )
    return ImpossibleError(why, step=move.name, pair=list(check.pair), distance_m=check.seen, stated_m=stated)


def _require_clearances(move: Move, asked: RequiredClearance) -> None:
    least = asked.line_clearance if move.role in ON_LINES else asked.clearance
    if not move.certified or move.clearance < least - STATED_SLACK:
        why = (
            f"{move.name!r} states {move.clearance * 1e3:.2f} mm of clearance{'' if move.certified else ', unproved'}; "
            f"{least * 1e3:g} mm are required; plan again"
        )
        raise ImpossibleError(why, step=move.name, stated_m=move.clearance, asked_m=least)


def _whole_approaches(plan: Plan) -> dict[int, CountPath]:
    """Return the whole line of approaches that a second look divides, by the `id` of either part."""
    found: dict[int, CountPath] = {}
    for before, look, after in zip(plan.steps, plan.steps[1:], plan.steps[2:], strict=False):
        if isinstance(look, LookStep) and look.cube is not None:
            parts = [step for step in (before, after) if isinstance(step, Move)]
            found |= {id(part): chain([part.path for part in parts]) for part in parts}
    return found


def _require_line(
    move: Move, scene: Scene, unit: Unit, offset: float, whole: CountPath | None = None
) -> None:
    """Require that approach and retract are straight along the tool axis, over the offset, and not past the station."""
    if move.role not in ON_LINES:
        return
    path = whole or move.path
    times = np.linspace(0.0, path.duration_s, max(3, int(path.duration_s / LINE_SAMPLE_S)))
    poses = [scene.robot_open.T_base_tool(q) for q in unit.positions(path.at(times))]
    station = poses[-1] if move.role == "approach" else poses[0]
    relative = np.stack([mul(inverse(station), T) for T in poses])
    aside = float(np.hypot(relative[:, 0, 3], relative[:, 1, 3]).max())
    turned = max(angle_between(np.eye(3), T[:3, :3]) for T in relative)
    length, past = float(-relative[:, 2, 3].min()), float(relative[:, 2, 3].max())
    if max(aside, past) > LINE_ASIDE or turned > LINE_TURN or abs(length - offset) > LINE_LENGTH:
        why = (
            f"{move.name!r} is not a line of {offset * 1e3:g} mm along the tool's axis: {aside * 1e3:.3f} mm aside, "
            f"{np.degrees(turned):.4f} deg of rotation, {length * 1e3:.2f} mm long, {past * 1e3:.3f} mm past its end; "
            "plan again"
        )
        raise ImpossibleError(why, step=move.name, aside_m=aside, past_m=past, turned=turned, length_m=length)


def _gripped(cubes: dict[str, Body], T_base_tool: Array, step: str) -> tuple[str, Array]:
    T_tool_base = inverse(T_base_tool)
    in_tool = {name: mul(T_tool_base, cube.T_base_body) for name, cube in cubes.items()}
    away, name = min(((norm(T[:3, 3]), name) for name, T in in_tool.items()), default=(np.inf, ""))
    if away > GRASP_REACH:
        raise ImpossibleError(f"{step!r} closes the jaws where no cube stands; plan again", step=step)
    return name, frozen(in_tool[name])


def _require_meetings(motion: Motion, unit: Unit, jump: Array, joints: tuple[str, ...]) -> None:
    """Require equal velocities where moves meet, and rest at both ends, up to a `jump` (n,) rad/s."""
    scale = np.abs(unit.counts_per_rad)
    rest = np.zeros(len(scale))
    left = [rest, *(m.path.segments[-1].derivative(1.0) / scale for m in motion.moves)]
    entered = [*(m.path.segments[0].derivative(0.0) / scale for m in motion.moves), rest]
    names = [repr(m.name) for m in motion.moves]
    places = [
        f"{names[0]} does not begin at rest",
        *(f"{before} and {after} do not meet at the same velocity" for before, after in pairwise(names)),
        f"{names[-1]} does not end at rest",
    ]
    for place, before, after in zip(places, left, entered, strict=True):
        excess = np.abs(after - before) - jump
        joint = int(np.argmax(excess))
        if excess[joint] > LIMIT_SLACK:
            raise ImpossibleError(
                f"{place}: {joints[joint]} jumps by {np.degrees(abs(after - before)[joint]):.4f} deg/s, "
                f"{np.degrees(excess[joint]):.4f} more than the controller accepts; plan again",
                motion=[m.name for m in motion.moves],
                joint=joints[joint],
                limit="jump of velocity",
                excess=float(excess[joint]),
            )


def _peaks(
    move: Move, unit: Unit, limits: Limits, jump: Array, joints: tuple[str, ...]
) -> tuple[float, float]:
    extremes = segment_extremes(move.path, unit)
    for what, found, allowed, in_unit in (
        ("lower limit", -extremes.lower, -limits.lower, "deg"),
        ("upper limit", extremes.upper, limits.upper, "deg"),
        ("velocity", extremes.velocity, limits.velocity, "deg/s"),
        ("acceleration", extremes.acceleration, limits.acceleration, "deg/s2"),
        ("jump of velocity at a join", extremes.jumps, jump, "deg/s"),
    ):
        excess = np.max(found - allowed, axis=0, initial=-np.inf)
        joint = int(np.argmax(excess))
        if excess[joint] > LIMIT_SLACK:
            raise ImpossibleError(
                f"{move.name!r}: {joints[joint]} is {np.degrees(excess[joint]):.4f} {in_unit} over its {what}; "
                "plan again",
                step=move.name,
                joint=joints[joint],
                limit=what,
                excess=float(excess[joint]),
            )
    return (
        float(np.max(extremes.velocity / limits.velocity)),
        float(np.max(extremes.acceleration / limits.acceleration)),
    )
