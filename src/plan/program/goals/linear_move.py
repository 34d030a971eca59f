"""A move along a line or path of a chain."""

from __future__ import annotations

from dataclasses import dataclass

from plan.motion.phase import LinearPath


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearMove(LinearPath):
    """A line of a chain.

    Attributes:
        role: approach, line or retract.
        target: index of the target at its end; of a retract, at its start.
    """

    role: str
    target: int
