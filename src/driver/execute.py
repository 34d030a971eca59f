"""Executing the steps of a plan: moves and gripper steps in order, each watched to its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from arm.errors import A465Error, ExecutionStopped, ImpossibleError
from arm.planfile import GripperStep, LookStep, Move, Step
from driver.gripper import GripperResult
from driver.mars import POSITION_TOLERANCE, Mars
from driver.rest import farthest
from driver.stream import Progress, Sent, StreamOptions, stream


@dataclass(frozen=True)
class StepResult:
    """How one step ended.

    Attributes:
        step: the plan's.
        sent: of a move: what was sent.
        gripper: of a gripper step: where the jaws rest.
        start_s, end_s: controller clock.
    """

    step: Step
    sent: Sent | None
    gripper: GripperResult | None
    start_s: float
    end_s: float


def execute(
    mars: Mars,
    steps: Sequence[Step],
    on_step: Callable[[Step, int, int], None] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_look: Callable[[LookStep], bool] | None = None,
    options: StreamOptions | None = None,
) -> tuple[StepResult, ...]:
    """Run steps in order on an initialised arm.

    Args:
        on_step: called before each step with it, its index and how many there are.
        on_progress: called a few times a second while a move runs.
        on_look: called at each `LookStep`, at rest; looking is the caller's business. False ends the execution
            there, before the next step. By default look steps are passed over.
        options: of streaming.

    Returns:
        The steps done, look steps included; fewer than `steps` if `on_look` ended it.

    Raises:
        ImpossibleError: the arm is not at the first move's start; nothing moved.
        ExecutionStopped: a step failed; with ``step``, its ``index``, ``steps_done`` and the state.
    """
    require_start(mars, steps)
    results: list[StepResult] = []
    for index, step in enumerate(steps):
        if on_step is not None:
            on_step(step, index, len(steps))
        started = mars.clock.now()
        sent, jaws = None, None
        mars.note("step", index=index, name=step.name)
        try:
            match step:
                case Move():
                    sent = stream(mars, step.path, on_progress, options)
                case GripperStep():
                    jaws = mars.gripper(step.fraction_closed)
                    with mars.guarded("gripper"):
                        mars.clock.sleep(step.settle_s)
                case LookStep():
                    pass
        except A465Error as error:
            if not results and not isinstance(error, ExecutionStopped):
                error.data.update(step=step.name, index=index, steps_done=0)
                raise
            raise _stopped(mars, error, step, index, len(steps)) from error
        results.append(StepResult(step, sent, jaws, started, mars.clock.now()))
        if isinstance(step, LookStep) and on_look is not None and not on_look(step):
            break
    return tuple(results)


def _stopped(mars: Mars, error: A465Error, step: Step, index: int, total: int) -> ExecutionStopped:
    """The error of a step, told as the end of the execution, with the state in it."""
    data = dict(error.data)
    if "state" not in data:
        data["state"] = mars.stop().to_json()
    data.update(step=step.name, index=index, steps_done=index)
    return ExecutionStopped(f"step {index + 1} of {total}, {step.name}: {error}", **data)


def require_start(mars: Mars, steps: Sequence[Step]) -> None:
    """Refuse to start anywhere else than where the first move begins.

    Raises:
        ImpossibleError: by how much each joint is off, in counts and degrees; nothing moved.
    """
    first = next((s for s in steps if isinstance(s, Move)), None)
    if first is None:
        return
    here, start = mars.settled_counts(), first.path.start
    if farthest(here, start) <= POSITION_TOLERANCE:
        return
    off = [h - s for h, s in zip(here, start, strict=True)]
    off_deg = np.degrees(mars.unit.positions(here) - mars.unit.positions(start))
    shown = ", ".join(
        f"{axis} {counts:+d} ({degrees:+.2f} deg)"
        for axis, counts, degrees in zip(mars.unit.axes, off, off_deg, strict=True)
        if abs(counts) > POSITION_TOLERANCE
    )
    raise ImpossibleError(
        f"the arm is not where {first.name!r} starts: off by {shown}; at most {POSITION_TOLERANCE} counts are allowed; "
        "plan again from where the arm is",
        counts=list(here),
        start=list(start),
        off_counts=off,
        off_deg=[float(d) for d in off_deg],
    )
