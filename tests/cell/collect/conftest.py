"""Fixtures of several tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.io.storage import data_file
from cell.collect.pose_pool import HandView
from cell.collect.record import HandRecord
from cell.config.cell_file import read_cell
from cell.files.hand_target import read_hand_target
from cell.scene.build import unseen_scene
from tasks.collecting import taken

HAND = data_file("scenes/targets/hand.toml")


@pytest.fixture(scope="module")
def shown() -> HandView:
    cell, hand = read_cell(data_file("scenes/cell.toml")), read_hand_target(HAND)
    return HandView(
        hand.carried_by(cell.robot()),
        unseen_scene(cell).bodies,
        cell.limits,
        cell.camera,
        hand,
        cell.clearance,
    )


@pytest.fixture
def small(tmp_path: Path) -> HandRecord:
    """A recording of eight poses that nobody has looked at."""
    record = HandRecord(
        tmp_path / "recorded.json",
        read_cell(data_file("scenes/uncalibrated/cell.toml")),
        read_hand_target(HAND),
    )
    for number in range(8):
        record.add(*taken(record, number))
    return record
