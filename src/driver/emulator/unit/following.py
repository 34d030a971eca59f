"""How the axes follow their reference: exactly, unless one is stuck, creeps away, or all lag behind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from driver.emulator.faults.model import Fault

_CATCH_UP = 10.0  # counts/ms with which an axis that was stuck returns to its reference


@dataclass
class _Drift:
    fault: Fault
    index: int
    share: float = 0.0  # counts so far


class Following:
    """Deviation of the actual position from the reference, counts of the unit, axis by axis.

    Args:
        axes: letters, in the arm's order.

    Attributes:
        active: some axis is, or may come, off its reference.
    """

    def __init__(self, axes: Sequence[str]) -> None:
        self._axes = tuple(axes)
        self._off = [0.0] * len(axes)
        self._stuck: dict[int, float] = {}  # axis index -> where it stays
        self._back: set[int] = set()
        self._drifts: list[_Drift] = []
        self._lag_ms = 0.0
        self._last: tuple[int, ...] | None = None
        self.active = False

    def begin(self, fault: Fault, reference: tuple[int, ...]) -> None:
        """A `stuck_axis`, `drift` or `lag` begins; one of an axis that the arm has not does nothing."""
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
        """It is over. What was stuck catches up; what crept away stays away."""
        if fault.kind == "lag":
            self._lag_ms = 0.0
            self._back = set(range(len(self._off)))
        elif fault.kind == "stuck_axis" and fault.axis in self._axes:
            index = self._axes.index(fault.axis)
            self._stuck.pop(index, None)
            self._back.add(index)
        self._drifts = [d for d in self._drifts if d.fault is not fault]

    def is_stuck(self, index: int) -> bool:
        """Whether that axis does not move."""
        return index in self._stuck

    def off(self, index: int) -> float:
        """How far that axis is from its reference."""
        return self._off[index]

    def mark(self, index: int) -> None:
        """The axis has found its mark, where it is: its reference is 0 there."""
        self._off[index] = 0.0
        if self._last is not None:
            self._last = tuple(0 if i == index else r for i, r in enumerate(self._last))

    def forget(self) -> None:
        """The unit was switched off and on: every axis reads 0 where it is; what is stuck stays stuck."""
        self._off = [0.0] * len(self._off)
        self._stuck = dict.fromkeys(self._stuck, 0.0)
        self._last = (0,) * len(self._off)

    def apply(self, reference: tuple[int, ...]) -> tuple[int, ...]:
        """Actual counts at a reference."""
        if not self.active:
            return reference
        return tuple(r + round(o) for r, o in zip(reference, self._off, strict=True))

    def run(self, reference: tuple[int, ...], ms: float) -> None:
        """Time passes; the reference is now there."""
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
            way = drift.fault.counts_per_s * ms / 1e3
            room = drift.fault.most_counts - abs(drift.share)
            way = math.copysign(min(abs(way), max(room, 0.0)), way)
            drift.share += way
            if drift.index not in self._stuck:
                self._off[drift.index] += way
        self._last = reference
