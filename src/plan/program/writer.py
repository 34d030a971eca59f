"""Writes the steps of a sequence of goals: its motions, and the actions between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, LookStep, Move, Pause, Step
from plan.motion.builder import MotionBuilder
from plan.motion.phase import Join, MotionPhase
from plan.program.goals.attachments import AttachmentState, AttachmentWorlds
from plan.program.goals.blending import join_of
from plan.program.goals.line_chains import SequenceStep
from plan.program.goals.linear_move import LinearMove
from plan.program.goals.target import Target
from plan.program.setting import Setting

LAST = ", the last part"  # of the name of an approach after a second look
_SENT = 3e-4  # m, largest loss of clearance at a near end by rounding to counts


class ClearanceLost(ImpossibleError):
    """A motion that does not keep its clearance after timing.

    Args:
        step: number of the step in the sequence; a retract belongs to the step of its goal.
        why: the refusal of the motion builder.
    """

    def __init__(self, step: int, why: ImpossibleError) -> None:
        super().__init__(str(why), **why.data)
        self.step, self.why = step, why


class MotionWriter:
    """Turns sequences into steps.

    Args:
        setting: options, and what times and certifies motions.
        worlds: worlds and goals of the program.

    Attributes:
        state: the state after the sequence that was written last.
    """

    def __init__(self, setting: Setting, worlds: AttachmentWorlds) -> None:
        self.worlds, self.targets = worlds, worlds.targets
        self.options, self.builder = setting.options, setting.builder
        self.state = worlds.start

    def steps(self, sequence: Sequence[SequenceStep]) -> list[Step]:
        """Return the moves of a sequence and the actions at rest between them, and update `state`.

        Raises:
            ClearanceLost: a phase does not keep its clearance.
        """
        steps: list[Step] = []
        motion = _Motion()
        state = self.worlds.start
        for number, step in enumerate(sequence):
            first = self.targets[step.chain.items[0].target]
            counts = self.builder.unit.counts(step.waypoints)
            if (counts != counts[0]).any():  # otherwise the arm is there already
                for phase in self._transit(first, step, state):
                    motion.add(number, phase, self.targets)
            for item in step.chain.items:
                target = self.targets[item.target]
                if isinstance(item, LinearMove):
                    if item.role == "approach" and target.look_before > 0.0:
                        upto, item = item.split(target.look_before)
                        motion.add(number, self._line(upto, target, state), self.targets)
                        steps += motion.written(self.builder)
                        motion = _Motion()
                        steps.append(
                            LookStep(f"{target.prefix}second look at {target.name}", cube=target.cube)
                        )
                        motion.add(number, self._line(item, target, state, LAST), self.targets)
                        continue
                    motion.add(number, self._line(item, target, state), self.targets)
                    continue
                motion.at = target
                if target.stops:
                    steps += motion.written(self.builder)
                    motion = _Motion()
                    steps += _actions(target, state)
                state = self.worlds.after(state, target, item.T_base_tool)
        self.state = state
        return [*steps, *motion.written(self.builder)]

    def _transit(self, target: Target, step: SequenceStep, state: AttachmentState) -> Iterator[MotionPhase]:
        """Yield the phases of a transit; the line at a near end is a phase of its own."""
        name = f"{target.prefix}home" if target.name == "home" else f"{target.prefix}to {target.name}"
        ends, waypoints = {near.end: near for near in step.near}, step.waypoints
        inner = waypoints["from" in ends : len(waypoints) - ("to" in ends)]
        for near, path in (
            (ends.get("from"), waypoints[:2]),
            (None, inner),
            (ends.get("to"), waypoints[-2:]),
        ):
            clearance, which = self.options.clearance, name
            if near is not None:
                clearance = max(near.clearance - _SENT, 0.0)
                which = f"{name}, {'leaving' if near.end == 'from' else 'up to'} {near.pair[1]}"
            elif path is not inner:
                continue
            world = self.worlds.world(state)
            yield MotionPhase(which, target.role, world, clearance, path, target.cube, state.held)

    def _line(self, item: LinearMove, target: Target, state: AttachmentState, part: str = "") -> MotionPhase:
        arm = {body.name for body in self.worlds.robot.bodies}
        touched = [pair - {state.held} for pair in target.pairs if state.held in pair]
        pairs = frozenset(pair for pair in target.pairs if state.held not in pair and pair & arm)
        return MotionPhase(
            f"{target.prefix}{_line_name(item.role, target)}{part}",
            item.role,
            self.worlds.on_lines(state, target),
            target.clearance_on_lines(self.options),
            item,
            target.cube,
            state.held,
            frozenset(name for names in touched for name in names if name is not None),
            pairs,
            target.threaded,
        )


class _Motion:
    """Collects phases without a stop between them."""

    def __init__(self) -> None:
        self.phases: list[tuple[int, MotionPhase]] = []
        self.joins: list[Join] = []
        self.at: Target | None = None  # the target reached by the last phase

    def add(self, number: int, phase: MotionPhase, targets: Sequence[Target]) -> None:
        if self.phases:
            self.joins.append(join_of(self.phases[-1][1].path, phase.path, self.at, targets))
        self.phases.append((number, phase))
        self.at = None

    def written(self, builder: MotionBuilder) -> list[Move]:
        try:
            return builder.run([phase for _, phase in self.phases], self.joins)
        except ImpossibleError as error:
            name = error.data.get("step")
            number = next((n for n, phase in self.phases if phase.name == name), None)
            raise ClearanceLost(self.phases[-1][0] if number is None else number, error) from error


def _line_name(role: str, target: Target) -> str:
    if target.by == "path":
        return f"along {target.name}" if role == "line" else f"back along {target.name}"
    match role:
        case "approach":
            return f"approach {target.name}"
        case "retract":
            return f"lift off {target.name}" if target.attach is not None else f"retract from {target.name}"
    return f"line to {target.name}"


def _actions(target: Target, state: AttachmentState) -> Iterator[Step]:
    """Yield the actions at a target, where the arm is at rest."""
    let_go = state.held if target.detach else None
    if target.jaws is not None:
        verb = "close" if target.jaws > 0.0 else "open"
        at = f"{verb} at {target.name}"
        text = "close on it" if target.attach is not None else "let go" if target.detach else at
        text = text if target.prefix else at
        yield GripperStep(f"{target.prefix}{text}", verb, target.cube, target.jaws, target.settle_s)
    # the jaws of a step that moves a cube state what is held; other steps need a pause for it
    has_jaws = target.jaws is not None and target.cube is not None
    if target.dwell_s > 0.0 or (not has_jaws and (target.attach is not None or target.detach)):
        yield Pause(target.name, target.dwell_s, target.attach, let_go)
    if target.look:
        yield LookStep(f"look after {target.subject}" if target.subject else f"look at {target.name}")
