"""Poses of a target in the hand: each shows it whole; the recipe's and the pool's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import Array, rot_x, transform
from cell.collect.pose_pool import LIMIT_MARGIN, HandView, hand_pool
from cell.config.cell_file import read_cell
from tasks.collecting import require_shown_whole


@pytest.mark.slow
def test_in_every_pose_of_the_pool_the_target_is_seen_whole(shown: HandView) -> None:
    pool = hand_pool(shown, 8, 3)
    assert len(pool) == 8
    limits = read_cell(data_file("scenes/cell.toml")).limits
    assert (pool >= limits.lower + LIMIT_MARGIN).all()
    assert (pool <= limits.upper - LIMIT_MARGIN).all()
    assert (np.ptp(pool, axis=0) > np.radians(20.0)).all()
    assert all(shown.shows(q) for q in pool)
    for q in pool[:4]:
        require_shown_whole(shown, q)


def test_a_configuration_shows_the_target_only_within_limits_clear_and_facing_the_camera(
    shown: HandView,
) -> None:
    known, q = read_cell(data_file("scenes/cell.toml")), hand_pool(shown, 1, 3)[0]

    def within(lower: Array, upper: Array) -> bool:
        limits = replace(known.limits, lower=lower - LIMIT_MARGIN, upper=upper + LIMIT_MARGIN)
        view = HandView(shown.robot, (), limits, shown.camera, shown.hand, 0.0)
        return view.shows(q)

    assert within(q - 1e-9, q + 1e-9)
    for joint in np.eye(6):
        assert not within(q - 1e-9 + 2e-9 * joint, q + 1e-9)
        assert not within(q - 1e-9, q + 1e-9 - 2e-9 * joint)
    away = replace(shown.hand, T_flange_target=shown.hand.T_flange_target @ transform(rot_x(np.pi)))
    assert not HandView(shown.robot, (), known.limits, shown.camera, away, 0.0).shows(q)
