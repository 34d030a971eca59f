"""Homing: move every axis to its mark, in the unit's groups, and verify that each axis reached it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from driver.execution.rest import STILL_COUNTS
from driver.line.link import Link
from driver.line.protocol import encode
from driver.mars.ready import wait_ready
from driver.mars.stopping import read_position

HOMING_TOLERANCE = 2000  # counts: largest reading at the mark after homing
HOMING_S = 120.0  # time limit of one group


def home_all(link: Link, unit: Unit, settled: Callable[[], tuple[int, ...]]) -> None:
    """Home all axes, one group after the other.

    Args:
        settled: waits until the arm is at rest and returns its counts.

    Raises:
        ExecutionStopped: an axis is not at its mark after its group, or at the end of all groups (reason ``homing``);
            or a group takes longer than HOMING_S.
    """
    for group in unit.homing:
        unmoved = _home_axes(link, unit, group)
        if unmoved:  # already at the mark, or the command was lost: homing again covers both
            _home_axes(link, unit, unmoved)
    _require_at_marks(unit, [axis for group in unit.homing for axis in group], settled())


def _home_axes(link: Link, unit: Unit, group: Sequence[str]) -> tuple[str, ...]:
    """Home a group of axes together. Return those whose counts did not change."""

    def sample() -> None:
        seen.append(read_position(link, len(unit.axes)).counts)

    seen: list[tuple[int, ...]] = []
    sample()
    for axis in group:
        link.send(encode("HH", axis=axis))
    wait_ready(link, f"axes {', '.join(group)}", HOMING_S, on_poll=sample)
    sample()
    if _off_marks(unit, group, seen[-1]):
        sample()  # one answer may be damaged on the line
    _require_at_marks(unit, group, seen[-1])
    places = {axis: unit.axes.index(axis) for axis in group}
    return tuple(
        axis
        for axis, i in places.items()
        if all(abs(counts[i] - seen[0][i]) <= STILL_COUNTS for counts in seen)
    )


def _off_marks(unit: Unit, axes: Sequence[str], counts: tuple[int, ...]) -> list[str]:
    """Return those of the axes that do not read about 0."""
    return [axis for axis in axes if abs(counts[unit.axes.index(axis)]) > HOMING_TOLERANCE]


def _require_at_marks(unit: Unit, axes: Sequence[str], counts: tuple[int, ...]) -> None:
    for axis in _off_marks(unit, axes, counts):
        why = f"axis {axis} reads {counts[unit.axes.index(axis)]} counts at its mark, must be about 0"
        raise ExecutionStopped(why, axis=axis, counts=list(counts), reason="homing")
