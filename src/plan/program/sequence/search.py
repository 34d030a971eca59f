"""Choice of one solution at every goal: the fastest sequence, by A* with lazy edges.

Chains (`plan.program.goals.line_chains`) are nodes in layers, one layer for each group of targets; transits are the
edges between layers. Costs are estimates of time. An edge enters the heap with the time of the straight joint motion.
Only when it comes to the top are its transit and its chain checked, and its true cost used (B. Cohen, M. Phillips,
M. Likhachev, "Planning single-arm manipulations with n-arm robots", RSS 2014). The heuristic is the exact cost to go
over straight motions, computed from the last layer backwards.

Lines are certified, transits are checked at samples. The motions of the best sequence are certified as they will be
sent. If one cannot be, its transits are certified themselves (`PoseSearch.confirm`).

Planning a detour costs far more than all else. So if the straight motion is blocked, the edge returns to the heap with
an assumed excess: a fraction `_DETOUR` of its time, or half of the least excess of earlier detours to its layer if that
is more. Other sequences then come first. The result is the best by these costs; a detour that was not planned may be
shorter than assumed.
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
from plan.collision.bezier import curve_of_path, curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.search_margin import LINE_MARGIN, searched_clearance
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentState, AttachmentWorlds
from plan.program.goals.leg_times import leg_times
from plan.program.goals.line_chains import LineChain, SequenceStep, TargetReached
from plan.program.goals.target import Target
from plan.program.sequence.layers import Layer, lower_bound, to_go
from plan.program.sequence.rejections import end_blocked, line_blocked, miss, out_of_hand, straight_blocked
from plan.trajectory.joint_path import smooth_path
from plan.trajectory.time_estimates import path_time
from plan.transit.near_ends import NearEnd, leave_near_end
from plan.transit.optimise import Ends
from plan.transit.planner import TransitPlanner
from plan.transit.straight import StraightLine, check_straight

# Assumed excess of a detour, relative to the straight motion, until it is planned.
_DETOUR = 0.15
# Cost of each end with less than the required clearance, s, so that other sequences come first.
_NEAR_END_S = 60.0
_BEST_SHARE = 0.5  # share of a budget for the fastest sequence; the rest is for any complete one


@dataclass(frozen=True, eq=False)
class Found:
    """The sequence found: its steps in order, their estimated time and its lower bound, s."""

    legs: tuple[SequenceStep, ...]
    time: float
    bound: float


@dataclass(eq=False)
class Effort:
    """Record of a search: number of detours, and by layer the refusals, counted, and the nearest miss."""

    detours: int = 0
    refused: dict[int, Counter[str]] = field(default_factory=dict)
    examples: dict[int, ImpossibleError] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _State:
    """A checked prefix of a sequence."""

    layer: int
    index: int
    situation: AttachmentState
    cost: float
    legs: tuple[SequenceStep, ...]


@dataclass(frozen=True, eq=False)
class _Way:
    """A transit.

    Attributes:
        cost: s.
        waypoints: (m, n) rad, the ends included.
        near: ends with less than the required clearance.
    """

    cost: float
    waypoints: Array
    near: tuple[NearEnd, ...] = ()

    @classmethod
    def between(cls, cost: float, inner: Array, near: tuple[NearEnd, ...], ends: tuple[Array, Array]) -> _Way:
        """Return the transit with way-points `inner` (m, n) rad, extended to the `ends` that are near ends."""
        left = {end.end for end in near}
        before, after = ends[0][None][: "from" in left], ends[1][None][: "to" in left]
        return cls(cost + _NEAR_END_S * len(near), np.concatenate([before, inner, after]), near)


@dataclass(frozen=True, eq=False)
class _Blocked:
    """A blocked straight motion, and the assumed excess of a detour, s."""

    line: StraightLine
    near: tuple[NearEnd, ...]
    longer: float = 0.0


class PoseSearch:
    """The search over layers; the first layer is the start.

    Args:
        worlds: worlds of the program.
        targets: the goals.
        layers: at least two.
        limits: limits for planning.
        options: clearances, seed, budget of a detour.
        detours: largest number of detours from one layer to the next.
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
        self.estimates = [leg_times(a.depart, b.arrive, limits) for a, b in pairwise(layers)]
        self.to_go = to_go(layers, self.estimates)
        self._ways: dict[tuple[object, ...], _Way | None] = {}
        self._doubted: set[tuple[object, ...]] = set()  # their detours are certified
        self._blocked: dict[tuple[object, ...], _Blocked] = {}
        self._near: dict[tuple[object, ...], NearEnd | None] = {}
        self._untold: list[tuple[int, Callable[[], ImpossibleError]]] = []
        self._proofs: dict[tuple[object, ...], bool] = {}
        self._made = [0] * len(layers)
        self._excess: list[list[float]] = [[] for _ in layers]
        self._known: list[Array] = []
        self._forbidden: set[tuple[int, int, int]] = set()
        self.checked_to = 0  # the last layer that a checked sequence has reached
        self.stopped: BudgetSpent | None = None

    def forbid(self, leg: int, before: int, index: int) -> None:
        """Exclude the edge from chain `before` of layer `leg` - 1 to chain `index` of layer `leg`."""
        self._forbidden.add((leg, before, index))

    def confirm(self, found: Found) -> bool:
        """Certify the transits of a sequence that was found; return whether all are.

        If not, a straight motion counts as blocked from now on, and a detour is certified when it is planned again.
        """
        situation, before, sound = self.worlds.start, 0, True
        for number, step in enumerate(found.legs, start=1):
            key = (number, before, step.index, situation.key)
            way, near = step.waypoints, {end.end for end in step.near}
            inner = way["from" in near : len(way) - ("to" in near)]
            world, asked = self.worlds.world(situation), self.options.clearance
            check = certify_curve(world, curve_of_waypoints(inner), asked)
            if (
                not check.proved and key not in self._doubted
            ):  # doubted ones were certified when they were planned
                sound = False
                del self._ways[key]
                self._doubted.add(key)
                if len(inner) == 2:
                    line = StraightLine(inner[0], inner[1], asked, False, check.time, check=check)
                    self._blocked[key] = _Blocked(line, step.near)
            after = self._through(situation, number, step.index, step.chain)
            situation, before = after or situation, step.index
        return sound

    def best(self, meter: Meter) -> Found:
        """Return the fastest sequence; or any complete one, if its share of the budget was spent before.

        Raises:
            BudgetSpent: none was found within the budget.
            ImpossibleError: there is none; data: those of the nearest miss in the deepest layer reached, `refused`, and
                `detours_spent`, whether the number of detours was used up there.
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
        """Return the first complete sequence, in order of estimated time or, if `deepest`, of depth.

        Earlier checks and refusals are reused.
        """
        start = _State(0, 0, self.worlds.start, 0.0, ())
        # by estimated total, then deeper first, then by indices, so that ties are decided too
        heap: list[tuple[float, float, int, int, _State, int | None]] = []
        closed: set[tuple[object, ...]] = set()
        count = 0

        def push(total: float, layer: int, index: int, state: _State, edge: int | None) -> None:
            nonlocal count
            if np.isfinite(total):
                rank = round(total, 9), float(-layer)
                if deepest:  # by depth; at the same depth, checked states before edges
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
            self.checked_to = max(self.checked_to, state.layer)
            if state.layer + 1 == len(self.layers):
                return Found(state.legs, state.cost, lower_bound(self.layers, self.limits))
            onward = self.estimates[state.layer][state.index]
            inner = self.layers[state.layer + 1].spent("inner")
            totals = state.cost + onward + inner + self.to_go[state.layer + 1]
            for index, total in enumerate(totals.tolist()):
                if (state.layer + 1, state.index, index) not in self._forbidden:
                    push(total, state.layer + 1, index, state, index)
        raise self._impossible()

    def _taken(self, state: _State, index: int, postpone: bool) -> _State | float | None:
        """Return the state after the transit to a chain and the chain, both checked; None if they are refused.

        If `postpone` and the straight motion turns out to be blocked, return the assumed excess of a detour instead, s.
        """
        number = state.layer + 1
        layer = self.layers[number]
        chain = layer.chains[index]
        # lines first, because no detour is planned to a blocked chain
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
        """Return the assumed excess of a detour to a layer, relative to the straight motion."""
        return max(_DETOUR, 0.5 * min(self._excess[number], default=0.0))

    def _straight_way(self, state: _State, number: int, index: int) -> _Way | _Blocked | None:
        """Return the straight motion to a chain, clear or blocked; None if an end of it is itself too near."""
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
        if line.clear:
            return _Way.between(straight, np.stack([a, b]), tuple(near), ends)
        return _Blocked(line, tuple(near))

    def _left(self, state: _State, line: StraightLine) -> NearEnd | None:
        """Return the certified line at an end of a straight motion that is too near; None if there is none."""
        end, q = (line.end or ""), line.a if line.end == "from" else line.b
        key = (state.situation.key, end, q.tobytes())
        if key not in self._near:
            world, rng = self.worlds.world(state.situation), np.random.default_rng(self.options.seed)
            self._near[key] = leave_near_end(world, self.limits, end, q, self.options.clearance, rng)
        return self._near[key]

    def _way_around(self, state: _State, number: int, index: int, blocked: _Blocked) -> _Way | None:
        """Return a detour to a chain; None if none was found."""
        before, layer, line = self.layers[state.layer], self.layers[number], blocked.line
        straight, names = float(self.estimates[state.layer][state.index, index]), (before.name, layer.name)
        world, asked = self.worlds.world(state.situation), self.options.clearance
        prove = (number, state.index, index, state.situation.key) in self._doubted
        if self._made[number] >= self.most_detours and not prove:
            self._untold.append((number, lambda: straight_blocked(line, world, names, asked, False)))
            return None
        self._made[number] += 1
        self.effort.detours += 1
        ends = Ends(before.depart.velocity[state.index], -layer.arrive.velocity[index])
        rng = np.random.default_rng(self.options.seed)
        detours = TransitPlanner(
            world, self.limits, line.clearance, rng, self.options.transit, ends, self._known, prove=prove
        )
        way = detours.around(line.a, line.b, line.at)
        if way is None:
            self._untold.append((number, lambda: straight_blocked(line, world, names, asked, True)))
            return None
        # a detour never costs less than the straight motion
        time = max(straight, path_time(way, self.limits, ends.enter, ends.leave))
        self._excess[number].append(time / max(straight, 1e-9) - 1.0)
        reached = before.chains[state.index].q_out, layer.chains[index].q_in
        return _Way.between(time, way, blocked.near, reached)

    def _through(
        self, situation: AttachmentState, number: int, index: int, chain: LineChain
    ) -> AttachmentState | None:
        """Return the state after a chain whose lines are certified; None if one is refused."""
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
        # keep the nearest miss: it helps a user most
        if known is None or miss(error) < miss(known):
            self.effort.examples[number] = error

    def nearest_miss(self) -> ImpossibleError | None:
        """Return the nearest miss in the deepest layer reached; None if nothing was refused."""
        for number, told in self._untold:
            self._refuse(number, told())
        self._untold.clear()
        return self.effort.examples[max(self.effort.examples)] if self.effort.examples else None

    def _impossible(self) -> ImpossibleError:
        """Return the refusal of the program, about the deepest layer reached."""
        example = self.nearest_miss()
        if example is None:
            return ImpossibleError("no motion of any sequence could be certified after timing", refused={})
        number = max(self.effort.examples)
        refused = self.effort.refused[number]
        reasons = "; ".join(f"{count} x {reason}" for reason, count in sorted(refused.items()))
        tried = len(self.layers[number].chains)
        return ImpossibleError(
            f"no path to {self.layers[number].name} ({tried} solutions): {reasons}. Nearest miss: {example}",
            **{
                **example.data,
                "refused": dict(sorted(refused.items())),
                "solutions": tried,
                "detours_spent": self._made[number] >= self.most_detours,
            },
        )
