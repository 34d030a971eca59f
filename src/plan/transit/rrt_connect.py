"""RRT-Connect (J. Kuffner, S. LaValle, ICRA 2000) in joint space scaled by speed; every edge is proved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array

# Extension of a tree, in seconds of travel at full speed.
_STEP = 2.0


class RrtConnect:
    """Two trees that grow towards random configurations and each other.

    Args:
        limits: of the joints; nearness is in seconds of travel of the slowest joint.
        free: whether a configuration keeps its clearance.
        clear: whether the straight joint line between two does, proved.
        rng: of all random choices.
    """

    def __init__(
        self,
        limits: Limits,
        free: Callable[[Array], bool],
        clear: Callable[[Array, Array], bool],
        rng: np.random.Generator,
    ) -> None:
        self.limits, self.free, self.clear, self.rng = limits, free, clear, rng

    def search(self, start: Array, goal: Array, samples: int) -> Array | None:
        """Way-points (m, n) from start to goal, or None after that many samples."""
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
        """One step from the nearest node towards `target`; index of the new node, or None where it is blocked."""
        near = tree.nearest(target)
        step = target - tree.nodes[near]
        reach = float((np.abs(step) / self.limits.velocity).max())
        q = target if reach <= _STEP else tree.nodes[near] + step * (_STEP / reach)
        if not self.free(q) or not self.clear(tree.nodes[near], q):
            return None
        return tree.add(q, near)

    def connect(self, tree: _Tree, target: Array) -> int | None:
        """Steps towards `target` until it is reached (index of its node) or something is in the way (None)."""
        while True:
            grown = self.extend(tree, target)
            if grown is None or np.array_equal(tree.nodes[grown], target):
                return grown


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
