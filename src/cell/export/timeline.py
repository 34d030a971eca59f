"""The plan on one clock, with the position of every cube over time.

A move takes its own duration, and the moves of a motion follow each other without a stop. A gripper step takes at least
`settle_s`. A look takes no time of the arm; the page shows it for `LOOK_S`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.plan_file import GripperStep, LookStep, Move, Pause, Plan, Step
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.se3 import Array, frozen, inverse

LOOK_S = 1.5  # how long a look is shown, s


@dataclass(frozen=True)
class TimedStep:
    """A step on the page's clock.

    Attributes:
        step: of the plan.
        start_s, end_s: on the clock.
        jaws: how far the jaws are closed at its start and end: 0 as the open arm, 1 as the holding arm.
    """

    step: Step
    start_s: float
    end_s: float
    jaws: tuple[float, float]


@dataclass(frozen=True)
class CubePose:
    """Pose of a cube from a time on: at rest in the base frame, or moving with the tool.

    Attributes:
        start_s: on the page's clock.
        held: whether `T` is T_tool_cube, else T_base_cube.
        T: 4x4.
    """

    start_s: float
    held: bool
    T: Array


def timed_steps(plan: Plan) -> tuple[TimedStep, ...]:
    """Return the plan's steps on one clock."""
    jaws_of_move = _jaws(plan)
    now, closed = 0.0, next(iter(jaws_of_move.values()), 0.0)
    timed = []
    for i, step in enumerate(plan.steps):
        match step:
            case Move():
                duration, after = step.path.duration_s, jaws_of_move[i]
                closed = after
            case GripperStep():
                following = (jaws_of_move[k] for k in range(i + 1, len(plan.steps)) if k in jaws_of_move)
                duration, after = max(step.settle_s, 0.2), next(following, 0.0)
            case Pause():
                duration, after = step.dwell_s, closed
            case LookStep():
                duration, after = LOOK_S, closed
        timed.append(TimedStep(step, now, now + duration, (closed, after)))
        now, closed = now + duration, after
    return tuple(timed)


def _jaws(plan: Plan) -> dict[int, float]:
    """How far the jaws are closed, by index of a move: its opening relative to the plan's widest and narrowest."""
    moves = {i: step for i, step in enumerate(plan.steps) if isinstance(step, Move)}
    openings = [move.jaw_opening for move in moves.values()]
    widest, narrowest = max(openings, default=0.0), min(openings, default=0.0)
    if widest - narrowest < 1e-6:
        return {i: float(move.held is not None) for i, move in moves.items()}
    return {i: (widest - move.jaw_opening) / (widest - narrowest) for i, move in moves.items()}


def cube_tracks(
    steps: Sequence[TimedStep],
    cubes: Sequence[Body],
    robot: Robot,
    unit: Unit,
    supplies: Sequence[Sequence[str]] = (),
) -> dict[str, tuple[CubePose, ...]]:
    """Return the poses of each cube over time. A cube moves with the tool during the moves that hold it.

    The poses of one that comes when another is put down (`plan.scene.Scene.supplies`) begin then.

    Raises:
        InputError: a move holds a cube that is not in the scene.
    """
    tracks = {cube.name: [CubePose(0.0, False, cube.T_base_body)] for cube in cubes}
    held: str | None = None
    for timed in steps:
        move = timed.step
        if not isinstance(move, Move) or move.held == held:
            continue
        T_base_tool = robot.T_base_tool(unit.positions(move.path.start))
        if held is not None:
            track = tracks[held]
            track.append(CubePose(timed.start_s, False, frozen(T_base_tool @ track[-1].T)))
        if move.held is not None:
            if move.held not in tracks:
                raise InputError(
                    f"{move.name}: holds {move.held!r}, must be a cube of the plan's scene: "
                    f"{', '.join(tracks) or 'it has none'}",
                    held=move.held,
                )
            track = tracks[move.held]
            track.append(CubePose(timed.start_s, True, frozen(inverse(T_base_tool) @ track[-1].T)))
        held = move.held
    for supply in supplies:
        for before, name in pairwise(supply):
            put = (pose.start_s for pose in tracks[before][1:] if not pose.held)
            tracks[name][0] = replace(tracks[name][0], start_s=next(put, steps[-1].end_s + 1.0))
    return {name: tuple(track) for name, track in tracks.items()}
