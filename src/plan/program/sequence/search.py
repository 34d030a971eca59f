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
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.budget import BudgetSpent, Meter
from plan.collision.bezier import curve_of_path, curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.search_margin import LINE_MARGIN, searched_clearance
from plan.program.goals.attachments import AttachmentState, AttachmentWorlds
from plan.program.goals.leg_times import leg_times
from plan.program.goals.line_chains import LineChain, SequenceStep, TargetReached
from plan.program.sequence.layers import Layer, cost_to_go, lower_bound
from plan.program.sequence.refusals import end_blocked, line_blocked, miss, out_of_hand, straight_blocked
from plan.program.setting import Setting
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


@dataclass(frozen=True, eq=False)
class _Prefix:
    """A checked prefix of a sequence."""

    layer: int
    index: int
    state: AttachmentState
    cost: float
    legs: tuple[SequenceStep, ...]


@dataclass(frozen=True, eq=False)
class _Transit:
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
    def between(
        cls, cost: float, inner: Array, near: tuple[NearEnd, ...], ends: tuple[Array, Array]
    ) -> _Transit:
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


# A refusal, or how to make one: distances at blocked samples are computed only if there is no plan.
_Refusal = ImpossibleError | Callable[[], ImpossibleError]


class PoseSearch:
    """The search over layers; the first layer is the start.

    Args:
        setting: limits, clearances, seed, budget of a detour.
        worlds: worlds and goals of the program.
        layers: at least two.
        most_detours: largest number of detours from one layer to the next.

    Attributes:
        made: number of detours planned to each layer.
        checked_to: the last layer that a checked sequence has reached.
        stopped: why the search for the fastest sequence ended early, or None.
    """

    def __init__(
        self, setting: Setting, worlds: AttachmentWorlds, layers: Sequence[Layer], most_detours: int
    ) -> None:
        self.worlds, self.targets, self.layers = worlds, worlds.targets, layers
        self.limits, self.options, self.most_detours = setting.planned, setting.options, most_detours
        self.estimates = [leg_times(a.depart, b.arrive, self.limits) for a, b in pairwise(layers)]
        self.cost_to_go = cost_to_go(layers, self.estimates)
        self._transits: dict[tuple[object, ...], _Transit | None] = {}
        self._doubted: set[tuple[object, ...]] = set()  # their detours are certified
        self._blocked: dict[tuple[object, ...], _Blocked] = {}
        self._near: dict[tuple[object, ...], NearEnd | None] = {}
        self._clear_lines: dict[tuple[object, ...], bool] = {}
        self._refused: list[list[_Refusal]] = [[] for _ in layers]
        self.made = [0] * len(layers)
        self._excess: list[list[float]] = [[] for _ in layers]
        self._known: list[Array] = []
        self._forbidden: set[tuple[int, int, int]] = set()
        self.checked_to = 0
        self.stopped: BudgetSpent | None = None

    def forbid(self, leg: int, before: int, index: int) -> None:
        """Exclude the edge from chain `before` of layer `leg` - 1 to chain `index` of layer `leg`."""
        self._forbidden.add((leg, before, index))

    def confirm(self, found: Found) -> bool:
        """Certify the transits of a sequence that was found; return whether all are.

        If not, a straight motion counts as blocked from now on, and a detour is certified when it is planned again.
        """
        state, before, certified = self.worlds.start, 0, True
        for number, step in enumerate(found.legs, start=1):
            key = (number, before, step.index, state.key)
            near, asked = {end.end for end in step.near}, self.options.clearance
            inner = step.waypoints["from" in near : len(step.waypoints) - ("to" in near)]
            check = certify_curve(self.worlds.world(state), curve_of_waypoints(inner), asked)
            if not check.proved and key not in self._doubted:  # doubted ones were certified when planned
                certified = False
                del self._transits[key]
                self._doubted.add(key)
                if len(inner) == 2:
                    line = StraightLine(inner[0], inner[1], asked, False, check.time, check=check)
                    self._blocked[key] = _Blocked(line, step.near)
            state = self._through(state, number, step.index, step.chain) or state
            before = step.index
        return certified

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
        start = _Prefix(0, 0, self.worlds.start, 0.0, ())
        # by estimated total, then deeper first, then by indices, so that ties are decided too
        heap: list[tuple[float, float, int, int, _Prefix, int | None]] = []
        closed: set[tuple[object, ...]] = set()
        count = 0

        def push(total: float, layer: int, index: int, prefix: _Prefix, edge: int | None) -> None:
            nonlocal count
            if np.isfinite(total):
                rank = round(total, 9), float(-layer)
                if deepest:  # by depth; at the same depth, checked states before edges
                    rank = (2.0 * -layer + (edge is not None), round(total, 9))
                heapq.heappush(heap, (*rank, index, count, prefix, edge))
                count += 1

        push(float(self.cost_to_go[0][0]), 0, 0, start, None)
        while heap:
            estimate, _, _, _, prefix, edge = heapq.heappop(heap)
            if edge is not None:
                reached = self._taken(prefix, edge, postpone=not deepest)
                if isinstance(reached, float):
                    push(estimate + reached, prefix.layer + 1, edge, prefix, edge)
                elif reached is not None:
                    total = reached.cost + float(self.cost_to_go[reached.layer][edge])
                    push(total, reached.layer, edge, reached, None)
                continue
            key = (prefix.layer, prefix.index, prefix.state.key)
            if key in closed:
                continue
            closed.add(key)
            self.checked_to = max(self.checked_to, prefix.layer)
            if prefix.layer + 1 == len(self.layers):
                return Found(prefix.legs, prefix.cost, lower_bound(self.layers, self.limits))
            onward = self.estimates[prefix.layer][prefix.index]
            inner = self.layers[prefix.layer + 1].inner
            totals = prefix.cost + onward + inner + self.cost_to_go[prefix.layer + 1]
            for index, total in enumerate(totals.tolist()):
                if (prefix.layer + 1, prefix.index, index) not in self._forbidden:
                    push(total, prefix.layer + 1, index, prefix, index)
        raise self._impossible()

    def _taken(self, prefix: _Prefix, index: int, postpone: bool) -> _Prefix | float | None:
        """Return the prefix after the transit to a chain and the chain, both checked; None if they are refused.

        If `postpone` and the straight motion turns out to be blocked, return the assumed excess of a detour instead, s.
        """
        number = prefix.layer + 1
        layer = self.layers[number]
        chain = layer.chains[index]
        # lines first, because no detour is planned to a blocked chain
        after = self._through(prefix.state, number, index, chain)
        if after is None:
            return None
        key = (number, prefix.index, index, prefix.state.key)
        if key not in self._transits:
            straight = self._blocked.get(key) or self._straight(prefix, index)
            if isinstance(straight, _Blocked):
                longer = self._detour(number) * float(self.estimates[prefix.layer][prefix.index, index])
                if postpone and longer > straight.longer:
                    self._blocked[key] = replace(straight, longer=longer)
                    return longer - straight.longer
                straight = self._around(prefix, index, straight)
            self._transits[key] = straight
        transit = self._transits[key]
        if transit is None:
            return None
        cost = prefix.cost + transit.cost + layer.times[index].inner
        step = SequenceStep(chain, transit.waypoints, index, transit.near)
        return _Prefix(number, index, after, cost, (*prefix.legs, step))

    def _detour(self, number: int) -> float:
        """Return the assumed excess of a detour to a layer, relative to the straight motion."""
        return max(_DETOUR, 0.5 * min(self._excess[number], default=0.0))

    def _straight(self, prefix: _Prefix, index: int) -> _Transit | _Blocked | None:
        """Return the straight motion to a chain, clear or blocked; None if an end of it is itself too near."""
        number = prefix.layer + 1
        before, layer = self.layers[prefix.layer], self.layers[number]
        a, b = ends = before.chains[prefix.index].q_out, layer.chains[index].q_in
        straight = float(self.estimates[prefix.layer][prefix.index, index])
        if np.array_equal(a, b):  # nothing moves
            return _Transit(straight, np.stack([a, b]))
        world, asked, near = self.worlds.world(prefix.state), self.options.clearance, list[NearEnd]()
        line = check_straight(world, a, b, asked)
        while line.end is not None:
            left = self._left(prefix, line) if self.options.near_ends else None
            if left is None:
                self._refused[number].append(end_blocked(before.name, layer.name, line, world, asked))
                return None
            near.append(left)
            a, b = (left.waypoint, b) if line.end == "from" else (a, left.waypoint)
            line = check_straight(world, a, b, asked)
        if line.clear:
            return _Transit.between(straight, np.stack([a, b]), tuple(near), ends)
        return _Blocked(line, tuple(near))

    def _left(self, prefix: _Prefix, line: StraightLine) -> NearEnd | None:
        """Return the certified line at an end of a straight motion that is too near; None if there is none."""
        end, q = (line.end or ""), line.a if line.end == "from" else line.b
        key = (prefix.state.key, end, q.tobytes())
        if key not in self._near:
            world, rng = self.worlds.world(prefix.state), np.random.default_rng(self.options.seed)
            self._near[key] = leave_near_end(world, self.limits, end, q, self.options.clearance, rng)
        return self._near[key]

    def _around(self, prefix: _Prefix, index: int, blocked: _Blocked) -> _Transit | None:
        """Return a detour to a chain; None if none was found."""
        number, line = prefix.layer + 1, blocked.line
        before, layer = self.layers[prefix.layer], self.layers[number]
        straight, names = float(self.estimates[prefix.layer][prefix.index, index]), (before.name, layer.name)
        world, asked = self.worlds.world(prefix.state), self.options.clearance
        prove = (number, prefix.index, index, prefix.state.key) in self._doubted
        tried = prove or self.made[number] < self.most_detours
        refused = partial(straight_blocked, line, world, names, asked, tried)
        if not tried:
            self._refused[number].append(refused)
            return None
        self.made[number] += 1
        ends = Ends(before.depart.velocity[prefix.index], -layer.arrive.velocity[index])
        rng = np.random.default_rng(self.options.seed)
        detours = TransitPlanner(
            world, self.limits, line.clearance, rng, self.options.transit, ends, self._known, prove=prove
        )
        path = detours.around(line.a, line.b, line.at)
        if path is None:
            self._refused[number].append(refused)
            return None
        # a detour never costs less than the straight motion
        time = max(straight, path_time(path, self.limits, ends.enter, ends.leave))
        self._excess[number].append(time / max(straight, 1e-9) - 1.0)
        reached = before.chains[prefix.index].q_out, layer.chains[index].q_in
        return _Transit.between(time, path, blocked.near, reached)

    def _through(
        self, state: AttachmentState, number: int, index: int, chain: LineChain
    ) -> AttachmentState | None:
        """Return the state after a chain whose lines are certified; None if one is refused."""
        for at, item in enumerate(chain.items):
            if isinstance(item, TargetReached):
                target = self.targets[item.target]
                if target.attach is not None:
                    gap = self.worlds.gap(state, target, item.T_base_tool)
                    if gap.value > target.attach_within:
                        self._refused[number].append(out_of_hand(target, gap.pair, gap.value))
                        return None
                state = self.worlds.searched(state, item.target, item.T_base_tool)
                continue
            key = (number, index, at, state.key)
            target = self.targets[item.target]
            if key not in self._clear_lines:
                world = self.worlds.on_lines(state, target)
                asked = target.clearance_on_lines(self.options)
                ends = (item.path.q[0], item.path.q[-1])
                clearance = searched_clearance(world, ends, asked, LINE_MARGIN)
                check = certify_curve(world, curve_of_path(item.path.spline), clearance)
                self._clear_lines[key] = check.proved
                if not check.proved:
                    there = world.state(item.path.spline(check.time))
                    self._refused[number].append(line_blocked(item.role, target.name, check, asked, there))
            if not self._clear_lines[key]:
                return None
        return state

    def nearest_miss(self) -> ImpossibleError | None:
        """Return the nearest miss in the deepest layer reached; None if nothing was refused."""
        refused = self._deepest_refusals()[1]
        return min(refused, key=miss) if refused else None

    def _deepest_refusals(self) -> tuple[int, list[ImpossibleError]]:
        """Return the deepest layer with refusals, and these."""
        every = [
            [refusal() if callable(refusal) else refusal for refusal in sorted(some, key=callable)]
            for some in self._refused
        ]
        self._refused = [list(some) for some in every]
        number = max((n for n, some in enumerate(every) if some), default=0)
        return number, every[number]

    def _impossible(self) -> ImpossibleError:
        """Return the refusal of the program, about the deepest layer reached."""
        number, errors = self._deepest_refusals()
        if not errors:
            return ImpossibleError("no motion of any sequence could be certified after timing", refused={})
        example = min(errors, key=miss)  # the nearest miss helps a user most
        refused = dict(sorted(Counter(str(error.data["reason"]) for error in errors).items()))
        reasons = "; ".join(f"{count} x {reason}" for reason, count in refused.items())
        tried = len(self.layers[number].chains)
        return ImpossibleError(
            f"no path to {self.layers[number].name} ({tried} solutions): {reasons}. Nearest miss: {example}",
            **{
                **example.data,
                "refused": refused,
                "solutions": tried,
                "detours_spent": self.made[number] >= self.most_detours,
            },
        )
