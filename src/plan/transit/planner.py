"""Transits: straight in joint space if that is certified, else on a path around bodies.

The search has stages. Budgets are counted in attempts, and random numbers come from the given seed, so the same request
gives the same way-points:

1. paths over one or two corners: the tool lifted or retracted from the straight move, and random configurations about
   it, in the order of their travel time; the first few that differ;
2. if none of these is collision-free, RRT-Connect (J. Kuffner, S. LaValle, ICRA 2000) in joint space scaled by the
   velocity limits, followed by removal of needless corners;
3. optimisation of the corners for time (`plan.transit.optimise`).

Every edge of the result is certified by `plan.collision.certificate`, not only sampled.
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
from plan.collision.certificate import certify_curve
from plan.collision.missing_srdf import self_collision_help
from plan.collision.world import World
from plan.kinematics.closed_form import all_branches
from plan.kinematics.configuration import check_configuration
from plan.kinematics.ik import nearest_turns
from plan.trajectory.time_estimates import path_times
from plan.transit.optimise import Ends, TransitOptimiser
from plan.transit.rrt_connect import RrtConnect

# Fractions of a line to sample before a certificate.
_FIRST_SAMPLES = 0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875
# Duration of the best path relative to the straight one: above `_POOR`, more paths are optimised; up to `_ALMOST`, the
# first ones suffice.
_POOR = 1.25
_ALMOST = 1.1
# Number of earlier paths to reuse, and the distance of their samples, rad summed over the joints.
_REMEMBERED, _SAMPLE_TRAVEL = 6, 0.2
_DIFFERENT = 0.7  # s of travel between corners of paths that count as different
# Largest offset of random configurations from the straight line, s of travel: the range of the slow joints.
_LARGEST_OFFSET_S = 8.0
_WORSE = 1.5  # times the fastest path found: slower ones are skipped
_LIFTS = (0.04, 0.08, 0.12, 0.17, 0.23, 0.3, 0.4)  # m, by which the tool is lifted or moved towards the base


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
    """Return way-points (m, n) rad from `q_from` to `q_to` such that the straight lines between them are certified.

    Args:
        world: bodies to avoid.
        q_from, q_to: (n,) rad.
        limits: limits of position; velocity and acceleration rank the paths.
        clearance: required between all checked pairs, m.
        seed: seed of all random choices.
        budget: budget of the search.
        ends: velocities at both ends; default: at rest.

    Raises:
        InputError: an end is beyond a limit, or not one finite number per joint.
        ImpossibleError: an end itself is too near to a body, or no path was found; data: pair, distance_m (of the
            straight move), end ("from", "to" or None).
    """
    start = check_configuration("q_from", q_from, world.robot, limits)
    goal = check_configuration("q_to", q_to, world.robot, limits)
    integer("seed", seed, 0)
    for end, q in (("from", start), ("to", goal)):
        if world.in_collision(q, clearance):
            raise _end_blocked(world, end, q, clearance)
    straight = certify_curve(world, curve_of_waypoints([start, goal]), clearance)
    if straight.proved:
        return frozen([start, goal])
    budget = budget or TransitBudget()
    search = TransitPlanner(world, limits, clearance, np.random.default_rng(seed), budget, ends)
    found = search.around(start, goal, straight.time)
    if found is None:
        raise ImpossibleError(
            f"no path around {straight.pair[1]}: {straight.pair[0]} comes within {straight.seen * 1e3:.1f} mm of it on "
            f"the straight move (required: {clearance * 1e3:g} mm), and {search.budget.rrt} samples of RRT-Connect "
            "found no other; a smaller clearance or another place of the body may help",
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
        f"{closest.value * 1e3:.1f} mm apart (required: {clearance * 1e3:g} mm)"
        + self_collision_help(world, q, clearance),
        pair=list(closest.pair),
        distance_m=closest.value,
        clearance_m=clearance,
        end=end,
    )


class TransitPlanner:
    """Finds paths around bodies in one world.

    Args:
        world, limits, clearance: as in `plan_transit`.
        rng: source of all random choices.
        budget: budget of the search.
        ends: velocities at both ends; default: at rest.
        known: corners (c, n) of earlier paths, which are tried first; those of a new path are appended.
        slack: paths are certified with this much less than `clearance`, m, because samples miss a little.
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
        self.optimiser = TransitOptimiser(world, limits, clearance, self.ends)
        self.time = self.optimiser.time

    def around(self, start: Array, goal: Array, at: float) -> Array | None:
        """Return an optimised path, or None; the straight one is blocked at fraction `at`."""
        straight = self.time(np.stack([start, goal]))
        known = self.over_known_corners(start, goal)
        paths = self.few_corners(start, goal, at)
        first = chain([] if known is None else [known], islice(paths, self.budget.starts))
        best = self.fastest_certified(first, _ALMOST * straight)
        if best is None or self.time(best) > _POOR * straight:
            more = self.fastest_certified(islice(paths, self.budget.more_starts), _POOR * straight)
            if more is not None and (best is None or self.time(more) < self.time(best)):
                best = more
        if best is not None:
            return self.remembered(best)
        tree = RrtConnect(self.limits, self.free, self.clear, self.rng)
        rooted = tree.search(start, goal, self.budget.rrt)
        if rooted is None:
            return None
        path = self.without_needless_corners(self.cut(self.without_needless_corners(rooted)))
        found = self.optimiser.shorten(path, self.budget.steps)
        return self.remembered(found if self.proved(found) else path)

    def fastest_certified(self, paths: Iterable[Array], enough: float) -> Array | None:
        """Optimise paths, and return the first one that is certified in order of their estimated time, or None.

        No further path is optimised once one takes at most `enough` s.
        """
        steps, rough = self.budget.steps, list[Array]()
        for path in paths:
            rough.append(self.optimiser.shorten(path, max(steps // 3, 2)))
            if self.time(rough[-1]) <= enough:
                break
        for path in sorted(rough, key=lambda w: round(self.time(w), 6)):
            for trial in (self.optimiser.shorten(path, steps), path):
                if self.proved(trial):
                    return trial
        return None

    def remembered(self, path: Array) -> Array:
        """Append the corners of a path to the known ones and return the path."""
        self.known.append(path[1:-1])
        return path

    def over_known_corners(self, start: Array, goal: Array) -> Array | None:
        """Return the fastest path over known corners that has no sample in collision, or None."""
        paths = [np.concatenate([start[None], corners, goal[None]]) for corners in self.known[-_REMEMBERED:]]
        for path in sorted(paths, key=lambda w: round(self.time(w), 6)):
            if all(
                self.free(a + u * (b - a))
                for a, b in pairwise(path)
                for u in np.linspace(0.0, 1.0, 1 + int(np.ceil(np.abs(b - a).sum() / _SAMPLE_TRAVEL)))
            ):
                return path
        return None

    def proved(self, path: Array) -> bool:
        """Return whether every edge is certified."""
        return certify_curve(self.world, curve_of_waypoints(path), self.clearance - self.slack).proved

    def free(self, q: Array) -> bool:
        """Return whether a configuration has the clearance."""
        return not self.too_near(q)

    def clear(self, a: Array, b: Array) -> bool:
        """Return whether the straight joint line between a and b is certified."""
        # most lines are blocked, and samples find that out cheaply
        if not all(self.free(a + u * (b - a)) for u in _FIRST_SAMPLES):
            return False
        return certify_curve(self.world, curve_of_waypoints([a, b]), self.clearance).proved

    def few_corners(self, start: Array, goal: Array, at: float) -> Iterator[Array]:
        """Yield different paths over one or two corners without samples in collision, the fastest first."""
        lifted, double = self.lifted(start, goal, at)
        single = np.concatenate([lifted, self.drawn(start, goal)[:, None]])
        groups = single, double
        times = [self.times(start, corners, goal) for corners in groups]
        alike = [np.zeros(len(corners), dtype=bool) for corners in groups]
        best, tried, samples = np.inf, 0, _Samples()
        for index in np.argsort(np.concatenate(times), kind="stable").tolist():
            group, i = (0, index) if index < len(single) else (1, index - len(single))
            time, corners = times[group][i], groups[group][i]
            if tried >= self.budget.corner_edges or time > _WORSE * best:
                break
            if alike[group][i] or not all(self.free(q) for q in corners):
                continue
            tried += 1
            path = np.concatenate([start[None], corners, goal[None]])
            if samples.clear(path, self.free):
                best = min(best, time)
                away = np.abs(groups[group] - corners) / self.limits.velocity
                alike[group] |= away.max(axis=(1, 2)) < _DIFFERENT
                yield path

    def times(self, start: Array, corners: Array, goal: Array) -> Array:
        """Estimate durations (m,) over corners (m, c, n), s, rounded so that they rank alike on every processor."""
        shape = (len(corners), 1, len(start))
        paths = np.concatenate([np.broadcast_to(start, shape), corners, np.broadcast_to(goal, shape)], axis=1)
        return np.round(path_times(paths, self.limits, self.ends.enter, self.ends.leave), 6)

    def lifted(self, start: Array, goal: Array, at: float) -> tuple[Array, Array]:
        """Return corners with the tool moved up, towards the base, or both: single ones (m, 1, n) and pairs (m, 2, n).

        A single corner is moved from the middle of the straight path or from `at` on it, in any branch. The two of a
        pair are moved alike, from 1/4 and 3/4 of the straight path, each in its nearest branch.
        """
        robot, limits, n = self.world.robot, self.limits, len(start)
        q = start + np.array([at, 0.5, 0.25, 0.75])[:, None] * (goal - start)
        try:
            poses = np.concatenate([_lifts(robot.T_base_tool(place)) for place in q])
            raw = all_branches(robot, poses, exact=False)
        except InputError:  # no closed form for this arm: only random corners
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
        """Draw random configurations (m, n) about the straight line."""
        n, count = len(start), self.budget.corners
        along = self.rng.uniform(0.0, 1.0, (count, 1))
        size = _LARGEST_OFFSET_S * self.rng.uniform(0.0, 1.0, (count, 1)) ** 2
        offset = self.rng.normal(size=(count, n)) * size * self.limits.velocity
        return np.clip(start + along * (goal - start) + offset, self.limits.lower, self.limits.upper)

    def cut(self, path: Array) -> Array:
        """Shorten a path by straight lines between random places on it, where they save time."""
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
        """Remove corners if the straight line between their neighbours is certified and saves time."""
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
        """Connect two random places on the path by a straight line; return the path and the indices of new lines."""
        places = np.sort(self.rng.uniform(0.0, len(path) - 1.0, 2))
        i, j = int(places[0]), int(places[1])
        if i == j:
            return path, []
        a = path[i] + (places[0] - i) * (path[i + 1] - path[i])
        b = path[j] + (places[1] - j) * (path[j + 1] - path[j])
        return np.concatenate([path[: i + 1], [a, b], path[j + 1 :]]), [i + 1]


class _Samples:
    """Samples of paths; the place where the last path was blocked is checked first."""

    def __init__(self) -> None:
        self.places = [(edge, u) for u in _FIRST_SAMPLES for edge in range(3)]

    def clear(self, path: Array, free: Callable[[Array], bool]) -> bool:
        """Return whether all samples are free."""
        steps = path[1:] - path[:-1]
        for index, (edge, u) in enumerate(self.places):
            if edge < len(steps) and not free(path[edge] + u * steps[edge]):
                self.places.insert(0, self.places.pop(index))
                return False
        return True


def _lifts(T_base_tool: Array) -> Array:
    """Return poses (m, 4, 4) of the tool moved up, towards the base, both, or away from the base, by `_LIFTS`."""
    inward = -T_base_tool[:3, 3] * (1.0, 1.0, 0.0)
    inward /= max(float(norm(inward)), 1e-6)
    up = np.array([0.0, 0.0, 1.0])
    directions = np.stack([up, inward, up + inward, up + 0.5 * inward, -inward])
    poses = np.tile(T_base_tool, (len(directions) * len(_LIFTS), 1, 1))
    poses[:, :3, 3] += (directions[:, None] * np.array(_LIFTS)[:, None]).reshape(-1, 3)
    return poses
