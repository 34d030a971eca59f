"""Joint limits in counts. The real unit does not enforce them; the emulated one reports violations."""

from __future__ import annotations

from arm.controller.unit import Unit


class LimitWatch:
    """Reports an axis once each time that it leaves its limits.

    Args:
        unit: its joint limits are rounded outwards to counts; those of C to F are reversed.
    """

    def __init__(self, unit: Unit) -> None:
        lower, upper = unit.counts(unit.lower), unit.counts(unit.upper)
        self._limits = [
            (axis, int(min(a, b)) - 1, int(max(a, b)) + 1)
            for axis, a, b in zip(unit.axes, lower, upper, strict=True)
        ]
        self._outside: set[str] = set()

    def newly_outside(self, counts: tuple[int, ...]) -> list[tuple[str, int, int, int]]:
        """Return the axes that have left their limits since the last call: letter, counts, lowest, highest allowed."""
        found = []
        for value, (axis, low, high) in zip(counts, self._limits, strict=True):
            if low <= value <= high:
                self._outside.discard(axis)
            elif axis not in self._outside:
                self._outside.add(axis)
                found.append((axis, value, low, high))
        return found
