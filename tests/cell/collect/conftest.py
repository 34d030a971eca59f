"""Fixtures of several tests of this folder."""

from __future__ import annotations

import pytest

from arm.io.storage import data_file
from cell.collect.pose_pool import HandView
from cell.config.cell_file import read_cell
from cell.files.hand_target import read_hand_target
from cell.scene.build import unseen_scene

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
