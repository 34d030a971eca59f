"""Layers of candidates, and what every sequence through them takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.program.goals.leg_times import LineEnds, leg_bounds, stacked
from plan.program.goals.line_chains import LineChain
from plan.program.sequence.times import ChainTime


@dataclass(frozen=True, eq=False)
class Layer:
    """Candidates of one group of targets; the start is a layer with one candidate, without items.

    Attributes:
        name: name of the first target, for messages.
        chains: the candidates.
        times: times of each candidate.
    """

    name: str
    chains: tuple[LineChain, ...]
    times: tuple[ChainTime, ...]

    @cached_property
    def arrive(self) -> LineEnds:
        """Where legs to it end, a row each."""
        return stacked([t.arrive for t in self.times])

    @cached_property
    def depart(self) -> LineEnds:
        """Where legs from it begin, a row each."""
        return stacked([t.depart for t in self.times])

    @cached_property
    def inner(self) -> Array:
        """Estimate of the time of each candidate from end to end, s."""
        return np.array([t.inner for t in self.times])

    @cached_property
    def between_s(self) -> Array:
        """Lower bound on the time of each candidate from its first to its last stop, s."""
        return np.array([t.between_s for t in self.times])


def cost_to_go(layers: Sequence[Layer], estimates: Sequence[Array]) -> list[Array]:
    """Return the estimated times from the end of each chain to the end of the program, over straight motions, s.

    Args:
        layers: in order.
        estimates: (k, l) s of the legs from each layer to the next.
    """
    left = [np.zeros(len(layers[-1].chains))]
    for estimate, layer in zip(reversed(estimates), reversed(layers), strict=False):
        left.insert(0, (estimate + layer.inner + left[0]).min(axis=1))
    return left


def lower_bound(layers: Sequence[Layer], limits: Limits) -> float:
    """Return a lower bound on the time of any motion through these chains, whatever the transits, s.

    Targets that are only passed near them do not count, except the last one, which is reached.
    """
    best = np.zeros(len(layers[0].chains))
    reached = [layer for layer in layers[:-1] if not any(time.passed for time in layer.times)]
    for a, b in pairwise([*reached, layers[-1]]):
        best = (best[:, None] + leg_bounds(a.depart, b.arrive, limits)).min(axis=0) + b.between_s
    return float((best + layers[-1].depart.least).min())
