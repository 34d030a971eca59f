"""Goals in a given order: the fastest motion through all of them, timed and certified.

Inverse kinematics solutions at all goals are chosen together (`plan.program.sequence.search`). Lines are followed
(`plan.program.goals.line_chains`), motions are blended where the arm need not stop (`plan.motion.builder`), and every
move is certified as it will be sent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from arm.arguments import shown
from arm.errors import ImpossibleError, InputError
from arm.plan_file import Move, Step, touching_pairs
from arm.se3 import Array, frozen
from plan.budget import BudgetSpent, Meter, budget_words
from plan.collision.missing_srdf import self_collision_help
from plan.kinematics.numeric_ik import SearchOptions
from plan.program.goals.attachments import AttachmentState, AttachmentWorlds
from plan.program.goals.line_chains import LineChain, LineChains, SequenceStep, TargetReached, groups
from plan.program.goals.paths import PathMoves
from plan.program.goals.target import Target
from plan.program.planned import Planned, Reached, unfinished
from plan.program.sequence.candidates import Candidates
from plan.program.sequence.layers import Layer
from plan.program.sequence.refusals import with_failure
from plan.program.sequence.search import Found, PoseSearch
from plan.program.sequence.times import chain_time, standing_time
from plan.program.setting import Setting
from plan.program.writer import ClearanceLost, MotionWriter

_ROUNDS = 6  # sequences that are tried, if timed ones cannot be certified
_WIDENINGS = (1, 3, 9)  # factors on the number of candidates; the next one is used if no plan was found
_BENT = 0.25  # first factor with lines that bend, because these take longer


@dataclass(frozen=True)
class SearchEffort:
    """Limits on a search over goals in a given order, as numbers of attempts.

    Attributes:
        candidates: solutions considered for each chain at first; three, then nine times as many if no plan was found.
        detours: paths around obstacles from one chain to the next.
        ik: limits of the inverse kinematics: samples of a free direction, starts of the numerical method.
    """

    candidates: int = 24
    detours: int = 8
    ik: SearchOptions = field(default_factory=SearchOptions)


class SequencePlanner:
    """Plans goals in the given order.

    Args:
        setting: arm, unit, limits.
        targets: the goals; at least one.
        q_start: configuration of the arm at rest, at whole counts, (n,) rad.
        state: the attached body at the start, and the poses of moved bodies.
        effort: limits on the search.
        padding: subtracted from every distance, m.

    Raises:
        InputError: no goals, repeated or unknown names, a configuration beyond limits.
    """

    def __init__(
        self,
        setting: Setting,
        targets: Sequence[Target],
        q_start: Array,
        state: AttachmentState | None = None,
        effort: SearchEffort | None = None,
        padding: float = 0.0,
    ) -> None:
        _require_distinct(targets)
        self.setting, self.options, self.effort = setting, setting.options, effort or SearchEffort()
        first = (
            targets[0] if targets[0].by == "path" else replace(targets[0], by="transit")
        )  # no pose precedes it
        self.targets = [
            goal if goal.q is None else replace(goal, q=setting.at_counts(goal.name, goal.q))
            for goal in (first, *targets[1:])
        ]
        self.worlds = AttachmentWorlds(setting.scene, self.targets, state, padding)
        cubes = {cube.name for cube in setting.scene.cubes}
        for target in targets:
            if target.attach is not None and target.attach not in cubes:
                raise target.error(
                    "attach", target.attach, "must be one of the scene's cubes; its bodies are fixed"
                )
        self.start = Layer("q_start", (LineChain((), "", q_start, q_start),), (standing_time(q_start),))
        self.groups = groups(self.targets)
        self.search: PoseSearch | None = None
        self.followed: dict[tuple[bool, int, int], LineChain | ImpossibleError] = {}
        self.writer = MotionWriter(setting, self.worlds)
        self.paths = PathMoves(setting, self.worlds)
        self.chains = {bends: LineChains(setting, self.worlds, bends, self.paths) for bends in (False, True)}

    def planned(self, meter: Meter) -> Planned:
        """Return the plan.

        Raises:
            ImpossibleError: a goal is out of reach, a line cannot be followed, or no collision-free path was found;
                data: failure (`plan.failure`), target, solutions and, if known, joint, pair, distance_m, refused. Or
                the budget was spent before a plan was complete; data: budget, reached (names of goals), left.
            PlanningInterrupted: Ctrl-C was pressed; the message states the progress too.
        """
        try:
            return self._planned(meter)
        except ImpossibleError as error:
            raise with_failure(error, {body.name for body in self.setting.robot.bodies}) from error
        except (BudgetSpent, KeyboardInterrupt) as stop:
            raise self._ended(stop) from stop

    def _planned(self, meter: Meter) -> Planned:
        candidates = Candidates(self.setting, self.worlds, self.groups, self.effort.ik, self.paths)
        candidates.solve(self.start.chains[0].q_in)
        self._require_clear_start()
        # plain lines first; if no plan was found, lines bend if they can
        can_bend = self.chains[True].can_bend
        wider = [_BENT, *_WIDENINGS] if can_bend else _WIDENINGS[1:]
        factors = [(1, False), *((times, can_bend) for times in wider)]
        trials = [(max(1, int(times * self.effort.candidates)), bends) for times, bends in factors]
        for width, bends in trials[:-1]:
            try:
                return self._searched(candidates, width, bends, meter)
            except ImpossibleError as error:
                # if all allowed detours failed, more solutions cost much and rarely help
                if error.data.get("detours_spent") or (width >= candidates.most and bends == can_bend):
                    raise
        return self._searched(candidates, *trials[-1], meter)

    def _searched(self, candidates: Candidates, width: int, bends: bool, meter: Meter) -> Planned:
        """Return the plan over the first `width` solutions of each group; `bends`: lines may bend."""
        layers = [self._layer(candidates, number, width, bends) for number in range(len(self.groups))]
        search = self.search = PoseSearch(
            self.setting, self.worlds, [self.start, *layers], self.effort.detours
        )
        return self._result(search, *self._written(search, meter))

    def _require_clear_start(self) -> None:
        """Refuse a start that is too near to a body, unless the first target is that configuration."""
        q, first = self.start.chains[0].q_out, self.targets[0]
        if first.q is not None and np.array_equal(first.q, q):
            return
        world = self.worlds.world(self.worlds.start)
        least = 0.0 if self.options.near_ends else self.options.clearance
        if world.in_collision(q, least):
            seen = world.distance(q)
            own = self_collision_help(world, q, self.options.clearance)
            own = own or "; start elsewhere, require less clearance, or set the option near_ends"
            raise ImpossibleError(
                f"q_start: {seen.pair[0]} is {seen.value * 1e3:.1f} mm from {seen.pair[1]} (required: "
                f"{self.options.clearance * 1e3:g} mm){own}",
                pair=list(seen.pair),
                distance_m=seen.value,
                clearance_m=self.options.clearance,
            )

    def _layer(self, candidates: Candidates, number: int, width: int, bends: bool) -> Layer:
        """Return the chains of the first `width` solutions of a group that can be followed; `bends`: lines may bend."""
        group = self.groups[number]
        made: list[LineChain] = []
        why: list[ImpossibleError] = []
        found = candidates.ranked(number)
        if any(self.targets[i].by == "path" for i in group) and width <= self.effort.candidates:
            width = 1  # one way along a path takes as long as hundreds of lines
        for rank, (q, branch) in enumerate(zip(found.q, found.branch, strict=True)):
            if len(made) == width:
                break
            key = (bends, number, rank)
            if key not in self.followed:
                try:
                    self.followed[key] = self.chains[bends].chain(group, q, branch)
                except ImpossibleError as error:
                    self.followed[key] = error
            chain = self.followed[key]
            if isinstance(chain, LineChain):
                made.append(chain)
            else:
                why.append(chain)
        if not made:
            raise candidates.not_followed(number, why)
        times = tuple(chain_time(chain, self.targets, self.setting.planned) for chain in made)
        return Layer(self.targets[group.start].name, tuple(made), times)

    def _ended(self, stop: BudgetSpent | KeyboardInterrupt) -> BaseException:
        """Return the error of a search that ended before a plan was complete."""
        search = self.search
        names = [] if search is None else [layer.name for layer in search.layers[1:]]
        reached = names[: search.checked_to] if search is not None else []
        miss = None if search is None else search.nearest_miss()
        far = (
            f"found as far as {reached[-1]} ({len(reached)} of {len(names)})"
            if reached
            else (f"no path to {names[0]} was found yet" if names else "inverse kinematics was not complete")
        )
        nearest = "" if miss is None else f". Nearest miss: {miss}"
        data = {} if miss is None else miss.data
        data = {**data, "reached": reached, "left": names[len(reached) :]}
        return unfinished(stop, f"plan was found; {far}{nearest}", **data)

    def _written(self, search: PoseSearch, meter: Meter) -> tuple[Found, list[Step]]:
        """Return the best sequence that is certified after timing, and its steps."""
        left = _ROUNDS
        while True:
            found = search.best(meter)
            try:
                with meter.lifted():
                    return found, self.writer.steps(found.legs)
            except ClearanceLost as error:
                with meter.lifted():
                    confirmed = search.confirm(found)
                if not confirmed:
                    continue
                left -= 1
                if not left:
                    raise error.why from error
                before = found.legs[error.step - 1].index if error.step else 0
                search.forbid(error.step + 1, before, found.legs[error.step].index)

    def _result(self, search: PoseSearch, found: Found, steps: Sequence[Step]) -> Planned:
        reached = [
            Reached(self.targets[item.target].name, item.q, item.T_base_tool, leg.chain.branch)
            for leg in found.legs
            for item in leg.chain.items
            if isinstance(item, TargetReached)
        ]
        plan = Planned(
            setting=self.setting,
            q_start=search.layers[0].chains[0].q_in,
            q_end=frozen(found.legs[-1].chain.q_out),
            steps=tuple(steps),
            reached=tuple(reached),
            lower_bound_s=float(np.floor(found.bound * 1e3)) / 1e3,
            candidates=tuple(len(layer.chains) for layer in search.layers),
            detours=sum(search.made),
            near_ends=tuple(_near_ends(search, found.legs)),
            state=self.writer.state,
            touching=frozenset(
                pair for step in steps if isinstance(step, Move) for pair in touching_pairs(step)
            ),
        )
        return plan if search.stopped is None else replace(plan, stopped=_stopped_text(search.stopped, plan))


def _near_ends(search: PoseSearch, legs: Sequence[SequenceStep]) -> Iterator[dict[str, Any]]:
    """Yield the entries of `Planned.near_ends` of a sequence."""
    places = [layer.name for layer in search.layers]
    for number, leg in enumerate(legs):
        for near in leg.near:
            at = places[number + (near.end == "to")]
            yield {"at": at, "pair": list(near.pair), "distance_mm": round(1e3 * near.distance, 2)}


def _require_distinct(targets: Sequence[Target]) -> None:
    if not targets:
        raise InputError("a list of poses needs at least one target", targets=0)
    wrong = [thing for thing in targets if not isinstance(thing, Target)]
    if wrong:
        raise InputError(f"targets: {shown(wrong[0])}: must be a Target", value=shown(wrong[0]))
    names = [t.name for t in targets]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"targets: two are named {twice[0]!r}; names must differ", names=twice)


def _stopped_text(stop: BudgetSpent, plan: Planned) -> str:
    return (
        f"{budget_words(stop)}: this is a complete plan found by then, {plan.duration_s:.1f} s; none takes less than "
        f"{plan.lower_bound_s:.1f} s"
    )
