"""Which solution at every pose of a list: the fastest sequence, by a search that proves only what it is about to use.

Chains (`plan.program.goals.line_chains`) stand in layers, one layer for each group of targets; from layer to
layer go transits. Their costs are estimates of time. The best sequence is found by A* with edges that are
looked at late (B. Cohen, M. Phillips, M. Likhachev, "Planning single-arm manipulations with n-arm robots",
RSS 2014): an edge enters with the time of the straight way, and only when it is the best there is are its way
and its chain proved, and its true cost taken. What is left to the end is estimated by the straight ways too,
exactly, from the last layer backwards.

A way around costs far more than all the rest. So where the straight way turns out to be blocked, the edge goes
back to the heap as longer by `_DETOUR`, or by half of what the best way around to its layer was longer so far, and
other sequences come first. What is found is the best by these costs; a way around that was not made may be shorter.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.budget import BudgetSpent, Meter
from plan.collision.bezier import curve_of_path
from plan.collision.certificate import certify_curve
from plan.collision.search_margin import LINE_MARGIN, searched_clearance
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentState, AttachmentWorlds
from plan.program.goals.line_chains import LineChain, SequenceStep, TargetReached
from plan.program.goals.target import Target
from plan.program.sequence.rejections import end_blocked, line_blocked, miss, out_of_hand, straight_blocked
from plan.program.sequence.times import ChainTime, way_bounds, way_estimates
from plan.trajectory.joint_path import smooth_path
from plan.trajectory.time_estimates import path_time
from plan.transit.near_ends import NearEnd, leave_near_end
from plan.transit.optimise import Ends
from plan.transit.planner import TransitPlanner
from plan.transit.straight import StraightLine, check_straight

# A blocked way is taken to be this much longer than the straight one until one around is made, which costs much: if
# another sequence is hardly slower, its ways are tried first.
_DETOUR = 0.15
_NEAR_END_S = 60.0  # added for each end that has less than the asked clearance, so that others come first
_BEST_SHARE = 0.5  # of a budget, for the fastest sequence; the rest is for any


@dataclass(frozen=True, eq=False)
class Layer:
    """Candidates for one group of targets; a place to stand has one, without items.

    Attributes:
        name: of its first target, for people.
        chains: the candidates.
        times: of each.
    """

    name: str
    chains: tuple[LineChain, ...]
    times: tuple[ChainTime, ...]

    @property
    def q_in(self) -> Array:
        return np.stack([c.q_in for c in self.chains])

    @property
    def q_out(self) -> Array:
        return np.stack([c.q_out for c in self.chains])


@dataclass(frozen=True, eq=False)
class Found:
    """What the search found: its legs in order, their estimated time and the bound, s."""

    legs: tuple[SequenceStep, ...]
    time: float
    bound: float


@dataclass(eq=False)
class Effort:
    """What a search did: ways around made, and why what it tried was refused, by layer."""

    detours: int = 0
    refused: dict[int, Counter[str]] = field(default_factory=dict)
    examples: dict[int, ImpossibleError] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _State:
    """A proved prefix of a sequence."""

    layer: int
    index: int
    situation: AttachmentState
    cost: float
    legs: tuple[SequenceStep, ...]


@dataclass(frozen=True, eq=False)
class _Way:
    """A proved way across.

    Attributes:
        cost: s.
        waypoints: (m, n) rad, the ends included.
        near: ends that have less than the asked clearance.
    """

    cost: float
    waypoints: Array
    near: tuple[NearEnd, ...] = ()

    @classmethod
    def between(cls, cost: float, inner: Array, near: tuple[NearEnd, ...], ends: tuple[Array, Array]) -> _Way:
        """Return the way from end to end whose middle is `inner` (m, n) rad, where near ends are left and come to."""
        left = {end.end for end in near}
        before, after = ends[0][None][: "from" in left], ends[1][None][: "to" in left]
        return cls(cost + _NEAR_END_S * len(near), np.concatenate([before, inner, after]), near)


@dataclass(frozen=True, eq=False)
class _Blocked:
    """A straight way that is blocked, and by how much longer one around it is taken to be, s."""

    line: StraightLine
    near: tuple[NearEnd, ...]
    longer: float = 0.0


class PoseSearch:
    """The search over layers, of which the first is where the arm stands.

    Args:
        worlds: of the list.
        targets: the list.
        layers: at least two.
        limits: that motion is planned with.
        options: clearances, seed, budget of a way around.
        detours: ways around that are made at most from one layer to the next.
    """

    def __init__(
        self,
        worlds: AttachmentWorlds,
        targets: Sequence[Target],
        layers: Sequence[Layer],
        limits: Limits,
        options: PlanOptions,
        detours: int,
    ) -> None:
        self.worlds, self.targets, self.layers = worlds, targets, layers
        self.limits, self.options, self.most_detours = limits, options, detours
        self.effort = Effort()
        self.estimates = [
            way_estimates(a.q_out, b.q_in, a.times, b.times, limits) for a, b in pairwise(layers)
        ]
        self.to_go = self._to_go()
        self._ways: dict[tuple[object, ...], _Way | None] = {}
        self._blocked: dict[tuple[object, ...], _Blocked] = {}
        self._near: dict[tuple[object, ...], NearEnd | None] = {}
        self._untold: list[tuple[int, Callable[[], ImpossibleError]]] = []
        self._proofs: dict[tuple[object, ...], bool] = {}
        self._made = [0] * len(layers)
        self._excess: list[list[float]] = [[] for _ in layers]
        self._known: list[Array] = []
        self._forbidden: set[tuple[int, int, int]] = set()
        self.proved_to = 0  # the last layer that a proved sequence came to
        self.stopped: BudgetSpent | None = None

    def forbid(self, leg: int, before: int, index: int) -> None:
        """Take out the way from chain `before` of layer `leg` - 1 to chain `index` of layer `leg`."""
        self._forbidden.add((leg, before, index))

    def bound(self) -> float:
        """Time in s that no motion through these chains undercuts, whatever the ways between them."""
        best = np.zeros(len(self.layers[0].chains))
        for a, b in pairwise(self.layers):
            between = np.array([t.between_s for t in b.times])
            best = (best[:, None] + way_bounds(a.q_out, b.q_in, a.times, b.times, self.limits)).min(
                axis=0
            ) + between
        return float((best + np.array([t.tail_s for t in self.layers[-1].times])).min())

    def best(self, meter: Meter) -> Found:
        """The fastest sequence; or where most of the budget was spent before it was proved, any that is.

        Raises:
            BudgetSpent: none was found within the budget.
            ImpossibleError: there is none; data of the nearest miss in the deepest layer that was tried, `refused`, and
                `detours_spent`: whether the budget of ways around was used up there.
        """
        try:
            if self.stopped is None:
                with meter.part(_BEST_SHARE):
                    return self._first(deepest=False)
        except BudgetSpent as spent:
            if spent.by == "clock":
                raise
            self.stopped = spent
        return self._first(deepest=True)

    def _first(self, deepest: bool) -> Found:
        """The sequence that comes first: the fastest, or the one that is longest already.

        What was proved or refused before is known and costs nothing again.
        """
        start = _State(0, 0, self.worlds.start, 0.0, ())
        # estimated total, deeper first, then by indices: no tie is left to chance
        heap: list[tuple[float, float, int, int, _State, int | None]] = []
        closed: set[tuple[object, ...]] = set()
        count = 0

        def push(total: float, layer: int, index: int, state: _State, edge: int | None) -> None:
            nonlocal count
            if np.isfinite(total):
                rank = round(total, 9), float(-layer)
                if deepest:  # and there, what is proved before what is not
                    rank = (2.0 * -layer + (edge is not None), round(total, 9))
                heapq.heappush(heap, (*rank, index, count, state, edge))
                count += 1

        push(float(self.to_go[0][0]), 0, 0, start, None)
        while heap:
            estimate, _, _, _, state, edge = heapq.heappop(heap)
            if edge is not None:
                reached = self._taken(state, edge, postpone=not deepest)
                if isinstance(reached, float):
                    push(estimate + reached, state.layer + 1, edge, state, edge)
                elif reached is not None:
                    total = reached.cost + float(self.to_go[reached.layer][edge])
                    push(total, reached.layer, edge, reached, None)
                continue
            key = (state.layer, state.index, state.situation.key)
            if key in closed:
                continue
            closed.add(key)
            self.proved_to = max(self.proved_to, state.layer)
            if state.layer + 1 == len(self.layers):
                return Found(state.legs, state.cost, self.bound())
            onward = self.estimates[state.layer][state.index]
            inner = np.array([t.inner for t in self.layers[state.layer + 1].times])
            totals = state.cost + onward + inner + self.to_go[state.layer + 1]
            for index, total in enumerate(totals.tolist()):
                if (state.layer + 1, state.index, index) not in self._forbidden:
                    push(total, state.layer + 1, index, state, index)
        raise self._impossible()

    def _to_go(self) -> list[Array]:
        """Estimated time from each chain's end to the end of all, by straight ways."""
        to_go = [np.zeros(len(self.layers[-1].chains))]
        for estimate, layer in zip(reversed(self.estimates), reversed(self.layers), strict=False):
            inner = np.array([t.inner for t in layer.times])
            to_go.insert(0, (estimate + inner + to_go[0]).min(axis=1))
        return to_go

    def _taken(self, state: _State, index: int, postpone: bool) -> _State | float | None:
        """The state after the way to a chain and the chain itself, both proved; or None.

        With `postpone`, if the straight way is found to be blocked only now: by how much longer it is taken to be, s.
        """
        number = state.layer + 1
        layer = self.layers[number]
        chain = layer.chains[index]
        # lines are proved cheaply, and no way around is wasted on a chain that is blocked itself
        after = self._through(state.situation, number, index, chain)
        if after is None:
            return None
        key = (number, state.index, index, state.situation.key)
        if key not in self._ways:
            way = self._blocked.get(key) or self._straight_way(state, number, index)
            if isinstance(way, _Blocked):
                longer = self._detour(number) * float(self.estimates[state.layer][state.index, index])
                if postpone and longer > way.longer:
                    self._blocked[key] = replace(way, longer=longer)
                    return longer - way.longer
                way = self._way_around(state, number, index, way)
            self._ways[key] = way
        found = self._ways[key]
        if found is None:
            return None
        cost = state.cost + found.cost + layer.times[index].inner
        step = SequenceStep(chain, found.waypoints, index, found.near)
        return _State(number, index, after, cost, (*state.legs, step))

    def _detour(self, number: int) -> float:
        """By how much longer than straight ways those around are taken to be, as a part of them."""
        return max(_DETOUR, 0.5 * min(self._excess[number], default=0.0))

    def _straight_way(self, state: _State, number: int, index: int) -> _Way | _Blocked | None:
        """The straight way to a chain, proved or blocked; None where an end of it is itself too near."""
        before, layer = self.layers[state.layer], self.layers[number]
        a, b = ends = before.chains[state.index].q_out, layer.chains[index].q_in
        straight = float(self.estimates[state.layer][state.index, index])
        if np.array_equal(a, b):  # nothing moves
            return _Way(straight, np.stack([a, b]))
        world, asked, near = self.worlds.world(state.situation), self.options.clearance, list[NearEnd]()
        line = check_straight(world, a, b, asked)
        while line.end is not None:
            left = self._left(state, line) if self.options.near_ends else None
            if left is None:
                self._refuse(number, end_blocked(before.name, layer.name, line.end, line.seen(world), asked))
                return None
            near.append(left)
            a, b = (left.waypoint, b) if line.end == "from" else (a, left.waypoint)
            line = check_straight(world, a, b, asked)
        if line.proved:
            return _Way.between(straight, np.stack([a, b]), tuple(near), ends)
        return _Blocked(line, tuple(near))

    def _left(self, state: _State, line: StraightLine) -> NearEnd | None:
        """How an end of a straight line that is too near is left, or come to."""
        end, q = (line.end or ""), line.a if line.end == "from" else line.b
        key = (state.situation.key, end, q.tobytes())
        if key not in self._near:
            world, rng = self.worlds.world(state.situation), np.random.default_rng(self.options.seed)
            self._near[key] = leave_near_end(world, self.limits, end, q, self.options.clearance, rng)
        return self._near[key]

    def _way_around(self, state: _State, number: int, index: int, blocked: _Blocked) -> _Way | None:
        """A way around what blocks the straight one, proved; None where there is none."""
        before, layer, line = self.layers[state.layer], self.layers[number], blocked.line
        straight, names = float(self.estimates[state.layer][state.index, index]), (before.name, layer.name)
        world, asked = self.worlds.world(state.situation), self.options.clearance
        if self._made[number] >= self.most_detours:
            self._untold.append((number, lambda: straight_blocked(line, world, names, asked, False)))
            return None
        self._made[number] += 1
        self.effort.detours += 1
        ends = Ends(before.times[state.index].leave, layer.times[index].enter)
        rng = np.random.default_rng(self.options.seed)
        detours = TransitPlanner(
            world, self.limits, line.clearance, rng, self.options.transit, ends, self._known
        )
        way = detours.around(line.a, line.b, line.at)
        if way is None:
            self._untold.append((number, lambda: straight_blocked(line, world, names, asked, True)))
            return None
        # a way around never counts as less than the straight one
        time = max(straight, path_time(way, self.limits, ends.enter, ends.leave))
        self._excess[number].append(time / max(straight, 1e-9) - 1.0)
        reached = before.chains[state.index].q_out, layer.chains[index].q_in
        return _Way.between(time, way, blocked.near, reached)

    def _through(
        self, situation: AttachmentState, number: int, index: int, chain: LineChain
    ) -> AttachmentState | None:
        """The situation after a chain whose lines are proved; None where one is not."""
        for at, item in enumerate(chain.items):
            if isinstance(item, TargetReached):
                target = self.targets[item.target]
                if target.attach is not None:
                    gap = self.worlds.gap(situation, target, item.T_base_tool)
                    if gap.value > target.attach_within:
                        self._refuse(number, out_of_hand(target, gap.pair, gap.value))
                        return None
                situation = self.worlds.after(situation, target, item.T_base_tool)
                continue
            key = (number, index, at, situation.key)
            target = self.targets[item.target]
            if key not in self._proofs:
                world = self.worlds.world(situation, target.pairs)
                asked = target.clearance_on_lines(self.options)
                ends = (item.path.q[0], item.path.q[-1])
                clearance = searched_clearance(world, ends, asked, LINE_MARGIN)
                check = certify_curve(world, curve_of_path(smooth_path(item.path.q, item.path.s)), clearance)
                self._proofs[key] = check.proved
                if not check.proved:
                    self._refuse(number, line_blocked(item.role, target.name, check, asked))
            if not self._proofs[key]:
                return None
        return situation

    def _refuse(self, number: int, error: ImpossibleError) -> None:
        self.effort.refused.setdefault(number, Counter())[str(error.data["reason"])] += 1
        known = self.effort.examples.get(number)
        # the nearest miss helps most: what is too near is nearly far enough, what is out of the hand nearly in it
        if known is None or miss(error) < miss(known):
            self.effort.examples[number] = error

    def nearest_miss(self) -> ImpossibleError | None:
        """What was nearly possible in the deepest layer that was tried; None where nothing was refused."""
        for number, told in self._untold:
            self._refuse(number, told())
        self._untold.clear()
        return self.effort.examples[max(self.effort.examples)] if self.effort.examples else None

    def _impossible(self) -> ImpossibleError:
        """Why there is no sequence: the deepest layer at which one ended."""
        example = self.nearest_miss()
        if example is None:
            return ImpossibleError(
                "every sequence was taken out because its motion could not be proved", refused={}
            )
        number = max(self.effort.examples)
        refused = self.effort.refused[number]
        reasons = "; ".join(f"{count} x {reason}" for reason, count in sorted(refused.items()))
        tried = len(self.layers[number].chains)
        return ImpossibleError(
            f"no way on to {self.layers[number].name}, which has {tried} solutions: {reasons}. Nearest miss: {example}",
            **{
                **example.data,
                "refused": dict(sorted(refused.items())),
                "solutions": tried,
                "detours_spent": self._made[number] >= self.most_detours,
            },
        )
