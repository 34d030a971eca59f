"""Executing the steps of a plan: motions and gripper steps in order, each watched to its end.

Consecutive moves are one motion and go as one stream. Which of them runs is read from the controller's own segment
numbers, never from the clock.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.controller.segments import CountPath
from arm.errors import A465Error, ExecutionStopped, ImpossibleError
from arm.plan_file import GripperStep, LookStep, Motion, Move, Step, motions
from driver.execution.control import Control
from driver.execution.pause import hold_between_steps
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.stream import stream
from driver.mars.gripper import GripperResult
from driver.mars.mars import Mars
from driver.mars.refusals import off_by
from driver.mars.stopping import farthest

OnStep = Callable[[Step, int, int], None]
OnProgress = Callable[[Progress], None]


@dataclass(frozen=True)
class StepResult:
    """How one step ended.

    Attributes:
        step: the plan's.
        sent: of a move: its own part of what was sent. The arm settles only where the motion ends; `end_counts` of
            a move that is left at speed are those of its path.
        gripper: of a gripper step: where the jaws rest.
        start_s, end_s: controller clock; of a move that is entered or left at speed, when that was seen.
    """

    step: Step
    sent: Sent | None
    gripper: GripperResult | None
    start_s: float
    end_s: float


def execute(
    mars: Mars,
    steps: Sequence[Step],
    on_step: OnStep | None = None,
    on_progress: OnProgress | None = None,
    on_look: Callable[[LookStep], bool] | None = None,
    options: StreamOptions | None = None,
    control: Control | None = None,
) -> tuple[StepResult, ...]:
    """Run steps in order on an initialised arm.

    Args:
        on_step: called before each step with it, its index and how many there are; for a move that is entered at
            speed, when its first segment is seen to run.
        on_progress: called a few times a second while a motion runs, with the progress of the move that runs.
        on_look: called at each `LookStep`, at rest; looking is the caller's business. False ends the execution
            there, before the next step. By default look steps are passed over.
        options: of streaming.
        control: pauses, slows down or aborts the execution from elsewhere. Its override holds from the next motion
            on; a pause between steps waits before the next one, and the arm is watched.

    Returns:
        The steps done, look steps included; fewer than `steps` if `on_look` ended it.

    Raises:
        InputError: consecutive moves do not meet to the count; nothing moved.
        ImpossibleError: the arm is not at the first move's start; nothing moved.
        ExecutionStopped: a step failed or an abort was asked for; with ``step``, its ``index``, ``steps_done`` and
            the state.
    """
    control = control or Control()
    found = motions(steps)
    paths = {motion.first: motion.path for motion in found}  # refused here, before anything moves
    runs = {motion.first: motion for motion in found}
    results: list[StepResult] = []
    with control.attached(mars.link):
        require_start(mars, steps)
        while len(results) < len(steps):
            index = len(results)
            step = steps[index]
            phases = _Phases(mars, steps, index, runs.get(index), on_step, on_progress)
            try:
                hold_between_steps(mars, control)
                phases.enter(index)
                match step:
                    case Move():
                        results += phases.results(stream(mars, paths[index], phases.take, options, control))
                    case GripperStep():
                        jaws = mars.gripper(step.fraction_closed)
                        with mars.guarded("gripper"):
                            mars.link.wait(step.settle_s)
                        results.append(StepResult(step, None, jaws, phases.entered[0], mars.clock.now()))
                    case LookStep():
                        results.append(StepResult(step, None, None, phases.entered[0], mars.clock.now()))
            except A465Error as error:
                if index == 0 and not isinstance(error, ExecutionStopped):
                    error.data.update(step=step.name, index=index, steps_done=0)
                    raise
                raise _stopped(mars, error, steps, phases.index) from error
            if isinstance(step, LookStep) and on_look is not None and not on_look(step):
                break
    return tuple(results)


class _Phases:
    """Follows one motion, or one other step, through its phases, and tells of each when it begins.

    Attributes:
        index: of the step that runs.
        entered: controller clock per phase, from the first on.
    """

    def __init__(
        self,
        mars: Mars,
        steps: Sequence[Step],
        index: int,
        motion: Motion | None,
        on_step: OnStep | None,
        on_progress: OnProgress | None,
    ) -> None:
        self.mars, self.steps, self.first, self.index = mars, steps, index, index
        self.moves = () if motion is None else motion.moves
        self.starts = () if motion is None else motion.starts
        self.on_step, self.on_progress = on_step, on_progress
        self.entered: list[float] = []

    def enter(self, index: int) -> None:
        """Step `index` begins."""
        self.index = index
        self.entered.append(self.mars.clock.now())
        self.mars.note("step", index=index, name=self.steps[index].name)
        if self.on_step is not None:
            self.on_step(self.steps[index], index, len(self.steps))

    def take(self, progress: Progress) -> None:
        """A look at the motion: short moves may have come and gone since the last one."""
        running = self.first + bisect_right(self.starts, progress.done) - 1
        while self.index < running:
            self.enter(self.index + 1)
        if self.on_progress is not None:
            move, start = self.moves[running - self.first], self.starts[running - self.first]
            done = progress.done - start
            total = len(move.path.segments)
            durations = progress.durations_s[start : start + total]
            self.on_progress(
                replace(
                    progress, done=done, total=total, planned_s=sum(durations[:done]), durations_s=durations
                )
            )

    def results(self, sent: Sent) -> list[StepResult]:
        """The motion has ended: every move with its part of what was sent."""
        while self.index < self.first + len(self.moves) - 1:
            self.enter(self.index + 1)
        ends = [*self.entered[1:], self.mars.clock.now()]
        # where the arm left one move for the next; what was seen during the dwell counts from its end
        seen = [max(time, sent.start_s) for time in self.entered]
        times = [*seen, max(sent.start_s + sent.duration_s, seen[-1])]
        return [
            StepResult(move, self._part(sent, k, times[k + 1] - times[k]), None, self.entered[k], ends[k])
            for k, move in enumerate(self.moves)
        ]

    def _part(self, sent: Sent, k: int, duration_s: float) -> Sent:
        """What was sent of move k."""
        path, start = self.moves[k].path, self.starts[k]
        return replace(
            sent,
            path=CountPath(path.start, sent.path.segments[start : start + len(path.segments)]),
            start_s=max(self.entered[k], sent.start_s),
            duration_s=duration_s,
            end_counts=sent.end_counts if k + 1 == len(self.moves) else path.end,
        )


def _stopped(mars: Mars, error: A465Error, steps: Sequence[Step], index: int) -> ExecutionStopped:
    """The error of a step, told as the end of the execution, with the state in it."""
    data = dict(error.data)
    if "state" not in data:
        data["state"] = mars.stop().to_json()
    data.update(step=steps[index].name, index=index, steps_done=index)
    return ExecutionStopped(f"step {index + 1} of {len(steps)}, {steps[index].name}: {error}", **data)


def require_start(mars: Mars, steps: Sequence[Step]) -> None:
    """Refuse to start anywhere else than where the first move begins.

    Raises:
        ImpossibleError: by how much each joint is off, in counts and degrees; nothing moved.
    """
    first = next((s for s in steps if isinstance(s, Move)), None)
    if first is None:
        return
    here, start = mars.settled_counts(), first.path.start
    if farthest(here, start) <= mars.unit.rest_tolerance:
        return
    off = [h - s for h, s in zip(here, start, strict=True)]
    off_deg = np.degrees(mars.unit.positions(here) - mars.unit.positions(start))
    raise ImpossibleError(
        f"the arm is not where {first.name!r} starts: {off_by(mars.unit, here, start)}; at most "
        f"{mars.unit.rest_tolerance} counts are allowed; "
        "plan again from where the arm is",
        counts=list(here),
        start=list(start),
        off_counts=off,
        off_deg=[float(d) for d in off_deg],
    )
