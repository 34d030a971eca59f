"""Candidate paths over one or two corners: the tool lifted or retracted from the straight motion, or random corners."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.errors import InputError
from arm.numerics.products import norm
from arm.robot.model import Robot
from arm.se3 import Array
from plan.budget import TransitBudget
from plan.kinematics.closed_form import all_branches
from plan.kinematics.ik import nearest_turns
from plan.trajectory.time_estimates import path_times
from plan.transit.edges import FIRST_SAMPLES
from plan.transit.optimise import Ends

_DIFFERENT = 0.7  # s of travel between corners of paths that count as different
# Largest offset of random configurations from the straight line, s of travel: the range of the slow joints.
_LARGEST_OFFSET_S = 8.0
_WORSE = 1.5  # times the fastest path found: slower ones are skipped
_LIFTS = (0.05, 0.1, 0.17, 0.27, 0.4)  # m, by which the tool is lifted or moved towards the base


@dataclass(frozen=True, eq=False)
class FewCorners:
    """Draws paths over one or two corners and checks them at samples.

    Attributes:
        robot, limits: the arm.
        too_near: returns whether a configuration lacks the clearance (`World.too_near`).
        rng: source of all random choices.
        budget: numbers of corners and of paths.
        ends: velocities at both ends.
    """

    robot: Robot
    limits: Limits
    too_near: Callable[[Array], bool]
    rng: np.random.Generator
    budget: TransitBudget
    ends: Ends

    def paths(self, start: Array, goal: Array, at: float) -> Iterator[Array]:
        """Yield different paths without blocked samples, the fastest first; the straight one is blocked at `at`."""
        lifted, double = self.lifted(start, goal, at)
        single = np.concatenate([lifted, self.drawn(start, goal)[:, None]])
        groups = single, double
        times = [self._times(start, corners, goal) for corners in groups]
        alike = [np.zeros(len(corners), dtype=bool) for corners in groups]
        best, tried = np.inf, 0
        places = [(edge, u) for u in FIRST_SAMPLES for edge in range(3)]
        for index in np.argsort(np.concatenate(times), kind="stable").tolist():
            group, i = (0, index) if index < len(single) else (1, index - len(single))
            time, corners = times[group][i], groups[group][i]
            if tried >= self.budget.corner_edges or time > _WORSE * best:
                break
            if alike[group][i] or any(map(self.too_near, corners)):
                continue
            tried += 1
            path = np.concatenate([start[None], corners, goal[None]])
            if _clear(path, self.too_near, places):
                best = min(best, time)
                away = np.abs(groups[group] - corners) / self.limits.velocity
                alike[group] |= away.max(axis=(1, 2)) < _DIFFERENT
                yield path

    def _times(self, start: Array, corners: Array, goal: Array) -> Array:
        """Estimate durations (m,) over corners (m, c, n), s, rounded so that they rank alike on every processor."""
        shape = (len(corners), 1, len(start))
        paths = np.concatenate([np.broadcast_to(start, shape), corners, np.broadcast_to(goal, shape)], axis=1)
        return np.round(path_times(paths, self.limits, self.ends.enter, self.ends.leave), 6)

    def lifted(self, start: Array, goal: Array, at: float) -> tuple[Array, Array]:
        """Return corners with the tool moved up, towards the base, or both: single ones (m, 1, n) and pairs (m, 2, n).

        A single corner is moved from the middle of the straight path or from `at` on it, in any branch. The two of a
        pair are moved alike, from 1/4 and 3/4 of the straight path, each in its nearest branch.
        """
        robot, limits, n = self.robot, self.limits, len(start)
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


def _clear(path: Array, too_near: Callable[[Array], bool], places: list[tuple[int, float]]) -> bool:
    """Return whether no sample is too near at `places` (edge, fraction); one that is becomes the first of them."""
    steps = path[1:] - path[:-1]
    for index, (edge, u) in enumerate(places):
        if edge < len(steps) and too_near(path[edge] + u * steps[edge]):
            places.insert(0, places.pop(index))
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
