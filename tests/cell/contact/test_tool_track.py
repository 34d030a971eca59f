"""Poses at regular times from a record of counts, the same whenever they are asked for."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from arm.se3 import Array, transform
from cell.contact.tool_track import NODE_MS, ToolTrack
from driver.emulator.unit.record import Record

NONE = np.zeros(6)


def _pose(counts: npt.ArrayLike, errors: Array, now_ms: int) -> Array:
    return transform(t=(float(np.asarray(counts)[0]), float(errors[0]), float(now_ms)))


def _record(*times: int) -> Record:
    """Counts that are the times."""
    return Record(np.array(times, dtype=np.int64), np.tile(np.array(times, dtype=np.int64)[:, None], 6))


def _asked(times: tuple[int, ...], asked_at: tuple[int, ...]) -> list[Array]:
    track, found = ToolTrack(_pose), list[Array]()
    for now in asked_at:
        since = [t for t in times if track.at_ms < t <= now]
        found += track.new_poses(_record(*since), now, None)
    return found


def test_poses_are_those_of_the_last_sample_before_each_node() -> None:
    poses = _asked((12, 13, 14, 27, 28, 29, 30, 31), (60,))
    assert [T[0, 3] for T in poses] == [14, 30, 31, 31, 31]  # at 20 to 60 ms: none before the first motion
    assert poses[2] is poses[3] is poses[4]


@pytest.mark.parametrize("asked_at", [(60,), (13, 29, 30, 60), tuple(range(61)), (25, 25, 60)])
def test_it_does_not_matter_when_they_are_asked_for(asked_at: tuple[int, ...]) -> None:
    times = (12, 13, 14, 27, 28, 29, 30, 31, 58)
    whole = _asked(times, (60,))
    assert [T.tobytes() for T in _asked(times, asked_at)] == [T.tobytes() for T in whole]


def test_errors_change_linearly_until_the_arm_has_arrived() -> None:
    track, error = ToolTrack(_pose), 8.0 * np.ones(6)
    poses = list(track.new_poses(_record(*range(1, 4 * NODE_MS)), 6 * NODE_MS, error))
    assert [T[1, 3] for T in poses] == [2.0, 4.0, 6.0, 8.0, 8.0, 8.0]
    moving = list(track.new_poses(_record(*range(61, 81)), 80, None))
    assert [T[1, 3] for T in moving] == [8.0, 8.0]
    arrived = list(track.new_poses(_record(), 100, NONE))
    assert [T[1, 3] for T in arrived] == [0.0, 0.0]
    assert track.at_ms == 100
