"""Costs of the legs of a task: time estimates, raised by what the search has learnt about obstacles.

A leg whose straight joint motion is blocked costs as much as a detour. If a cube blocks it, this holds only while the
cube is there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.options import PlanOptions
from plan.program.assignment.legs import HOME, Arrangement, Leg, Site, Stop
from plan.program.assignment.sequencing import Costs
from plan.program.goals.leg_times import LineEnds, leg_bounds, leg_times
from plan.trajectory.time_estimates import path_time, path_times

# Time of a leg that is excluded because the number of detours is used up, s.
POSTPONED = 1e9
# Least assumed excess of a detour that was not planned yet: relative to the straight motion, and s.
_OVERHEAD, _OVERHEAD_S = 0.02, 0.05
# Largest relative excess of a detour over its assumed time with which the sequence is kept.
_NEAR = 0.03
# A detour that saves more than this over known corners adds its corners to them, s.
_NEWS_S = 0.1

Sites = tuple[Site, Site]
Table = dict[Sites, Array]


class Detours:
    """Known detours around each body, from which the cost of other detours is predicted.

    Detours around the same body are similar, in both directions, with a cube and without. So a detour that was not
    planned yet is assumed to pass the corners of a known one, or to have the median excess, whichever is less.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._corners: dict[str, list[Array]] = {}
        self.made = 0
        self._excess: dict[tuple[str, bool], list[float]] = {}
        self._median: dict[tuple[str, bool], float] = {}

    def learn(self, body: str, carrying: bool, path: Array, excess: float, over: float) -> None:
        """Record a detour (m, n) rad around `body`.

        Args:
            excess: its time less that of the straight motion, s.
            over: its time less that over known corners, s.
        """
        if over < -_NEWS_S:
            self._corners.setdefault(body, []).extend((path[1:-1], path[-2:0:-1]))
        self.made += 1
        made = self._excess.setdefault((body, carrying), [])
        made.append(excess)
        self._median[body, carrying] = float(np.median(made))

    def known(self, body: str) -> list[Array]:
        """Return the corners (c, n) rad of detours around a body, in the order in which they were planned."""
        return self._corners.get(body, [])

    def median(self, body: str, carrying: bool) -> float:
        """Return the median excess of detours around a body, s; inf if there are none."""
        return self._median.get((body, carrying), np.inf)

    def over(self, several: Sequence[Array], ends: tuple[LineEnds, LineEnds]) -> Array:
        """Return the times (k,) s of a leg over each of several corner sets (c, n)."""
        out, into = ends
        counts = np.array([len(corners) for corners in several])
        times = np.empty(len(several))
        for count in np.unique(counts):
            alike = np.flatnonzero(counts == count)
            paths = np.empty((len(alike), count + 2, out.offset.shape[1]))
            paths[:, 0], paths[:, -1] = out.offset[0], into.offset[0]
            paths[:, 1:-1] = np.stack([several[i] for i in alike.tolist()])
            times[alike] = path_times(paths, self.limits, out.velocity[0], -into.velocity[0])
        return times + float(sum(end.time[0] + end.start[0] for end in ends))

    def nearest(self, body: str, ends: tuple[LineEnds, LineEnds]) -> list[Array]:
        """Return the corners of detours around a body, those that are fastest for a leg last."""
        known = self.known(body)
        order = np.argsort(-np.round(self.over(known, ends), 6), kind="stable")
        return [known[i] for i in order.tolist()]


@dataclass
class _Block:
    """What blocks the straight motion of a leg.

    Attributes:
        body: name of the body.
        time: time of a detour, s; None if none was planned yet.
        seen, over: number of known detours compared so far, and the least time of the leg over their corners, s.
    """

    body: str
    time: float | None
    seen: int = 0
    over: float = np.inf


class _Group:
    """What is known about all legs between the same two sites.

    Attributes:
        blocks: blocked legs, by the grasps at both ends and the blocking cube (None: a fixed body).
        forbidden: those of `blocks` that are excluded for good.
        made: least excess of a detour around a fixed body, s; inf if none was planned.
        clear: whether a straight motion between the two sites was certified.
        always: times with fixed bodies in the way, and the state of knowledge that they were computed for.
    """

    def __init__(self) -> None:
        self.blocks: dict[tuple[tuple[int, int], Site | None], _Block] = {}
        self.forbidden: set[tuple[tuple[int, int], Site | None]] = set()
        self.made, self.clear = np.inf, False
        self.always: tuple[object, Array] | None = None


