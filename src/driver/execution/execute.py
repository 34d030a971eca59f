"""Execute the steps of a plan: motions and gripper steps in order, each monitored to its end.

Consecutive moves form one motion and are sent as one. The move being executed is determined from what the controller
reports, never from the clock.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm.controller.segments import CountPath
from arm.errors import A465Error, ExecutionStopped, ImpossibleError
from arm.plan_file import GripperStep, LookStep, Motion, Move, Pause, Step, motions
from driver.execution.control import Control
from driver.execution.controller import Controller, Jaws
from driver.execution.pause import pause_between_steps
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.rest import farthest, off_by

OnStep = Callable[[Step, int, int], None]
OnProgress = Callable[[Progress], None]


@dataclass(frozen=True)
class StepResult:
    """How one step ended.

    Attributes:
        step: of the plan.
        sent: of a move: its part of the sent motion. The arm settles only at the end of the motion; for a move that
            ends at speed, `end_counts` are those of its path.
        gripper: of a gripper step: where the jaws rest.
        start_s, end_s: controller clock; for a move that begins or ends at speed, when that was noticed.
    """

    step: Step
    sent: Sent | None
    gripper: Jaws | None
    start_s: float
    end_s: float


def execute(
    arm: Controller,
    steps: Sequence[Step],
    on_step: OnStep | None = None,
    on_progress: OnProgress | None = None,
    on_look: Callable[[LookStep], bool] | None = None,
    options: StreamOptions | None = None,
    control: Control | None = None,
) -> tuple[StepResult, ...]:
    """Run steps in order on an arm that is taken into use.

    Args:
        arm: on any controller.
        on_step: called before each step with the step, its index and the number of steps. For a move that begins at
            speed it is called when a poll finds the move's first segment running.
        on_progress: called a few times a second during a motion, with the progress of the present move.
        on_look: called at each `LookStep`, at rest, to take images. False ends the execution before the next step. By
            default look steps are skipped.
        options: of streaming.
        control: pauses, slows down or aborts the execution from elsewhere. Its override applies from the next motion
            on. A pause between steps waits before the next step and checks that the arm stays at rest.

    Returns:
        The steps done, look steps included; fewer than `steps` if `on_look` ended the execution.

    Raises:
        InputError: consecutive moves do not meet exactly, in counts; nothing moved.
        ImpossibleError: the arm is not at the first move's start; nothing moved.
        ExecutionStopped: a step failed or an abort was requested; with ``step``, its ``index``, ``steps_done`` and
            the state.
    """
    control = control or Control()
    runs = {motion.first: motion for motion in motions(steps)}
    paths = {first: motion.path for first, motion in runs.items()}  # raises InputError before anything moves
    results: list[StepResult] = []
    with control.attached(arm):
        require_start(arm, steps, 0 if options is None else options.start_held_counts)
        while len(results) < len(steps):
            index = len(results)
            step = steps[index]
            phases = _Phases(arm, steps, index, runs.get(index), on_step, on_progress)
            try:
                pause_between_steps(arm, control)
                phases.enter(index)
                jaws: Jaws | None = None
                match step:
                    case Move():
                        results += phases.results(arm.follow(paths[index], phases.take, options, control))
                        # the arm has come away from what held it
                        options = None if options is None else replace(options, start_held_counts=0)
                        continue
                    case GripperStep():
                        jaws = arm.gripper(step.fraction_closed)
                        with arm.guarded("gripper"):
                            _wait(arm, step.settle_s)
                    case Pause():
                        with arm.guarded("pause"):
                            _wait(arm, step.dwell_s)
                results.append(StepResult(step, None, jaws, phases.entered[0], arm.clock.now()))
            except A465Error as error:
                if index == 0 and not isinstance(error, ExecutionStopped):
                    error.data.update(step=step.name, index=index, steps_done=0)
                    raise
                raise _stopped(arm, error, steps, phases.index) from error
            if isinstance(step, LookStep) and on_look is not None and not on_look(step):
                break
    return tuple(results)


@dataclass(eq=False)
class _Phases:
    """Follows the moves of one motion, or one other step, and reports each when it begins.

    Attributes:
        index: of the present step; at first that of the motion's first move.
        entered: controller clock at the beginning of each move or step.
    """

    arm: Controller
    steps: Sequence[Step]
    index: int
    motion: Motion | None
    on_step: OnStep | None
    on_progress: OnProgress | None
    entered: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.first = self.index
        self.moves = () if self.motion is None else self.motion.moves
        self.starts = () if self.motion is None else self.motion.starts

    def enter(self, index: int) -> None:
        """Begin step `index`."""
        self.index = index
        self.entered.append(self.arm.clock.now())
        self.arm.note("step", index=index, name=self.steps[index].name)
        if self.on_step is not None:
            self.on_step(self.steps[index], index, len(self.steps))

    def take(self, progress: Progress) -> None:
        """Take the progress of the motion. Short moves may have begun and ended since the last poll."""
        running = self.first + bisect_right(self.starts, progress.done) - 1
        while self.index < running:
            self.enter(self.index + 1)
        if self.on_progress is not None:
            move, start = self.moves[running - self.first], self.starts[running - self.first]
            done = progress.done - start
            total = len(move.path.segments)
            durations = progress.durations_s[start : start + total]
            planned_s = sum(durations[:done])
            own = replace(progress, done=done, total=total, planned_s=planned_s, durations_s=durations)
            self.on_progress(own)

    def results(self, sent: Sent) -> list[StepResult]:
        """Return the result of every move at the end of the motion."""
        while self.index < self.first + len(self.moves) - 1:
            self.enter(self.index + 1)
        ends = [*self.entered[1:], self.arm.clock.now()]
        # a beginning that was noticed during the dwell counts from the end of the dwell
        begins = [max(time, sent.start_s) for time in self.entered]
        times = [*begins, max(sent.start_s + sent.duration_s, begins[-1])]
        return [
            StepResult(move, self._part(sent, k, times[k + 1] - times[k]), None, self.entered[k], ends[k])
            for k, move in enumerate(self.moves)
        ]

    def _part(self, sent: Sent, k: int, duration_s: float) -> Sent:
        """Part of the sent motion that is move k."""
        path, start = self.moves[k].path, self.starts[k]
        return replace(
            sent,
            path=CountPath(path.start, sent.path.segments[start : start + len(path.segments)]),
            start_s=max(self.entered[k], sent.start_s),
            duration_s=duration_s,
            end_counts=sent.end_counts if k + 1 == len(self.moves) else path.end,
        )


def _wait(arm: Controller, seconds: float) -> None:
    until = arm.clock.now() + seconds
    while arm.clock.now() < until:  # a pause or its end wakes the arm, too
        arm.wait_until(until)


def _stopped(arm: Controller, error: A465Error, steps: Sequence[Step], index: int) -> ExecutionStopped:
    """Turn the error of a step into that of the execution, with the state of the arm."""
    data = dict(error.data)
    if "state" not in data:
        data["state"] = arm.stop().to_json()
    data.update(step=steps[index].name, index=index, steps_done=index)
    return ExecutionStopped(f"step {index + 1} of {len(steps)} ({steps[index].name}): {error}", **data)


def require_start(arm: Controller, steps: Sequence[Step], held: int = 0) -> None:
    """Refuse to start unless the arm is at the start of the first move.

    Args:
        arm, steps: see `execute`.
        held: how many counts beyond `Unit.rest_tolerance` contact may hold an axis off it.

    Raises:
        ImpossibleError: with the deviation of each joint in counts and degrees; nothing moved.
    """
    first = next((s for s in steps if isinstance(s, Move)), None)
    if first is None:
        return
    here, start = arm.settled_counts(), first.path.start
    allowed = arm.unit.rest_tolerance + held
    if farthest(here, start) <= allowed:
        return
    off = [h - s for h, s in zip(here, start, strict=True)]
    off_deg = np.degrees(arm.unit.positions(here) - arm.unit.positions(start))
    raise ImpossibleError(
        f"the arm is not at the start of {first.name!r}: {off_by(arm.unit, here, start)}; must be within "
        f"{allowed} counts; plan again from where the arm is",
        counts=list(here),
        start=list(start),
        off_counts=off,
        off_deg=[float(d) for d in off_deg],
    )
