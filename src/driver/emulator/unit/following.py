"""How the axes follow their reference: exactly, unless one is stuck or drifts, or all lag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from driver.emulator.faults.model import Fault

_CATCH_UP = 10.0  # counts/ms: speed at which an axis that was stuck returns to its reference


@dataclass
class _Drift:
    fault: Fault
    index: int
    share: float = 0.0  # counts drifted so far


class Following:
    """Deviation of the actual position from the reference, counts, axis by axis.

    Args:
        axes: letters, in the arm's order.

    Attributes:
        active: whether any axis may deviate from its reference.
    """

    def __init__(self, axes: Sequence[str]) -> None:
        self._axes = tuple(axes)
        self._off = [0.0] * len(axes)
        self._stuck: dict[int, float] = {}  # axis index to its position
        self._back: set[int] = set()
        self._drifts: list[_Drift] = []
        self._lag_ms = 0.0
        self._last: tuple[int, ...] | None = None
        self.active = False

    def begin(self, fault: Fault, reference: tuple[int, ...]) -> None:
        """Begin a `stuck_axis`, `drift` or `lag`. A fault of an axis that the arm does not have does nothing."""
        self._last = reference
        if fault.kind == "lag":
            self._lag_ms = fault.lag_ms
        elif fault.axis in self._axes:
            index = self._axes.index(fault.axis)
            if fault.kind == "stuck_axis":
                self._stuck[index] = reference[index] + self._off[index]
            else:
                self._drifts.append(_Drift(fault, index))
        self.active = True

    def end(self, fault: Fault) -> None:
        """End a fault. A stuck axis returns to its reference; a drifted one keeps its deviation."""
        if fault.kind == "lag":
            self._lag_ms = 0.0
            self._back = set(range(len(self._off)))
        elif fault.kind == "stuck_axis" and fault.axis in self._axes:
            index = self._axes.index(fault.axis)
            self._stuck.pop(index, None)
            self._back.add(index)
        self._drifts = [d for d in self._drifts if d.fault is not fault]

    def is_stuck(self, index: int) -> bool:
        """Whether an axis is stuck."""
        return index in self._stuck

    def off(self, index: int) -> float:
        """Return the deviation of an axis from its reference, counts."""
        return self._off[index]

    def mark(self, index: int) -> None:
        """Set the reference of an axis that has found its mark to 0 there."""
        self._off[index] = 0.0
        if self._last is not None:
            self._last = tuple(0 if i == index else r for i, r in enumerate(self._last))

    def forget(self) -> None:
        """Apply a power cycle: every axis reads 0 where it is; a stuck axis stays stuck."""
        self._off = [0.0] * len(self._off)
        self._stuck = dict.fromkeys(self._stuck, 0.0)
        self._last = (0,) * len(self._off)

    def apply(self, reference: tuple[int, ...]) -> tuple[int, ...]:
        """Return the actual counts at a reference."""
        if not self.active:
            return reference
        return tuple(r + round(o) for r, o in zip(reference, self._off, strict=True))

    def run(self, reference: tuple[int, ...], ms: float) -> None:
        """Let `ms` pass, at the end of which the reference is `reference`."""
        if not self.active:
            return
        last = self._last or reference
        keep = math.exp(-ms / self._lag_ms) if self._lag_ms > 0.0 else 1.0
        for i in range(len(self._off)):
            if i in self._stuck:
                self._off[i] = self._stuck[i] - reference[i]
            elif self._lag_ms > 0.0:
                self._off[i] = (self._off[i] + last[i] - reference[i]) * keep
            elif i in self._back:
                self._off[i] = math.copysign(max(abs(self._off[i]) - _CATCH_UP * ms, 0.0), self._off[i])
        for drift in self._drifts:
            step = drift.fault.counts_per_s * ms / 1e3
            room = drift.fault.most_counts - abs(drift.share)
            step = math.copysign(min(abs(step), max(room, 0.0)), step)
            drift.share += step
            if drift.index not in self._stuck:
                self._off[drift.index] += step
        self._last = reference