class LegCosts:
    """Times of all legs of a task, with what is known to block them.

    Args:
        lines: the lines of every grasp, of each source and each place, and home.
        limits: limits for planning.
        options: after which cubes images are taken.

    Attributes:
        free: obstacle-free estimates by the sites at both ends, (grasps, grasps) s.
        detours: known detours.
        assume_alike: whether a leg that was not checked is assumed to be blocked if all checked ones between the same
            sites are.
    """

    def __init__(self, lines: Mapping[Site, LineEnds], limits: Limits, options: PlanOptions) -> None:
        self.lines, self.limits, self.options = lines, limits, options
        self.sources, places = (
            [site for site in lines if site != HOME and site.placed is placed] for placed in (False, True)
        )
        self._sites: list[Sites] = [(HOME, source) for source in self.sources]
        self._sites += [(source, place) for source in self.sources for place in places]
        self._sites += [(place, source) for place in places for source in self.sources]
        self._sites += [(place, HOME) for place in places]
        self.free = self._table(leg_times)
        self.detours = Detours(limits)
        self.assume_alike = True
        self._groups: dict[Sites, _Group] = defaultdict(_Group)
        self._lines: dict[Site, set[tuple[int, Site | None]]] = {}

    def now(self) -> Costs:
        """Return the estimates with all known obstacles."""
        return self._costs(self.free, self._with_obstacles)

    def bounds(self) -> Costs:
        """Return the lower bounds, without obstacles."""
        return self._costs(self._table(leg_bounds), lambda sites, time, there: time)

    def ends(self, leg: Leg) -> tuple[LineEnds, LineEnds]:
        """Return the two ends of a leg, one row each."""
        out, into = (self.lines[stop.site].row(stop.grasp) for stop in leg)
        return out, into

    def close_line(self, stop: Stop, by: Site | None) -> None:
        """Record that the line of a grasp is blocked: always, or while the cube `by` is there."""
        self._lines.setdefault(stop.site, set()).add((stop.grasp, by))

    def block(self, leg: Leg, by: Site | None, time: float | None, body: str = "") -> None:
        """Record that `body` blocks the straight motion of a leg, and that a detour takes `time` s.

        inf: no detour was found; None: none was planned yet.
        """
        group, key = self._groups[leg.sites], (leg.grasps, by)
        before = group.blocks.get(key)
        group.blocks[key] = _Block(body or ("" if before is None else before.body), time)
        group.always = None

    def clear(self, leg: Leg) -> None:
        """Record that the straight motion of a leg was certified."""
        group = self._groups[leg.sites]
        group.clear, group.always = True, None

    def forbid(self, leg: Leg, by: Site | None) -> None:
        """Exclude a leg, or while the cube `by` is there: its path could not be certified as sent."""
        self.block(leg, by, np.inf)
        self._groups[leg.sites].forbidden.add((leg.grasps, by))

    def is_blocked(self, leg: Leg, by: Site | None) -> bool:
        """Return whether the leg is known to be blocked by that cube (None: a fixed body)."""
        return (leg.grasps, by) in self._groups[leg.sites].blocks

    def fastest_unchecked(self) -> Iterator[Leg]:
        """Yield the fastest leg between each two sites without a checked leg."""
        for (origin, goal), times in self.free.items():
            a, b = np.unravel_index(int(np.argmin(np.round(times, 9))), times.shape)
            group = self._groups[origin, goal]
            if not group.clear and not group.blocks:
                yield Leg(Stop(origin, int(a)), Stop(goal, int(b)))

    def time(self, leg: Leg, by: Site | None) -> float | None:
        """Return the time of the known detour, s; None if none was planned yet."""
        return self._groups[leg.sites].blocks[leg.grasps, by].time

    def found(self, leg: Leg, by: Site | None, path: Array) -> bool:
        """Record the time of a detour; return whether it is about the assumed time."""
        out, into = self.ends(leg)
        group = self._groups[leg.sites]
        block = group.blocks[leg.grasps, by]
        around = path_time(path, self.limits, out.velocity[0], -into.velocity[0])
        time = float(out.time[0] + out.start[0] + around + into.time[0] + into.start[0])
        assumed, excess = block.time, self._excess(leg, time)
        if assumed is None:
            assumed = self._assumed(leg, block)
            self.detours.learn(block.body, leg.carries, path, excess, time - block.over)
        block.time, group.always = time, None
        if by is None:
            group.made = min(group.made, excess)
        return time <= assumed * (1.0 + _NEAR)

    def faster(self, leg: Leg, path: Array, saved: float) -> None:
        """Record that a known detour was made faster by `saved` s."""
        group = self._groups[leg.sites]
        group.always = None
        for (grasps, by), block in group.blocks.items():
            if grasps == leg.grasps and block.time is not None and block.time < POSTPONED:
                block.time -= saved
                excess = self._excess(leg, block.time)
                self.detours.learn(block.body, leg.carries, path, excess, -saved)
                if by is None:
                    group.made = min(group.made, excess)

    def retry(self) -> None:
        """Forget failed and postponed detours; excluded legs stay excluded."""
        for group in self._groups.values():
            group.always = None
            for key, block in group.blocks.items():
                if block.time in (POSTPONED, np.inf) and key not in group.forbidden:
                    block.time = None

    def _table(self, times: Callable[[LineEnds, LineEnds, Limits], Array]) -> Table:
        return {(a, b): times(self.lines[a], self.lines[b], self.limits) for a, b in self._sites}

    def _costs(self, table: Table, blocked: Callable[[Sites, Array, Arrangement], Array]) -> Costs:
        """Return the times of a table, as `blocked` changes them in an arrangement."""

        def times(origin: Site, goal: Site, there: Arrangement) -> Array:
            if origin.placed and goal != HOME:
                done = len(self.sources) - sum(not site.placed for site in there)
                if self.options.looks_after(done):
                    return times(origin, HOME, there) + times(HOME, goal, there)
            return blocked((origin, goal), table[origin, goal], there)

        return times

    def _with_obstacles(self, sites: Sites, time: Array, there: Arrangement) -> Array:
        """Return the times between two sites with all obstacles that are known in an arrangement."""
        group = self._groups.get(sites)
        if group is not None and group.blocks:
            time = self._with_blocks(group, sites, time, there)
        closed = [self._closed(site, there) for site in sites] if sites[1].placed else []
        if any(closed):
            time = np.array(time)
            time[closed[0], :], time[:, closed[1]] = np.inf, np.inf
        return time

    def _with_blocks(self, group: _Group, sites: Sites, time: Array, there: Arrangement) -> Array:
        now, changed = self._always(group, sites, time), False
        for (grasps, by), block in group.blocks.items():
            if by is not None and by in there:
                now, changed = now if changed else np.array(now), True
                now[grasps] = max(now[grasps], self._time(sites, grasps, block))
        return now

    def _always(self, group: _Group, sites: Sites, time: Array) -> Array:
        """Return the times with fixed obstacles; they are computed again after something was learnt."""
        state = self.detours.made, self.assume_alike
        if group.always is None or group.always[0] != state:
            now, least = np.array(time), np.inf
            for (grasps, by), block in group.blocks.items():
                if by is None:
                    now[grasps] = max(time[grasps], self._time(sites, grasps, block))
                    least = min(least, now[grasps] - time[grasps])
            if self.assume_alike and not group.clear and least < np.inf:
                now = np.maximum(now, time + least)
            group.always = state, now
        return group.always[1]

    def _time(self, sites: Sites, grasps: tuple[int, int], block: _Block) -> float:
        if block.time is not None:
            return block.time
        return self._assumed(Leg(Stop(sites[0], grasps[0]), Stop(sites[1], grasps[1])), block)

    def _assumed(self, leg: Leg, block: _Block) -> float:
        """Return the assumed time of a leg whose detour was not planned yet, s."""
        straight = self._straight(leg)
        least = straight + _OVERHEAD * straight + _OVERHEAD_S
        known = self.detours.known(block.body)
        if not known:
            return least
        if block.seen < len(known):
            ends = self.ends(leg)
            block.over = min(block.over, float(self.detours.over(known[block.seen :], ends).min()))
            block.seen = len(known)
        alike = self._groups[leg.sites].made
        if alike == np.inf:
            alike = self.detours.median(block.body, leg.carries)
        return max(least, min(block.over, straight + alike))

    def _straight(self, leg: Leg) -> float:
        """Return the estimated time of the straight motion of a leg, s."""
        return float(self.free[leg.sites][leg.grasps])

    def _excess(self, leg: Leg, time: float) -> float:
        """Return by how much a detour of `time` s takes longer than the straight motion, s."""
        return max(time - self._straight(leg), 0.0)

    def _closed(self, site: Site, there: Arrangement) -> list[int]:
        """Return the grasps of a site whose line is blocked in an arrangement."""
        return sorted({grasp for grasp, by in self._lines.get(site, ()) if by is None or by in there})
