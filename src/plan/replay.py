"""Judging a plan file anew: its steps are replayed on its scene, and everything it would send is checked again.

Nothing is believed that the file says of itself; the certificate is made a second time and compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from arm.bodies import Body
from arm.errors import ImpossibleError
from arm.planfile import GripperStep, Move, Plan
from arm.se3 import Array, frozen, inverse
from arm.unit import Limits, Unit
from plan.check import MoveCheck, check_move
from plan.extremes import SegmentExtremes, segment_extremes
from plan.scene import Scene
from plan.world import World

# Lines to and from a station may come this near to what they serve, and moves may touch what the scene allows, m.
STATED_SLACK = 1e-6
ON_LINES = ("approach", "retract")
LIMIT_SLACK = 1e-9
GRASP_REACH = 0.05  # from the tool frame to the centre of a cube between the jaws, m


@dataclass(frozen=True)
class ReplayedMove:
    """One move as it was found.

    Attributes:
        move: of the plan.
        check: its clearance, proved again.
        peak_velocity, peak_acceleration: largest share of the limits at the plan's speed.
    """

    move: Move
    check: MoveCheck
    peak_velocity: float
    peak_acceleration: float


@dataclass(frozen=True)
class Setting:
    """Where everything stands while a move is made."""

    world: World
    standing: tuple[Body, ...]
    held: Body | None
    T_tool_held: Array | None


def settings(plan: Plan, scene: Scene, unit: Unit) -> Iterator[tuple[Move, Setting]]:
    """Every move with the world it is made in: cubes where the steps before have brought them.

    Raises:
        ImpossibleError: the jaws close where no cube stands, or a move says it holds what it does not.
    """
    cubes = {cube.name: cube for cube in scene.cubes}
    held: str | None = None
    T_tool_held: Array | None = None
    q = unit.positions(plan.start)
    for step in plan.steps:
        match step:
            case GripperStep(action="close"):
                T_base_tool = scene.robot_open.T_base_tool(q)
                held, T_tool_held = _gripped(cubes, T_base_tool, step.name)
            case GripperStep(action="open") if held is not None and T_tool_held is not None:
                placed = scene.robot_open.T_base_tool(q) @ T_tool_held
                cubes[held] = cubes[held].at(placed)
                held = T_tool_held = None
            case Move():
                if step.held != held:
                    raise ImpossibleError(
                        f"{step.name!r} says that it holds {step.held or 'nothing'}, but the steps before leave "
                        f"{held or 'nothing'} in the jaws; make the plan again",
                        step=step.name,
                        held=held,
                    )
                yield step, _setting(scene, cubes, held, T_tool_held, step)
                q = unit.positions(step.path.end)


def replay(plan: Plan, scene: Scene, unit: Unit, limits: Limits) -> tuple[ReplayedMove, ...]:
    """Check every move of a plan anew, as it would be sent.

    Args:
        plan: to judge.
        scene: of the plan, with the arms of now.
        unit: of the plan.
        limits: under the plan's registers at speed 1.

    Raises:
        ImpossibleError: a move comes nearer to something than the plan states, or breaks a limit at the plan's speed;
            with step, pair or joint, and by how much.
    """
    scaled = limits.scaled(plan.speed)
    replayed = []
    for move, setting in settings(plan, scene, unit):
        peaks = _peaks(move, segment_extremes(move.path, unit), scaled, scene.robot_open.joint_names)
        stated = max(move.clearance - STATED_SLACK, 0.0)
        check = check_move(setting.world, move.path, unit, stated, tight=False)
        if not check.proved:
            raise ImpossibleError(
                f"{move.name!r}: {check.pair[0]} comes to {check.seen * 1e3:.2f} mm of {check.pair[1]} after "
                f"{check.time:.2f} s; the plan states {move.clearance * 1e3:.2f} mm; make the plan again",
                step=move.name,
                pair=list(check.pair),
                distance_m=check.seen,
                stated_m=move.clearance,
            )
        replayed.append(ReplayedMove(move, check, *peaks))
    return tuple(replayed)


def _gripped(cubes: dict[str, Body], T_base_tool: Array, step: str) -> tuple[str, Array]:
    found = min(
        (
            (float(np.linalg.norm((inverse(T_base_tool) @ c.T_base_body)[:3, 3])), name)
            for name, c in cubes.items()
        ),
        default=(np.inf, ""),
    )
    if found[0] > GRASP_REACH:
        raise ImpossibleError(
            f"{step!r} closes the jaws where no cube stands; make the plan again", step=step
        )
    return found[1], frozen(inverse(T_base_tool) @ cubes[found[1]].T_base_body)


def _setting(
    scene: Scene, cubes: dict[str, Body], held: str | None, T_tool_held: Array | None, move: Move
) -> Setting:
    standing = tuple(c for name, c in cubes.items() if name != held)
    bodies = (*scene.bodies, *standing)
    if held is None:
        return Setting(World(scene.robot_open, bodies), standing, None, None)
    touching = [frozenset((held, name)) for name in move.touching]
    if touching and (move.role not in ON_LINES or not scene.allowed.issuperset(touching)):
        raise ImpossibleError(
            f"{move.name!r} lets {held} touch {', '.join(move.touching)}, which the scene does not allow there; "
            "make the plan again",
            step=move.name,
            touching=list(move.touching),
        )
    world = World(scene.robot_holding, bodies, cubes[held], T_tool_held, touching)
    return Setting(world, standing, cubes[held], T_tool_held)


def _peaks(
    move: Move, extremes: SegmentExtremes, limits: Limits, joints: tuple[str, ...]
) -> tuple[float, float]:
    for what, found, allowed, unit in (
        ("lower limit", -extremes.lower, -limits.lower, "deg"),
        ("upper limit", extremes.upper, limits.upper, "deg"),
        ("velocity", extremes.velocity, limits.velocity, "deg/s"),
        ("acceleration", extremes.acceleration, limits.acceleration, "deg/s2"),
    ):
        excess = np.max(found - allowed, axis=0)
        joint = int(np.argmax(excess))
        if excess[joint] > LIMIT_SLACK:
            raise ImpossibleError(
                f"{move.name!r}: {joints[joint]} is {np.degrees(excess[joint]):.4f} {unit} over its {what}; "
                "make the plan again",
                step=move.name,
                joint=joints[joint],
                limit=what,
                excess=float(excess[joint]),
            )
    return (
        float(np.max(extremes.velocity / limits.velocity)),
        float(np.max(extremes.acceleration / limits.acceleration)),
    )
