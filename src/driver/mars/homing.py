"""Homing: every axis to its mark, in the unit's groups, and proof that each was really there."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from driver.line.link import Link
from driver.line.protocol import encode
from driver.mars.ready import wait_ready
from driver.mars.stopping import STILL_COUNTS, read_position

HOMING_TOLERANCE = 2000  # counts from 0 after homing that still pass for the mark
HOMING_S = 120.0  # of one group


def home_all(link: Link, unit: Unit, settled: Callable[[], tuple[int, ...]]) -> None:
    """Home all axes, one group after the other.

    Args:
        settled: waits until the arm stands, and gives its counts.

    Raises:
        ExecutionStopped: an axis is not at its mark afterwards (reason ``homing``), also one that left it again while
            others were homed, or it takes longer than HOMING_S.
    """
    for group in unit.homing:
        unmoved = _home_axes(link, unit, group)
        if unmoved:  # at its mark before, or its line was lost: to tell, home it once more
            _home_axes(link, unit, unmoved)
    _require_at_marks(unit, [axis for group in unit.homing for axis in group], settled())


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
    if not _at_marks(unit, group, seen[-1]):
        look()  # one answer may be damaged on the line
    _require_at_marks(unit, group, seen[-1])
    places = {axis: unit.axes.index(axis) for axis in group}
    return tuple(
        axis
        for axis, i in places.items()
        if all(abs(counts[i] - seen[0][i]) <= STILL_COUNTS for counts in seen)
    )


def _at_marks(unit: Unit, axes: Sequence[str], counts: tuple[int, ...]) -> bool:
    return all(abs(counts[unit.axes.index(axis)]) <= HOMING_TOLERANCE for axis in axes)


def _require_at_marks(unit: Unit, axes: Sequence[str], counts: tuple[int, ...]) -> None:
    for axis in axes:
        found = counts[unit.axes.index(axis)]
        if abs(found) > HOMING_TOLERANCE:
            raise ExecutionStopped(
                f"axis {axis} reads {found} counts at its mark, expected 0",
                axis=axis,
                counts=list(counts),
                reason="homing",
            )
