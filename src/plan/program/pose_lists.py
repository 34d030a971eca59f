"""A list of Cartesian poses for any arm: the fastest way through all of them, timed and certified.

One front door, `plan_poses`. Solutions of the inverse kinematics at all targets are chosen together
(`plan.program.sequence.search`), lines are followed (`plan.program.line_chains`), motions are joined where nothing
has to happen (`plan.motion.builder`), and every move is proved as it would be sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from arm.arguments import shown
from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import Move, Step
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.se3 import Array, frozen
from plan.budget import BudgetSpent, Meter, PlanningInterrupted, SearchBudget, allowed, budget_words
from plan.collision.missing_srdf import self_collision_help
from plan.kinematics.configuration import check_configuration, require_limits
from plan.kinematics.numeric_ik import SearchOptions
from plan.motion.builder import MotionBuilder
from plan.options import PlanOptions
from plan.program.attachments import AttachmentWorlds
from plan.program.line_chains import LineChain, LineChains, TargetReached, groups
from plan.program.pose_plan import PosePlan, Reached
from plan.program.sequence.candidates import Candidates
from plan.program.sequence.search import Found, Layer, PoseSearch
from plan.program.sequence.times import chain_time, standing_time
from plan.program.target import Target
from plan.program.writer import ClearanceLost, MotionWriter
from plan.trajectory.virtual_unit import virtual_unit

__all__ = ["PosePlan", "SearchEffort", "Target", "plan_poses"]

Q_END = "q_end"  # name of the goal at the end
_ROUNDS = 6  # sequences that are tried where one could not be proved once it was timed
_WIDENINGS = (1, 3, 9)  # times the candidates of each group, where fewer do not do
_ROUNDING = 1e-4  # rad, that rounding to counts may move a joint at the most


@dataclass(frozen=True)
class SearchEffort:
    """Budgets of `plan_poses`, in tries.

    Attributes:
        candidates: solutions that are looked at for each group of targets that hang on one another by lines, at first;
            three and nine times as many where these do not do.
        detours: ways around what is in the way, from one group to the next.
        ik: of the inverse kinematics; samples of a free direction, starts of the numerical way.
    """

    candidates: int = 24
    detours: int = 8
    ik: SearchOptions = field(default_factory=SearchOptions)


def plan_poses(
    robot: Robot,
    bodies: Sequence[Body],
    targets: Sequence[Target],
    q_start: npt.ArrayLike,
    limits: Limits,
    *,
    q_end: npt.ArrayLike | None = None,
    unit: Unit | None = None,
    options: PlanOptions | None = None,
    effort: SearchEffort | None = None,
    padding: float = 0.0,
    budget: SearchBudget | None = None,
) -> PosePlan:
    """Plan the tool through a list of poses, from rest at `q_start`.

    Args:
        robot: any arm with its tool; `arm.robot.tool` gives it another tool, or neighbours to ignore.
        bodies: all that stands around it.
        targets: in order; see `Target`. The first is reached by a transit whatever it says.
        q_start: (n,) rad (m for sliding joints).
        limits: of the joints at speed 1.
        q_end: where to go in the end, by a transit; default: the last target.
        unit: a controller's counts; default: counts so fine that they do not matter (`plan.trajectory.virtual_unit`).
        options: speeds, clearances, seed, certificate; what it says about cubes, jaws and looks has no meaning here.
        effort: budgets of the search.
        padding: taken off every distance, m.
        budget: what the search may cost in all.

    Raises:
        InputError: no targets, names that are double or unknown, a start or end outside limits.
        ImpossibleError: a target is out of reach, a line cannot be followed, or no clear way was found; data: target,
            solutions, and what is known of joint, pair, distance_m, refused; or the budget was spent before anything
            was complete; data: budget, proved (names of targets), left.
        PlanningInterrupted: by Ctrl-C; says the same.
    """
    options, effort = options or PlanOptions(), effort or SearchEffort()
    targets = list(targets) if q_end is None else [*targets, Target(Q_END, q=np.asarray(q_end))]
    problem = _Problem(
        robot, bodies, targets, limits, unit or virtual_unit(robot, limits), options, effort, padding
    )
    start = problem.layer_of("q_start", q_start)
    with allowed(budget) as meter:
        try:
            return problem.solved(start, meter)
        except (BudgetSpent, KeyboardInterrupt) as stop:
            raise problem.ended(stop, meter) from stop


class _Problem:
    """One call of `plan_poses`."""

    def __init__(
        self,
        robot: Robot,
        bodies: Sequence[Body],
        targets: Sequence[Target],
        limits: Limits,
        unit: Unit,
        options: PlanOptions,
        effort: SearchEffort,
        padding: float,
    ) -> None:
        if not targets:
            raise InputError("a list of poses needs at least one target", targets=0)
        for kind, things, made in ((Target, targets, "targets"), (Body, bodies, "bodies")):
            wrong = [thing for thing in things if not isinstance(thing, kind)]
            if wrong:
                raise InputError(
                    f"{made}: {shown(wrong[0])}: must be a {kind.__name__}", value=shown(wrong[0])
                )
        names = [t.name for t in targets]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"targets: two are named {twice[0]!r}; names must differ", names=twice)
        require_limits(robot, limits)
        n = len(robot.joint_names)
        if unit.counts_per_rad.shape != (n,):
            raise InputError(
                f"unit {unit.name}: has {len(unit.counts_per_rad)} axes, the arm has {n} joints", joints=n
            )
        self.robot, self.unit, self.options, self.effort = robot, unit, options, effort
        self.limits = limits
        self.targets = [
            self.at_counts(replace(t, by="transit") if i == 0 else t) for i, t in enumerate(targets)
        ]
        self.sent = limits.scaled(options.speed)
        # rounding to whole counts moves a joint by half a count: what is sent has to be within limits
        half = np.minimum(0.5 / np.abs(unit.counts_per_rad), (limits.upper - limits.lower) / 4.0)
        self.planned = Limits(
            frozen(limits.lower + half),
            frozen(limits.upper - half),
            frozen(self.sent.velocity * options.velocity_fraction),
            frozen(self.sent.acceleration * options.acceleration_fraction),
        )
        self.worlds = AttachmentWorlds(robot, bodies, self.targets, padding)
        self.groups = groups(self.targets)
        self.search: PoseSearch | None = None
        self.followed: dict[tuple[int, int], LineChain | ImpossibleError] = {}
        tool_speed = options.approach_speed * options.speed
        builder = MotionBuilder(robot, unit, self.planned, self.sent, options)
        self.writer = MotionWriter(self.worlds, self.targets, options, builder)
        self.chains = LineChains(robot, unit, self.targets, self.planned, tool_speed, options.slowest)

    def at_counts(self, target: Target) -> Target:
        """A goal whose configuration, if it is one, is a whole number of counts."""
        return target if target.q is None else replace(target, q=self.at(target.name, target.q))

    def at(self, name: str, q: npt.ArrayLike) -> Array:
        """A configuration (n,) rad as counts have it, refused beyond limits."""
        at = check_configuration(name, q, self.robot, self.limits, _ROUNDING)
        return check_configuration(name, self.unit.positions(self.unit.counts(at)), self.robot, self.limits)

    def layer_of(self, name: str, q: npt.ArrayLike) -> Layer:
        """A layer of one place to stand."""
        at = frozen(self.at(name, q))
        return Layer(name, (LineChain((), "", at, at),), (standing_time(at),))

    def solved(self, start: Layer, meter: Meter) -> PosePlan:
        candidates = Candidates(
            self.robot, self.worlds, self.targets, self.groups, self.planned, self.options, self.effort.ik
        )
        candidates.solve(start.q_in[0])
        self.require_clear(start)
        for widening in _WIDENINGS:
            width = widening * self.effort.candidates
            layers = [self.layer(candidates, number, width) for number in range(len(self.groups))]
            search = self.search = PoseSearch(
                self.worlds,
                self.targets,
                [start, *layers],
                self.planned,
                self.options,
                self.effort.detours,
            )
            try:
                found, steps = self.written(search, meter)
            except ImpossibleError as error:
                # where many ways around were looked for in vain, more solutions are little hope and much work
                spent = bool(error.data.get("detours_spent"))
                if spent or width >= candidates.most or widening == _WIDENINGS[-1]:
                    raise
                continue
            plan = self.plan(search, found, steps)
            return plan if search.stopped is None else replace(plan, stopped=_told_stop(search.stopped, plan))
        raise ImpossibleError("no width was tried", widenings=_WIDENINGS)

    def require_clear(self, start: Layer) -> None:
        """Refuse a start that is itself too near to something: no solution anywhere helps then."""
        world = self.worlds.world(self.worlds.start)
        seen = world.distance(start.q_out[0])
        if seen.value < self.options.clearance:
            own = self_collision_help(world, start.q_out[0], self.options.clearance)
            raise ImpossibleError(
                f"q_start: {seen.pair[0]} is {seen.value * 1e3:.1f} mm from {seen.pair[1]} (required: "
                f"{self.options.clearance * 1e3:g} mm){own or '; start elsewhere, or ask for less clearance'}",
                pair=list(seen.pair),
                distance_m=seen.value,
                clearance_m=self.options.clearance,
            )

    def layer(self, candidates: Candidates, number: int, width: int) -> Layer:
        """The chains of the first `width` solutions of a group that can be followed."""
        group = self.groups[number]
        made: list[LineChain] = []
        why: list[ImpossibleError] = []
        for rank, solution in enumerate(candidates.ranked(number)):
            if len(made) == width:
                break
            if (number, rank) not in self.followed:
                try:
                    self.followed[number, rank] = self.chains.chain(group, solution.q, solution.branch)
                except ImpossibleError as error:
                    self.followed[number, rank] = error
            chain = self.followed[number, rank]
            if isinstance(chain, LineChain):
                made.append(chain)
            else:
                why.append(chain)
        if not made:
            raise candidates.unfollowed(number, why)
        times = tuple(chain_time(chain, self.targets, self.planned) for chain in made)
        return Layer(self.targets[group.start].name, tuple(made), times)

    def ended(self, stop: BudgetSpent | KeyboardInterrupt, meter: Meter) -> BaseException:
        """What to raise where a search ended before anything was complete."""
        search = self.search
        names = [] if search is None else [layer.name for layer in search.layers[1:]]
        proved = names[: search.proved_to] if search is not None else []
        miss = None if search is None else search.nearest_miss()
        by = budget_words(stop)
        far = (
            f"the way is proved as far as {proved[-1]} ({len(proved)} of {len(names)})"
            if proved
            else (
                f"no way is proved to {names[0]} yet"
                if names
                else "solutions of the poses were still looked for"
            )
        )
        nearest = "" if miss is None else f" Nearest miss: {miss}"
        text = f"{by}: nothing complete was found; {far}.{nearest}"
        if isinstance(stop, KeyboardInterrupt):
            return PlanningInterrupted(text)
        return ImpossibleError(
            text,
            **({} if miss is None else miss.data),
            budget=stop.by,
            budget_s=stop.allowed_s,
            effort_s=stop.effort_s,
            proved=proved,
            left=names[len(proved) :],
        )

    def written(self, search: PoseSearch, meter: Meter) -> tuple[Found, list[Step]]:
        """The best sequence that can be certified once it is timed, and its steps."""
        for attempt in range(_ROUNDS):
            found = search.best(meter)
            try:
                with meter.lifted():
                    return found, self.writer.steps(found.legs)
            except ClearanceLost as error:
                if attempt + 1 == _ROUNDS:
                    raise error.why from error
                before = found.legs[error.step - 1].index if error.step else 0
                search.forbid(error.step + 1, before, found.legs[error.step].index)
        raise ImpossibleError("no sequence was tried", attempts=_ROUNDS)

    def plan(self, search: PoseSearch, found: Found, steps: Sequence[Step]) -> PosePlan:
        reached = tuple(
            Reached(self.targets[item.target].name, item.q, item.T_base_tool, leg.chain.branch)
            for leg in found.legs
            for item in leg.chain.items
            if isinstance(item, TargetReached) and self.targets[item.target].name != Q_END
        )
        for before, after in pairwise([s for s in steps if isinstance(s, Move)]):
            if before.path.end != after.path.start:
                raise ImpossibleError(
                    f"{after.name!r} does not start where {before.name!r} ends; this is a fault of the planner",
                    steps=[before.name, after.name],
                )
        return PosePlan(
            robot=self.robot,
            unit=self.unit,
            q_start=search.layers[0].q_in[0],
            steps=tuple(steps),
            reached=reached,
            lower_bound_s=float(np.floor(found.bound * 1e3)) / 1e3,
            candidates=tuple(len(layer.chains) for layer in search.layers),
            detours=search.effort.detours,
        )


def _told_stop(stop: BudgetSpent, plan: PosePlan) -> str:
    return (
        f"{budget_words(stop)}: this is a complete way that was found by then, {plan.duration_s:.1f} s; none takes "
        f"less than {plan.lower_bound_s:.1f} s"
    )
