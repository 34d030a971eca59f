"""The recording of a collection: by the unit's own zeros, and never written over."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.collect.record import HandRecord
from cell.config.cell_file import read_cell
from cell.files.hand_target import read_hand_target
from tasks.collecting import taken

HAND = data_file("scenes/targets/hand.toml")

TRUE_OFFSETS = np.radians([0.0, 0.3, -0.3, 0.3, -0.3, 0.0])


def test_readings_are_by_the_units_own_zeros(tmp_path: Path) -> None:
    known = read_cell(data_file("scenes/cell.toml"))
    off = replace(known, unit=known.unit.calibrated(TRUE_OFFSETS))
    record = HandRecord(tmp_path / "recorded.json", off, read_hand_target(HAND))
    q = np.radians([10.0, -20.0, -60.0, 30.0, -40.0, 50.0])
    step = np.radians(0.01)
    assert np.abs(record.from_readings(q) - (q + TRUE_OFFSETS)).max() < step
    assert np.abs(record.to_readings(q) - (q - TRUE_OFFSETS)).max() < step


def test_a_recording_that_somebody_else_changed_is_not_written_over(small: HandRecord) -> None:
    other = HandRecord(small.file, small.cell, small.hand)
    assert len(other) == 8
    other.add(*taken(other, 8))
    changed = small.file.read_bytes()
    with pytest.raises(InputError, match=r"recorded\.json: was changed by another program") as told:
        small.add(*taken(small, 9))
    assert "repeat this command to continue" in str(told.value)
    assert small.file.read_bytes() == changed
    assert len(small) == 8
    other.add(*taken(other, 10))
    assert len(HandRecord(small.file, small.cell, small.hand)) == 10


def test_a_recording_that_came_or_went_meanwhile(small: HandRecord) -> None:
    there = small.file.read_bytes()
    small.file.unlink()
    new = HandRecord(small.file, small.cell, small.hand)
    small.file.write_bytes(there)
    with pytest.raises(InputError, match="was changed by another program"):
        new.add(*taken(new, 9))
    assert small.file.read_bytes() == there
    small.file.unlink()
    small.add(*taken(small, 9))  # nobody's work is lost, and all that was taken is whole again
    assert len(HandRecord(small.file, small.cell, small.hand)) == 9
