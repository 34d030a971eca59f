"""RRT-Connect (J. Kuffner, S. LaValle, ICRA 2000) in joint space scaled by the velocity limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array

_STEP = 2.0  # s of travel at full velocity, longest edge of a tree


@dataclass(eq=False)
class RrtConnect:
    """Two trees that grow towards random configurations and towards each other.

    Attributes:
        limits: joint limits; distances are the largest travel time of a joint.
        free: returns whether a configuration has the clearance.
        clear: returns whether the straight joint line between two configurations is certified.
        rng: source of all random choices.
    """

    limits: Limits
    free: Callable[[Array], bool]
    clear: Callable[[Array, Array], bool]
    rng: np.random.Generator

    def search(self, start: Array, goal: Array, samples: int) -> Array | None:
        """Return way-points (m, n) from start to goal, or None after `samples` samples."""
        trees = (_Tree(start, self.limits.velocity), _Tree(goal, self.limits.velocity))
        for _ in range(samples):
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
        """Extend the nearest node by one step towards `target`; return the new node, or None if it is blocked."""
        near = tree.nearest(target)
        step = target - tree.nodes[near]
        reach = float((np.abs(step) / self.limits.velocity).max())
        q = target if reach <= _STEP else tree.nodes[near] + step * (_STEP / reach)
        if not self.free(q) or not self.clear(tree.nodes[near], q):
            return None
        return tree.add(q, near)

    def connect(self, tree: _Tree, target: Array) -> int | None:
        """Extend towards `target` until it is reached (return its node) or blocked (return None)."""
        while True:
            grown = self.extend(tree, target)
            if grown is None or np.array_equal(tree.nodes[grown], target):
                return grown


class _Tree:
    """Configurations with their parents; distances are the largest travel time of a joint."""

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
        nodes = []
        while index >= 0:
            nodes.append(self.nodes[index])
            index = self._parent[index]
        return nodes
