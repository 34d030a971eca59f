"""Boards seen where none can stand, as a wrong camera pose shows them: outside the zone, or at no stand's tilt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.poses import BoardPose, TiltHypothesis
from arm.se3 import Array, apply, frozen, rot_z, transform
from cell.files.task import read_task
from cell.scene.board_doubts import board_doubts, outside_zone
from tasks.true_look import true_look
from vision.observation import Observation

TASK = read_task(data_file("scenes/task2.toml"))
SEEN = true_look(TASK)


def _moved(by: Array) -> Observation:
    def pose(of: BoardPose) -> BoardPose:
        return replace(of, T_base_board=frozen(mul(by, of.T_base_board)))

    return replace(SEEN, boards=tuple(replace(b, pose=pose(b.pose)) for b in SEEN.boards))


def test_boards_where_they_may_stand_raise_no_doubt() -> None:
    assert board_doubts(TASK.cell, SEEN) == ""
    assert [outside_zone(TASK.cell, pose) for pose in SEEN.poses] == [0.0, 0.0]


@pytest.mark.parametrize("seed", range(5))
def test_outside_is_how_far_a_corner_of_the_plate_has_left_the_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shift = rng.normal(0.0, 0.3, 3)
    for pose in _moved(transform(t=shift)).poses:
        centre, size = TASK.cell.zone.T_base_body[:3, 3], np.array([0.44, 0.54, 0.216])
        (x, y), (w, d) = pose.board.plate.centre[:2], pose.board.plate.size[:2]
        corners = [[x + i * w / 2, y + j * d / 2, 0.0] for i in (-1, 1) for j in (-1, 1)]
        top = apply(pose.T_base_board, corners)
        inside = np.clip(top, centre - size / 2, centre + size / 2)
        assert outside_zone(TASK.cell, pose) == pytest.approx(np.abs(top - inside).max(), abs=1e-12)


def test_a_camera_that_is_turned_about_its_line_of_sight_is_suspected() -> None:
    at = TASK.cell.camera.T_base_camera[:3, 3] * (1.0, 1.0, 0.0)
    quarter = mul(mul(transform(t=at), transform(rot_z(np.pi / 2))), transform(t=-at))
    told = board_doubts(TASK.cell, _moved(quarter))
    assert "outside the zone for boards (boards.zone_centre_mm, boards.zone_size_mm): " in told
    assert "03-04 by " in told
    assert "measure a hole by tape" in told
    assert "the pose in lab.toml is wrong" in told


def test_a_tilt_that_no_stand_has_is_told_and_one_that_fits_is_not() -> None:
    tilts = [TiltHypothesis(np.radians(7), 0.2, 0.99, True), TiltHypothesis(np.radians(15), -3.8, 0.0, False)]
    boards = tuple(
        replace(b, pose=replace(b.pose, tilt_hypothesis=tilt))
        for b, tilt in zip(SEEN.boards, tilts, strict=True)
    )
    told = board_doubts(TASK.cell, replace(SEEN, boards=boards))
    assert "tilted as no stand is (boards.tilts_deg): 03-04 by 15.0 deg; " in told
