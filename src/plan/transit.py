"""Ways through free space: straight in joint space where that is proved clear, else around what is in the way.

The search has three stages, each with a budget counted in tries and random numbers from the given seed, so that the
same request gives the same way-points:

1. one corner: many candidates near the straight line, tried in the order of their travel time;
2. where no single corner does, RRT-Connect (J. Kuffner, S. LaValle, ICRA 2000) in joint space scaled by speed;
3. shortcuts and small moves of the corners, kept where they save time.

Every edge that is used is proved by `plan.check`, never sampled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.errors import ImpossibleError
from arm.se3 import Array, frozen
from arm.unit import Limits
from plan.check import check_curve, curve_of_waypoints
from plan.travel import path_time, path_times
from plan.world import World


@dataclass(frozen=True)
class TransitBudget:
    """Tries of each stage. Costs are about 0.01 ms for a corner that is refused by itself, 1 ms for an edge.

    Attributes:
        corners: single corners drawn; `corner_edges` of them, the fastest, have their edges proved.
        rrt: samples of RRT-Connect.
        improvements: tries to shorten what was found.
    """

    corners: int = 3000
    corner_edges: int = 120
    rrt: int = 3000
    improvements: int = 150


# Places on a line that are looked at before it is proved.
_FIRST_LOOKS = (0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)
# Extension of an RRT tree, in seconds of travel at full speed.
_RRT_STEP = 2.0


def plan_transit(
    world: World,
    q_from: npt.ArrayLike,
    q_to: npt.ArrayLike,
    limits: Limits,
    clearance: float,
    seed: int,
    budget: TransitBudget | None = None,
) -> Array:
    """Way-points (m, n) rad from `q_from` to `q_to`; the straight joint lines between them keep the clearance, proved.

    Args:
        world: what is in the way.
        q_from, q_to: (n,) rad.
        limits: joint positions are kept; velocity and acceleration rank the ways.
        clearance: asked for between all checked pairs, m.
        seed: of all random choices.
        budget: of the search; without improvements the way found is left to `improve_transit`.

    Raises:
        ImpossibleError: an end is itself too near to something, or no way was found; data: pair, distance_m (of the
            straight move), end ("from", "to" or None).
    """
    start, goal = np.asarray(q_from, dtype=float), np.asarray(q_to, dtype=float)
    for end, q in (("from", start), ("to", goal)):
        if world.in_collision(q, clearance):
            raise _end_blocked(world, end, q, clearance)
    straight = check_curve(world, curve_of_waypoints([start, goal]), clearance)
    if straight.proved:
        return frozen([start, goal])
    search = _Search(world, limits, clearance, np.random.default_rng(seed), budget or TransitBudget())
    found = search.one_corner(start, goal)
    if found is None:
        found = search.rrt_connect(start, goal)
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
    return frozen(search.improved(found))


def improve_transit(
    world: World,
    waypoints: Array,
    limits: Limits,
    clearance: float,
    seed: int,
    budget: TransitBudget | None = None,
) -> Array:
    """Way-points of a faster transit near the given one, proved like it; see `plan_transit`."""
    search = _Search(world, limits, clearance, np.random.default_rng(seed), budget or TransitBudget())
    return frozen(search.improved(waypoints))


def _end_blocked(world: World, end: str, q: Array, clearance: float) -> ImpossibleError:
    closest = world.distance(q)
    where = "start" if end == "from" else "end"
    return ImpossibleError(
        f"the {where} of the move is itself too near: {closest.pair[0]} and {closest.pair[1]} are "
        f"{closest.value * 1e3:.1f} mm apart (asked: {clearance * 1e3:g} mm)",
        pair=list(closest.pair),
        distance_m=closest.value,
        clearance_m=clearance,
        end=end,
    )


class _Search:
    def __init__(
        self, world: World, limits: Limits, clearance: float, rng: np.random.Generator, budget: TransitBudget
    ) -> None:
        self.world, self.limits, self.clearance, self.rng, self.budget = world, limits, clearance, rng, budget

    def clear(self, a: Array, b: Array) -> bool:
        """Whether the straight joint line between a and b is proved."""
        # most lines that are tried are blocked: find that out the cheap way first
        if any(self.world.in_collision(a + u * (b - a), self.clearance) for u in _FIRST_LOOKS):
            return False
        return check_curve(self.world, curve_of_waypoints([a, b]), self.clearance).proved

    def one_corner(self, start: Array, goal: Array) -> Array | None:
        """The fastest of many ways with one corner, or None."""
        n, count = len(start), self.budget.corners
        along = self.rng.uniform(0.0, 1.0, (count, 1))
        # offsets in seconds of travel, from a little to about the whole range of the slow joints
        size = 8.0 * self.rng.uniform(0.0, 1.0, (count, 1)) ** 2
        offset = self.rng.normal(size=(count, n)) * size * self.limits.velocity
        corners = np.clip(start + along * (goal - start) + offset, self.limits.lower, self.limits.upper)
        ways = np.stack(
            [np.broadcast_to(start, corners.shape), corners, np.broadcast_to(goal, corners.shape)], axis=1
        )
        times = path_times(ways, self.limits)
        tried = 0
        for index in np.argsort(times, kind="stable"):
            corner = corners[index]
            if self.world.in_collision(corner, self.clearance):
                continue
            if self.clear(start, corner) and self.clear(corner, goal):
                return np.stack([start, corner, goal])
            tried += 1
            if tried >= self.budget.corner_edges:
                break
        return None

    def rrt_connect(self, start: Array, goal: Array) -> Array | None:
        """Two trees that grow towards random configurations and each other."""
        trees = (_Tree(start, self.limits.velocity), _Tree(goal, self.limits.velocity))
        for _ in range(self.budget.rrt):
            target = self.rng.uniform(self.limits.lower, self.limits.upper)
            grown = self.extend(trees[0], target)
            if grown is not None:
                reached = trees[0].nodes[grown]
                met = self.connect(trees[1], reached)
                if met is not None:
                    first, second = trees[0].back_to_root(grown), trees[1].back_to_root(met)
                    path = [*reversed(first), *second[1:]]
                    if not np.array_equal(path[0], start):
                        path.reverse()
                    return np.stack(path)
            trees = (trees[1], trees[0])
        return None

    def extend(self, tree: _Tree, target: Array) -> int | None:
        """One step from the nearest node towards `target`; index of the new node, or None where it is blocked."""
        near = tree.nearest(target)
        step = target - tree.nodes[near]
        reach = float((np.abs(step) / self.limits.velocity).max())
        q = target if reach <= _RRT_STEP else tree.nodes[near] + step * (_RRT_STEP / reach)
        if self.world.in_collision(q, self.clearance) or not self.clear(tree.nodes[near], q):
            return None
        return tree.add(q, near)

    def connect(self, tree: _Tree, target: Array) -> int | None:
        """Steps towards `target` until it is reached (index of its node) or something is in the way (None)."""
        while True:
            grown = self.extend(tree, target)
            if grown is None or np.array_equal(tree.nodes[grown], target):
                return grown

    def improved(self, path: Array) -> Array:
        """The path with corners cut out or moved, as long as that saves time."""
        path = self.without_needless_corners(path)
        best = path_time(path, self.limits)
        for attempt in range(self.budget.improvements):
            if len(path) < 3:
                break
            if len(path) > 3 and attempt % 2 == 0:
                trial, changed = self.shortcut(path)
            else:
                shrink = 1.0 - attempt / self.budget.improvements
                trial, changed = self.moved_corner(path, 2.0 * shrink**2 + 0.02)
            time = path_time(trial, self.limits)
            if time < best - 1e-3 and all(self.clear(trial[i], trial[i + 1]) for i in changed):
                path, best = trial, time
        return self.without_needless_corners(path)

    def without_needless_corners(self, path: Array) -> Array:
        """Corners left out whose neighbours see each other, if that saves time."""
        index = 1
        while index < len(path) - 1:
            shorter = np.delete(path, index, axis=0)
            faster = path_time(shorter, self.limits) <= path_time(path, self.limits)
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

    def moved_corner(self, path: Array, size: float) -> tuple[Array, list[int]]:
        """A random corner moved by about `size` seconds of travel; and which lines of it are new."""
        index = int(self.rng.integers(1, len(path) - 1))
        offset = self.rng.normal(size=path.shape[1]) * size * self.limits.velocity
        trial = path.copy()
        trial[index] = np.clip(path[index] + offset, self.limits.lower, self.limits.upper)
        return trial, [index - 1, index]


class _Tree:
    """Configurations with their parents; nearness is in seconds of travel of the slowest joint."""

    def __init__(self, root: Array, velocity: Array) -> None:
        self.nodes = [root]
        self._parent = [-1]
        self._velocity = velocity
        self._scaled = np.empty((64, len(root)))
        self._scaled[0] = root / velocity

    def add(self, q: Array, parent: int) -> int:
        if len(self.nodes) == len(self._scaled):
            self._scaled = np.concatenate([self._scaled, np.empty_like(self._scaled)])
        self._scaled[len(self.nodes)] = q / self._velocity
        self.nodes.append(q)
        self._parent.append(parent)
        return len(self.nodes) - 1

    def nearest(self, q: Array) -> int:
        away = np.abs(self._scaled[: len(self.nodes)] - q / self._velocity).max(axis=1)
        return int(np.argmin(away))

    def back_to_root(self, index: int) -> list[Array]:
        way = []
        while index >= 0:
            way.append(self.nodes[index])
            index = self._parent[index]
        return way
