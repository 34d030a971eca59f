"""Errors of poses to first order: a twist as a linear function of independent groups of errors.

Twists have the translation first and belong to one frame, which the caller states; `adjoint` maps them to another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from arm.se3 import Array, frozen


@dataclass(frozen=True, eq=False)
class ErrorGroup:
    """Errors with a joint covariance, independent of those of other groups.

    Attributes:
        covariance: (n, n), SI units.
        sources: how many of the errors, in order, come from each named source.
    """

    covariance: Array
    sources: Mapping[str, int]

    @classmethod
    def of(cls, source: str, covariance: Array) -> ErrorGroup:
        """Errors of one source."""
        return cls(frozen(covariance), {source: len(covariance)})


@dataclass(frozen=True, eq=False)
class LinearError:
    """The error of a pose.

    Attributes:
        by: per group of errors, identified by the object, the derivative of the twist, (6, n).
    """

    jacobians: Mapping[ErrorGroup, Array] = field(default_factory=dict)

    def transformed(self, M: Array) -> LinearError:
        """The error after a linear map (6, 6)."""
        return LinearError({group: M @ G for group, G in self.jacobians.items()})

    def __add__(self, other: LinearError) -> LinearError:
        sums = dict(self.jacobians)
        for group, G in other.jacobians.items():
            sums[group] = sums[group] + G if group in sums else G
        return LinearError(sums)

    def __sub__(self, other: LinearError) -> LinearError:
        return self + other.transformed(-np.eye(6))

    @property
    def covariance(self) -> Array:
        """Of the twist, (6, 6)."""
        return frozen(sum((G @ g.covariance @ G.T for g, G in self.jacobians.items()), np.zeros((6, 6))))

    def by_source(self) -> dict[str, tuple[Array, Array]]:
        """Per source: the covariance (6, 6) if it erred alone, and its part of the whole.

        The parts add up to `covariance`. They contain half of each correlation with another source, so the part of a
        source whose errors other sources cancel is smaller than its own covariance, and may be negative.
        """
        found: dict[str, tuple[Array, Array]] = {}
        for group, G in self.jacobians.items():
            whole, first = G @ group.covariance, 0
            for source, count in group.sources.items():
                of = slice(first, first + count)
                alone = G[:, of] @ group.covariance[of, of] @ G[:, of].T
                part = whole[:, of] @ G[:, of].T
                before = found.get(source, (np.zeros((6, 6)), np.zeros((6, 6))))
                found[source] = (before[0] + alone, before[1] + (part + part.T) / 2.0)
                first += count
        return found
