"""Homing: every axis to its mark, in the unit's groups, and proof that each was really there."""

from __future__ import annotations

from collections.abc import Sequence

from arm.errors import ExecutionStopped
from arm.unit import Unit
from driver.link import Link
from driver.protocol import encode
from driver.ready import wait_ready
from driver.rest import STILL_COUNTS, read_position

HOMING_TOLERANCE = 2000  # counts from 0 after homing that still pass for the mark
HOMING_S = 120.0  # of one group


def home_all(link: Link, unit: Unit) -> None:
    """Home all axes, one group after the other.

    Raises:
        ExecutionStopped: an axis is not at its mark afterwards (reason ``homing``), or it takes longer than HOMING_S.
    """
    for group in unit.homing:
        unmoved = _home_axes(link, unit, group)
        if unmoved:  # at its mark before, or its line was lost: to tell, home it once more
            _home_axes(link, unit, unmoved)


def _home_axes(link: Link, unit: Unit, group: Sequence[str]) -> tuple[str, ...]:
    """Home some axes together; those whose counts were not seen to change."""

    def look() -> None:
        seen.append(read_position(link, len(unit.axes)).counts)

    seen: list[tuple[int, ...]] = []
    look()
    for axis in group:
        link.send(encode("HH", axis=axis))
    wait_ready(link, f"axes {', '.join(group)}", HOMING_S, on_look=look)
    look()
    unmoved = []
    for axis in group:
        index = unit.axes.index(axis)
        found = seen[-1][index]
        if abs(found) > HOMING_TOLERANCE:
            raise ExecutionStopped(
                f"axis {axis} reads {found} counts at its mark, expected 0",
                axis=axis,
                counts=list(seen[-1]),
                reason="homing",
            )
        if all(abs(counts[index] - seen[0][index]) <= STILL_COUNTS for counts in seen):
            unmoved.append(axis)
    return tuple(unmoved)
