"""Joint limits in counts, which the unit does not enforce but the emulated one watches."""

from __future__ import annotations

from arm.controller.unit import Unit


class LimitWatch:
    """Tells when an axis leaves its limits, once each time.

    Args:
        unit: whose joint limits, rounded outwards to counts; C to F run backwards.
    """

    def __init__(self, unit: Unit) -> None:
        lower, upper = unit.counts(unit.lower), unit.counts(unit.upper)
        self._limits = [
            (axis, int(min(a, b)) - 1, int(max(a, b)) + 1)
            for axis, a, b in zip(unit.axes, lower, upper, strict=True)
        ]
        self._outside: set[str] = set()

    def newly_outside(self, counts: tuple[int, ...]) -> list[tuple[str, int, int, int]]:
        """Axes that were inside when last asked: letter, counts, lowest and highest allowed."""
        found = []
        for value, (axis, low, high) in zip(counts, self._limits, strict=True):
            if low <= value <= high:
                self._outside.discard(axis)
            elif axis not in self._outside:
                self._outside.add(axis)
                found.append((axis, value, low, high))
        return found
