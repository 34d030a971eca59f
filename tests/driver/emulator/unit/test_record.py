"""What the emulated unit remembers of where it was."""

from __future__ import annotations

from array import array

import numpy as np

from driver.emulator.unit.record import Recorder


def test_a_record_keeps_the_newest_in_step() -> None:
    recorder = Recorder(2, keep=100)
    for ms in range(1000):
        recorder.add(ms, (ms, -ms))
    record = recorder.record()
    assert 100 <= len(record.time_ms) <= 113
    assert record.time_ms[-1] == 999
    assert np.array_equal(record.counts[:, 0], record.time_ms)
    assert np.array_equal(record.counts[:, 1], -record.time_ms)
    everything = Recorder(2)
    for ms in range(1000):
        everything.add(ms, (ms, 2**40))
    assert len(everything) == 1000
    assert everything.record().counts[5].tolist() == [5, 2**31 - 1]
    assert array("i").itemsize == 4


def test_a_record_may_begin_after_a_time() -> None:
    recorder = Recorder(1)
    for ms in (3, 4, 9, 10):
        recorder.add(ms, (10 * ms,))
    assert recorder.record(4).time_ms.tolist() == [9, 10]
    assert recorder.record(5).counts.tolist() == [[90], [100]]
    assert not len(recorder.record(10).time_ms)
    assert recorder.record().time_ms.tolist() == [3, 4, 9, 10]


def test_the_last_motion_of_every_axis_is_found_however_long_ago() -> None:
    recorder = Recorder(3)
    assert recorder.last_motion() == (0, (0, 0, 0))
    at = [0, 0, 0]
    for ms in range(1, 12001):
        at[0] += 1 if ms < 9000 else 0
        at[1] += {3: -1, 7905: 1}.get(ms, 0)  # samples 7904 and 7905 of 12000 are in different chunks of 4096
        recorder.add(ms, tuple(at))
    assert recorder.last_motion() == (12000, (1, 1, 0))
    recorder.add(12001, (at[0] - 1, at[1], 0))
    assert recorder.last_motion() == (12001, (-1, 1, 0))
