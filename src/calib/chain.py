"""Kinematic chains with unknowns in them, for many observations at once.

A chain is a product of rigid transforms from left to right: fixed ones, and motions along an axis by an angle or a
length that is made of a reading (an encoder's) and of unknowns. A joint offset, a link's length, a camera's rotation,
a mount, a spring and the play of a gear all are unknowns of some motion, so one derivative serves them all: the twist
that a motion gives to the frame at the chain's right end (J. Solà et al., "A micro Lie theory", 2018, eq. 187).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.se3 import Array, frozen, inverse, skew


@dataclass(frozen=True, eq=False)
class Fixed:
    """A rigid transform, 4x4."""

    T: Array


@dataclass(frozen=True, eq=False)
class Unknown:
    """A share of a motion: an unknown times a gain, which may differ from observation to observation.

    Attributes:
        index: of the unknown among all.
        gain: name of the gain in `Chain.evaluate`; "" for 1.
    """

    index: int
    gain: str = ""


@dataclass(frozen=True, eq=False)
class Motion:
    """A turn about an axis through the origin, or a shift along it.

    Attributes:
        axis: unit vector (3,).
        turns: whether it turns by an angle in rad, or shifts by a length in m.
        reading: column of the readings that are in it, or None.
        unknowns: that are in it.
        sign: 1, or -1 in a chain that was turned round.
    """

    axis: Array
    turns: bool = True
    reading: int | None = None
    unknowns: tuple[Unknown, ...] = ()
    sign: float = 1.0


Element = Fixed | Motion


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A chain at n observations.

    Attributes:
        T: (n, 4, 4).
        by_unknown: twists (n, unknowns, 6) of the right end in its own frame, translation first, per unit.
        by_reading: the same per reading, (n, readings, 6).
    """

    T: Array
    by_unknown: Array
    by_reading: Array


@dataclass(frozen=True, eq=False)
class Chain:
    """Elements from left to right."""

    elements: tuple[Element, ...]

    def __add__(self, other: Chain) -> Chain:
        return Chain(self.elements + other.elements)

    def turned_round(self) -> Chain:
        """The inverse transform as a chain."""
        back = tuple(
            Fixed(inverse(e.T)) if isinstance(e, Fixed) else replace(e, sign=-e.sign)
            for e in reversed(self.elements)
        )
        return Chain(back)

    def evaluate(self, readings: Array, unknowns: Array, gains: dict[str, Array] | None = None) -> Evaluated:
        """The chain at readings (n, readings) rad or m for unknowns (count,) and gains (n,) by name."""
        n = len(readings)
        B = np.tile(np.eye(4), (n, 1, 1))
        by_unknown = np.zeros((n, len(unknowns), 6))
        by_reading = np.zeros((n, readings.shape[1], 6))
        gains = gains or {}
        for e in reversed(self.elements):
            if isinstance(e, Fixed):
                B = e.T @ B
                continue
            amount = np.zeros(n) if e.reading is None else readings[:, e.reading].copy()
            twist = e.sign * _at_right_end(e, B)
            if e.reading is not None:
                by_reading[:, e.reading] += twist
            for u in e.unknowns:
                gain = gains[u.gain] if u.gain else np.ones(n)
                amount += gain * unknowns[u.index]
                by_unknown[:, u.index] += gain[:, None] * twist
            B = _moved(e, e.sign * amount, B)
        return Evaluated(B, by_unknown, by_reading)


def _at_right_end(e: Motion, B: Array) -> Array:
    """The motion's twist (n, 6) per unit in the frame to which the transforms B (n, 4, 4) lead."""
    R, p = B[:, :3, :3], B[:, :3, 3]
    along = e.axis @ R
    if not e.turns:
        return np.concatenate([along, np.zeros_like(p)], axis=1)
    across = p @ skew(e.axis).T
    return np.concatenate([(across[:, None] @ R)[:, 0], along], axis=1)


def _moved(e: Motion, amount: Array, B: Array) -> Array:
    """exp(axis amount) B, for amounts (n,)."""
    moved = B.copy()
    if not e.turns:
        moved[:, :3, 3] += amount[:, None] * e.axis
        return moved
    K = skew(e.axis)
    R = np.eye(3) + np.sin(amount)[:, None, None] * K + (1.0 - np.cos(amount))[:, None, None] * (K @ K)
    moved[:, :3] = R @ B[:, :3]
    return moved


def pose_unknowns(first: int) -> tuple[Motion, ...]:
    """A free rigid transform: shifts along and turns about x, y, z, unknowns `first` to `first` + 5."""
    axes = np.eye(3)
    shifts = [Motion(frozen(axes[i]), False, None, (Unknown(first + i),)) for i in range(3)]
    turns = [Motion(frozen(axes[i]), True, None, (Unknown(first + 3 + i),)) for i in range(3)]
    return (*shifts, *turns)


def joined(elements: Sequence[Element]) -> Chain:
    """A chain with neighbouring fixed transforms multiplied."""
    kept: list[Element] = []
    for e in elements:
        if isinstance(e, Fixed) and kept and isinstance(kept[-1], Fixed):
            kept[-1] = Fixed(frozen(kept[-1].T @ e.T))
        else:
            kept.append(e)
    return Chain(tuple(kept))
