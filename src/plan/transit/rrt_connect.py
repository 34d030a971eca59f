"""RRT-Connect (J. Kuffner, S. LaValle, ICRA 2000) with edges that are checked at samples.

It differs from the paper in three ways:

- Both trees grow as far as they can, not by one step, and keep the free part of a blocked line.
- The smaller tree grows, so that the one in the narrower place gets more attempts.
- Every other target keeps about half of the joints as they are at the nearest node: often only a few joints lead out of
  a narrow place, and a random direction moves all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.transit.edges import SampledEdges

_SPACING = 7  # samples of an edge between two nodes on it
_FEW_JOINTS = 0.5  # share of the targets that keep some joints
_KEPT = 0.5  # share of the joints that they keep
_TARGETS = 10  # random targets for each allowed node; in a narrow place most are blocked at the first sample


@dataclass(eq=False)
class RrtConnect:
    """Two trees that grow towards random configurations and towards each other.

    Attributes:
        limits: joint limits; distances are travel times, so that slow joints count more.
        edges: checks of the trees' edges.
        rng: source of all random choices.
    """

    limits: Limits
    edges: SampledEdges
    rng: np.random.Generator

    def search(self, start: Array, goal: Array, nodes: int) -> Array | None:
        """Return way-points (m, n) from start to goal, or None if each tree has `nodes` nodes or they hardly grow."""
        ours, other = (_Tree(root, self.limits.velocity) for root in (start, goal))
        first = ours
        for _ in range(_TARGETS * nodes):
            if len(ours) > len(other):
                ours, other = other, ours
            if len(ours) > nodes:
                break
            grown = self._grow(ours)
            if grown is None:
                continue
            near = other.nearest(ours.nodes[grown])
            met, reached = self._follow(other, near, ours.nodes[grown])
            if met is not None and reached:
                path = [*reversed(ours.back_to_root(grown)), *other.back_to_root(met)[1:]]
                return np.stack(path if ours is first else path[::-1])
        return None

    def _grow(self, tree: _Tree) -> int | None:
        """Grow towards a random target; return the last new node, or None if already the first sample is blocked."""
        limits, rng = self.limits, self.rng
        target = rng.uniform(limits.lower, limits.upper)
        near = tree.nearest(target)
        if rng.random() < _FEW_JOINTS:
            target = np.where(rng.random(len(target)) < _KEPT, tree.nodes[near], target)
        return self._follow(tree, near, target)[0]

    def _follow(self, tree: _Tree, node: int, target: Array) -> tuple[int | None, bool]:
        """Grow from a node to `target`; return the last node (None if blocked at once) and whether it is the target."""
        if np.array_equal(tree.nodes[node], target):
            return node, True
        passed, reached = self.edges.advance(tree.nodes[node], target)
        if not passed:
            return None, False
        for q in (*passed[_SPACING - 1 : -1 : _SPACING], passed[-1]):
            node = tree.add(q, node)
        return node, reached


class _Tree:
    """Configurations with their parents; distances are travel times."""

    def __init__(self, root: Array, velocity: Array) -> None:
        self.nodes = [root]
        self._parent = [-1]
        self._velocity = velocity
        self._scaled = np.empty((64, len(root)))
        self._scaled[0] = root / velocity

    def __len__(self) -> int:
        return len(self.nodes)

    def add(self, q: Array, parent: int) -> int:
        if len(self.nodes) == len(self._scaled):
            self._scaled = np.concatenate([self._scaled, np.empty_like(self._scaled)])
        self._scaled[len(self.nodes)] = q / self._velocity
        self.nodes.append(q)
        self._parent.append(parent)
        return len(self.nodes) - 1

    def nearest(self, q: Array) -> int:
        away = self._scaled[: len(self.nodes)] - q / self._velocity
        return int(np.argmin(np.einsum("ij,ij->i", away, away)))

    def back_to_root(self, index: int) -> list[Array]:
        nodes = []
        while index >= 0:
            nodes.append(self.nodes[index])
            index = self._parent[index]
        return nodes
