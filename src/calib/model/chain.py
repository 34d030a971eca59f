"""Kinematic chains with unknown parameters, evaluated for many observations at once.

A chain is a product of rigid transforms from left to right: fixed transforms, and motions about or along an axis whose
amount is the sum of a reading (of an encoder) and of unknowns. Joint offsets, link lengths, the extrinsics of a camera
or a mount, joint compliance and backlash are all unknowns of some motion; those of an arm are listed in
`calib.hand_eye.chain`. One derivative serves them all: the twist of the frame at the right end of the chain
(J. Solà et al., "A micro Lie theory", 2018, eq. 187).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm.former import renamed_arguments
from arm.se3 import Array, frozen, inverse, skew


@dataclass(frozen=True, eq=False)
class Fixed:
    """A rigid transform, 4x4."""

    T: Array


@dataclass(frozen=True, eq=False)
class Unknown:
    """A term in the amount of a motion: an unknown times a gain that may differ between observations.

    Attributes:
        index: of the unknown among all.
        gain: name of the gain in `Chain.evaluate`; "" for 1.
    """

    index: int
    gain: str = ""


@dataclass(frozen=True, eq=False)
class Motion:
    """A rotation about an axis through the origin, or a translation along it.

    Attributes:
        axis: unit vector (3,).
        turns: True for a rotation in rad, False for a translation in m.
        reading: column of the readings added to the amount, or None.
        unknowns: added to the amount.
        sign: 1, or -1 in an inverted chain.
    """

    axis: Array
    turns: bool = True
    reading: int | None = None
    unknowns: tuple[Unknown, ...] = ()
    sign: float = 1.0


Element = Fixed | Motion


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A chain evaluated at n observations. Derivatives are computed on first use.

    Attributes:
        T: (n, 4, 4).
        motions: of the chain from right to left.
        behind: transform from each motion to the right end, rotation and translation, (motions, n, 3, 4).
        gains: by name, (n,) each.
        counts: of readings and unknowns.
    """

    T: Array
    motions: tuple[Motion, ...]
    behind: Array
    gains: dict[str, Array]
    counts: tuple[int, int]

    @cached_property
    def _twists(self) -> Array:
        """Twist of the right end in its own frame per unit of each motion, translation first, (motions, n, 6)."""
        R, p = self.behind[..., :3], self.behind[..., 3]
        axes = np.array([e.sign * e.axis for e in self.motions]).reshape(-1, 3)
        rotates = np.array([e.turns for e in self.motions], dtype=bool)[:, None, None]
        along = np.einsum("mi,mnij->mnj", axes, R)
        across = np.einsum("mni,mnij->mnj", np.cross(axes[:, None], p), R)
        return np.concatenate([np.where(rotates, across, along), np.where(rotates, along, 0.0)], axis=-1)

    @cached_property
    def by_unknown(self) -> Array:
        """Twists (n, unknowns, 6) of the right end in its own frame per unit of each unknown, translation first."""
        by_unknown = np.zeros((len(self.T), self.counts[1], 6))
        for e, twist in zip(self.motions, self._twists, strict=True):
            for u in e.unknowns:
                by_unknown[:, u.index] += self.gains[u.gain][:, None] * twist if u.gain else twist
        return by_unknown

    @cached_property
    def by_reading(self) -> Array:
        """Twists (n, readings, 6) of the right end in its own frame per unit of each reading, translation first."""
        by_reading = np.zeros((len(self.T), self.counts[0], 6))
        for e, twist in zip(self.motions, self._twists, strict=True):
            if e.reading is not None:
                by_reading[:, e.reading] += twist
        return by_reading


@renamed_arguments(turned_round="inverse")
@dataclass(frozen=True, eq=False)
class Chain:
    """A product of elements from left to right."""

    elements: tuple[Element, ...]

    @cached_property
    def _motions(self) -> tuple[Motion, ...]:
        """From right to left."""
        return tuple(e for e in reversed(self.elements) if isinstance(e, Motion))

    @cached_property
    def _crosses(self) -> tuple[Array, Array]:
        """Cross product matrix of each motion's axis, and its square, (motions, 1, 3, 3) each."""
        K = np.array([skew(e.axis) for e in self._motions]).reshape(-1, 1, 3, 3)
        return K, K @ K

    def __add__(self, other: Chain) -> Chain:
        return Chain(self.elements + other.elements)

    def inverse(self) -> Chain:
        """Return the inverse transform as a chain."""
        back = tuple(
            Fixed(inverse(e.T)) if isinstance(e, Fixed) else replace(e, sign=-e.sign)
            for e in reversed(self.elements)
        )
        return Chain(back)

    def evaluate(self, readings: Array, unknowns: Array, gains: dict[str, Array] | None = None) -> Evaluated:
        """Evaluate at readings (n, readings) in rad or m, with unknowns (count,) and gains (n,) by name."""
        n, gains = len(readings), gains or {}
        motions = self._motions
        amounts = np.zeros((len(motions), n))
        for amount, motion in zip(amounts, motions, strict=True):
            if motion.reading is not None:
                amount += readings[:, motion.reading]
            for u in motion.unknowns:
                amount += gains[u.gain] * unknowns[u.index] if u.gain else unknowns[u.index]
            amount *= motion.sign
        turned = _turned(*self._crosses, amounts)
        behind = np.empty((len(motions), n, 3, 4))
        at = np.tile(np.eye(3, 4), (n, 1, 1))
        k = 0
        for e in reversed(self.elements):
            if isinstance(e, Fixed):
                at = e.T[:3, :3] @ at
                at[..., 3] += e.T[:3, 3]
                continue
            behind[k] = at
            if e.turns:
                at = turned[k] @ at
            else:
                at[..., 3] += amounts[k, :, None] * e.axis
            k += 1
        T = np.tile(np.eye(4), (n, 1, 1))
        T[:, :3] = at
        return Evaluated(T, motions, behind, gains, (readings.shape[1], len(unknowns)))


def _turned(K: Array, square: Array, amounts: Array) -> Array:
    """Rotation matrices (motions, n, 3, 3) for amounts (motions, n), by Rodrigues' formula; `square` is K @ K."""
    angles = amounts[..., None, None]
    return np.asarray(np.eye(3) + np.sin(angles) * K + (1.0 - np.cos(angles)) * square)


def pose_unknowns(first: int) -> tuple[Motion, ...]:
    """A free rigid transform: translations along, then rotations about x, y, z; unknowns `first` to `first` + 5."""
    return tuple(Motion(frozen(np.eye(3)[i % 3]), i >= 3, None, (Unknown(first + i),)) for i in range(6))


def joined(elements: Sequence[Element]) -> Chain:
    """Build a chain, multiplying adjacent fixed transforms."""
    kept: list[Element] = []
    for e in elements:
        if isinstance(e, Fixed) and kept and isinstance(kept[-1], Fixed):
            kept[-1] = Fixed(frozen(kept[-1].T @ e.T))
        else:
            kept.append(e)
    return Chain(tuple(kept))
