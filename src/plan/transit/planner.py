"""Ways through free space: straight in joint space where that is proved clear, else around what is in the way.

The search has stages, each with a budget counted in tries and random numbers from the given seed, so that the same
request gives the same way-points:

1. one or two corners: the tool lifted or drawn in from the straight move, and random places about it, in the order of
   their travel time; the first few that differ;
2. where no such way is clear, RRT-Connect (J. Kuffner, S. LaValle, ICRA 2000) in joint space scaled by speed;
3. needless corners left out, then all corners moved for time by `plan.transit.optimise`.

Every edge that is used is proved by `plan.collision.certificate`, never sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice, pairwise

import numpy as np
import numpy.typing as npt

from arm.arguments import integer
from arm.controller.unit import Limits
from arm.errors import ImpossibleError, InputError
from arm.numerics.products import norm
from arm.se3 import Array, frozen
from plan.budget import TransitBudget
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import MoveCheck, check_curve
from plan.collision.self_collision import told_own_overlaps
from plan.collision.world import World
from plan.kinematics.configuration import standing
from plan.kinematics.ik import all_branches, nearest_turns
from plan.trajectory.time_estimates import path_time, path_times
from plan.transit.optimise import Ends, Shortener
from plan.transit.rrt_connect import RrtConnect

# Places on a line that are looked at before it is proved.
_FIRST_LOOKS = (0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)
# A way that takes this much longer than the straight one is worth more tries.
_POOR = 1.25
# One that takes no more than this much longer is as good as the straight one: others are not looked at.
_ALMOST = 1.1
# How many ways are remembered, and how densely they are looked at, rad summed over the joints.
_REMEMBERED, _LOOK_TRAVEL = 6, 0.2
# Corners nearer to each other than this lead to the same way, s of travel.
_DIFFERENT = 0.7
# Ways slower than the fastest that was found by more than this are not followed up.
_WORSE = 1.5
# How far the tool is lifted, or drawn towards the base, to pass what is in the way, m.
_LIFTS = (0.04, 0.08, 0.12, 0.17, 0.23, 0.3, 0.4)


def plan_transit(
    world: World,
    q_from: npt.ArrayLike,
    q_to: npt.ArrayLike,
    limits: Limits,
    clearance: float,
    seed: int,
    budget: TransitBudget | None = None,
    ends: Ends | None = None,
) -> Array:
    """Way-points (m, n) rad from `q_from` to `q_to`; the straight joint lines between them keep the clearance, proved.

    Args:
        world: what is in the way.
        q_from, q_to: (n,) rad.
        limits: joint positions are kept; velocity and acceleration rank the ways.
        clearance: asked for between all checked pairs, m.
        seed: of all random choices.
        budget: of the search.
        ends: velocities with which the way is entered and left; default: at rest.

    Raises:
        InputError: an end is beyond a limit, or not one finite number for each joint.
        ImpossibleError: an end is itself too near to something, or no way was found; data: pair, distance_m (of the
            straight move), end ("from", "to" or None).
    """
    start = standing("q_from", q_from, world.robot, limits)
    goal = standing("q_to", q_to, world.robot, limits)
    integer("seed", seed, 0)
    for end, q in (("from", start), ("to", goal)):
        if world.in_collision(q, clearance):
            raise _end_blocked(world, end, q, clearance)
    straight = check_curve(world, curve_of_waypoints([start, goal]), clearance)
    if straight.proved:
        return frozen([start, goal])
    budget = budget or TransitBudget()
    search = Detours(world, limits, clearance, np.random.default_rng(seed), budget, ends)
    found = search.around(start, goal, straight.time)
    if found is None:
        raise ImpossibleError(
            f"no way around {straight.pair[1]}: {straight.pair[0]} comes to {straight.seen * 1e3:.1f} mm of it on the "
            f"straight move (asked: {clearance * 1e3:g} mm), and {search.budget.rrt} tries found no other; "
            "a smaller clearance or another place of the body may help",
            pair=list(straight.pair),
            distance_m=straight.seen,
            clearance_m=clearance,
            end=None,
        )
    return frozen(found)


def _end_blocked(world: World, end: str, q: Array, clearance: float) -> ImpossibleError:
    closest = world.distance(q)
    where = "start" if end == "from" else "end"
    return ImpossibleError(
        f"the {where} of the move is itself too near: {closest.pair[0]} and {closest.pair[1]} are "
        f"{closest.value * 1e3:.1f} mm apart (asked: {clearance * 1e3:g} mm)"
        + told_own_overlaps(world, q, clearance),
        pair=list(closest.pair),
        distance_m=closest.value,
        clearance_m=clearance,
        end=end,
    )


class Detours:
    """Ways around what is in the way, in one world; corners that worked are tried first the next time.

    Args:
        world, limits, clearance: as in `plan_transit`.
        rng: of all random choices.
        budget: of the search.
        ends: velocities at both ends; default: at rest.
        known: corners (c, n) of other ways, which are tried first; those of the way that is found are added.
        slack: a way is proved to keep this much less than `clearance`, m: samples miss a little.
    """

    def __init__(
        self,
        world: World,
        limits: Limits,
        clearance: float,
        rng: np.random.Generator,
        budget: TransitBudget,
        ends: Ends | None = None,
        known: list[Array] | None = None,
        slack: float = 0.0,
    ) -> None:
        self.world, self.limits, self.clearance, self.rng, self.budget = world, limits, clearance, rng, budget
        still = np.zeros(len(limits.velocity))
        self.ends = ends or Ends(still, still)
        self.known = [] if known is None else known
        self.slack = slack
        self.too_near = world.too_near(clearance)
        self.shortener = Shortener(world, limits, clearance, self.ends)

    def around(self, start: Array, goal: Array, at: float) -> Array | None:
        """A way, made as fast as the budget allows, or None; the straight one is blocked at fraction `at`."""
        straight = self.time(np.stack([start, goal]))
        trodden = self.trodden(start, goal)
        ways = self.few_corners(start, goal, at)
        first = chain([] if trodden is None else [trodden], islice(ways, self.budget.starts))
        best = self.fastest(first, _ALMOST * straight)
        if best is None or self.time(best) > _POOR * straight:
            more = self.fastest(islice(ways, self.budget.more_starts), _POOR * straight)
            if more is not None and (best is None or self.time(more) < self.time(best)):
                best = more
        if best is not None:
            return self.noted(best)
        tree = RrtConnect(self.limits, self.free, self.clear, self.rng)
        rooted = tree.search(start, goal, self.budget.rrt)
        if rooted is None:
            return None
        way = self.without_needless_corners(self.cut(self.without_needless_corners(rooted)))
        found = self.shortener.shorten(way, self.budget.steps)
        return self.noted(found if self.proved(found) else way)

    def fastest(self, ways: Iterable[Array], enough: float) -> Array | None:
        """The fastest that comes of making ways faster, proved; None where nothing is.

        No further way is looked at once one takes no more than `enough` s.
        """
        steps, rough = self.budget.steps, list[Array]()
        for way in ways:
            rough.append(self.shortener.shorten(way, max(steps // 3, 2)))
            if self.time(rough[-1]) <= enough:
                break
        for way in sorted(rough, key=lambda w: round(self.time(w), 6)):
            for trial in (self.shortener.shorten(way, steps), way):
                if self.proved(trial):
                    return trial
        return None

    def noted(self, way: Array) -> Array:
        """The way, its corners remembered."""
        self.known.append(way[1:-1])
        return way

    def trodden(self, start: Array, goal: Array) -> Array | None:
        """The fastest way through corners that served another one, if it looks clear."""
        ways = [np.concatenate([start[None], corners, goal[None]]) for corners in self.known[-_REMEMBERED:]]
        for way in sorted(ways, key=lambda w: round(self.time(w), 6)):
            if all(
                self.free(a + u * (b - a))
                for a, b in pairwise(way)
                for u in np.linspace(0.0, 1.0, 1 + int(np.ceil(np.abs(b - a).sum() / _LOOK_TRAVEL)))
            ):
                return way
        return None

    def proved(self, way: Array) -> bool:
        """Whether every edge is."""
        return check_curve(self.world, curve_of_waypoints(way), self.clearance - self.slack).proved

    def free(self, q: Array) -> bool:
        """Whether a configuration keeps the clearance."""
        return not self.too_near(q)

    def prove(self, a: Array, b: Array) -> MoveCheck:
        """The certificate of the straight joint line between a and b."""
        return check_curve(self.world, curve_of_waypoints([a, b]), self.clearance)

    def clear(self, a: Array, b: Array) -> bool:
        """Whether the straight joint line between a and b is proved."""
        # most lines that are tried are blocked: find that out the cheap way first
        return all(self.free(a + u * (b - a)) for u in _FIRST_LOOKS) and self.prove(a, b).proved

    def time(self, way: Array) -> float:
        """Estimate of the motion's time, s."""
        return path_time(way, self.limits, self.ends.enter, self.ends.leave)

    def few_corners(self, start: Array, goal: Array, at: float) -> Iterator[Array]:
        """Fast ways with one or two corners that differ from each other and look clear."""
        lifted, double = self.lifted(start, goal, at)
        single = np.concatenate([lifted, self.drawn(start, goal)[:, None]])
        groups = single, double
        times = [self.times(start, corners, goal) for corners in groups]
        alike = [np.zeros(len(corners), dtype=bool) for corners in groups]
        best, tried, looks = np.inf, 0, _Looks()
        for index in np.argsort(np.concatenate(times), kind="stable").tolist():
            group, i = (0, index) if index < len(single) else (1, index - len(single))
            time, corners = times[group][i], groups[group][i]
            if tried >= self.budget.corner_edges or time > _WORSE * best:
                break
            if alike[group][i] or not all(self.free(q) for q in corners):
                continue
            tried += 1
            way = np.concatenate([start[None], corners, goal[None]])
            if looks.clear(way, self.free):
                best = min(best, time)
                away = np.abs(groups[group] - corners) / self.limits.velocity
                alike[group] |= away.max(axis=(1, 2)) < _DIFFERENT
                yield way

    def times(self, start: Array, corners: Array, goal: Array) -> Array:
        """Estimates (m,) of ways through corners (m, c, n), s; rounded, to rank alike on every processor."""
        shape = (len(corners), 1, len(start))
        ways = np.concatenate([np.broadcast_to(start, shape), corners, np.broadcast_to(goal, shape)], axis=1)
        return np.round(path_times(ways, self.limits, self.ends.enter, self.ends.leave), 6)

    def lifted(self, start: Array, goal: Array, at: float) -> tuple[Array, Array]:
        """Corners with the tool moved up, towards the base, or both: one (m, 1, n), or two moved alike (m, 2, n).

        One corner is moved from the middle of the straight way or from `at` on it, to any branch; two are moved from
        a quarter and three quarters, to the branch that is nearest there.
        """
        robot, limits, n = self.world.robot, self.limits, len(start)
        q = start + np.array([at, 0.5, 0.25, 0.75])[:, None] * (goal - start)
        try:
            poses = np.concatenate([_lifts(robot.T_base_tool(place)) for place in q])
            raw = all_branches(robot, poses, exact=False)
        except InputError:  # an arm of another kind: random corners have to do
            return np.zeros((0, 1, n)), np.zeros((0, 2, n))
        branches = raw.q.shape[1]
        straight = q[:, None, None, :]
        turned = nearest_turns(raw.q.reshape(len(q), -1, branches, n), straight)
        inside = raw.reached.reshape(turned.shape[:3])
        inside = inside & ((turned >= limits.lower) & (turned <= limits.upper)).all(axis=-1)
        one = turned[:2][inside[:2]]
        away = np.where(inside, (np.abs(turned - straight) / limits.velocity).max(axis=-1), np.inf)[2:]
        nearest = np.argmin(np.round(away, 9), axis=-1)[..., None]
        two = np.take_along_axis(turned[2:], nearest[..., None], axis=2)[:, :, 0]
        both = np.isfinite(np.take_along_axis(away, nearest, axis=2)[..., 0]).all(axis=0)
        return one[:, None], np.swapaxes(two, 0, 1)[both]

    def drawn(self, start: Array, goal: Array) -> Array:
        """Random configurations (m, n) about the straight line."""
        n, count = len(start), self.budget.corners
        along = self.rng.uniform(0.0, 1.0, (count, 1))
        # offsets in seconds of travel, from a little to about the whole range of the slow joints
        size = 8.0 * self.rng.uniform(0.0, 1.0, (count, 1)) ** 2
        offset = self.rng.normal(size=(count, n)) * size * self.limits.velocity
        return np.clip(start + along * (goal - start) + offset, self.limits.lower, self.limits.upper)

    def cut(self, path: Array) -> Array:
        """The path with straight lines between random places on it, where they save time."""
        best = self.time(path)
        for _ in range(self.budget.shortcuts):
            if len(path) < 4:
                break
            trial, changed = self.shortcut(path)
            time = self.time(trial)
            if time < best - 1e-3 and all(self.clear(trial[i], trial[i + 1]) for i in changed):
                path, best = self.without_needless_corners(trial), time
        return path

    def without_needless_corners(self, path: Array) -> Array:
        """Corners left out whose neighbours see each other, if that saves time."""
        index = 1
        while index < len(path) - 1:
            shorter = np.delete(path, index, axis=0)
            faster = self.time(shorter) <= self.time(path)
            if faster and self.clear(path[index - 1], path[index + 1]):
                path = shorter
            else:
                index += 1
        return path

    def shortcut(self, path: Array) -> tuple[Array, list[int]]:
        """A straight line between two random places on the path; and which lines of it are new."""
        places = np.sort(self.rng.uniform(0.0, len(path) - 1.0, 2))
        i, j = int(places[0]), int(places[1])
        if i == j:
            return path, []
        a = path[i] + (places[0] - i) * (path[i + 1] - path[i])
        b = path[j] + (places[1] - j) * (path[j + 1] - path[j])
        return np.concatenate([path[: i + 1], [a, b], path[j + 1 :]]), [i + 1]


class _Looks:
    """Looks at ways; where the last one was blocked is looked at first."""

    def __init__(self) -> None:
        self.places = [(edge, u) for u in _FIRST_LOOKS for edge in range(3)]

    def clear(self, way: Array, free: Callable[[Array], bool]) -> bool:
        """Whether all places that are looked at are free."""
        steps = way[1:] - way[:-1]
        for index, (edge, u) in enumerate(self.places):
            if edge < len(steps) and not free(way[edge] + u * steps[edge]):
                self.places.insert(0, self.places.pop(index))
                return False
        return True


def _lifts(T_base_tool: Array) -> Array:
    """Poses (m, 4, 4) of a tool that is moved up, towards the base, both, or away from the base, by `_LIFTS`."""
    inward = -T_base_tool[:3, 3] * (1.0, 1.0, 0.0)
    inward /= max(float(norm(inward)), 1e-6)
    up = np.array([0.0, 0.0, 1.0])
    ways = np.stack([up, inward, up + inward, up + 0.5 * inward, -inward])
    poses = np.tile(T_base_tool, (len(ways) * len(_LIFTS), 1, 1))
    poses[:, :3, 3] += (ways[:, None] * np.array(_LIFTS)[:, None]).reshape(-1, 3)
    return poses
