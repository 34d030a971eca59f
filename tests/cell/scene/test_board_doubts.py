"""Boards seen where none can stand, as a wrong camera pose shows them: outside the zone, or at no stand's tilt."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.poses import BoardPose, TiltHypothesis
from arm.robot.shapes import Box
from arm.se3 import Array, apply, frozen, rot_z, transform
from cell.config.cell import Cell
from cell.files.task import read_task
from cell.scene.board_doubts import board_doubts, outside_zone
from tasks.true_look import true_look
from vision.boards.checks import BoardLimits
from vision.boards.pose import assess_board
from vision.camera.model import Camera
from vision.camera.taped_pose import looking_pose
from vision.markers.detect import Marker
from vision.observation import Observation, ObservedBoard

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


@pytest.mark.parametrize("of", ["sign", "quarter"])
def test_an_azimuth_of_another_sign_or_some_quarters_off_is_told(of: str) -> None:
    cell, T = TASK.cell, TASK.cell.camera.T_base_camera
    right = T[:3, 0] - T[2, 0] / T[2, 2] * T[:3, 2]
    azimuth = float(np.arctan2(right[1], right[0]))
    wrong = {"sign": -azimuth, "quarter": azimuth + np.pi / 2.0}[of]
    other = replace(cell, camera=cell.camera.at(looking_pose(T[:3, 3], T[:3, 3] + T[:3, 2], wrong)))
    told = board_doubts(other, _photographed(cell.camera, other, turned=False))
    assert re.search(
        rf"with right_azimuth_deg = .*{np.degrees(azimuth):.1f}.* all fit the zone and the stands", told
    ), told
    assert f"has {np.degrees(wrong):.1f}: is its sign wrong" in told


def test_a_tilt_that_no_stand_has_is_told_and_one_that_fits_is_not() -> None:
    tilts = [TiltHypothesis(np.radians(7), 0.2, 0.99, True), TiltHypothesis(np.radians(15), -3.8, 0.0, False)]
    boards = tuple(
        replace(b, pose=replace(b.pose, tilt_hypothesis=tilt))
        for b, tilt in zip(SEEN.boards, tilts, strict=True)
    )
    told = board_doubts(TASK.cell, replace(SEEN, boards=boards))
    assert "tilted as no stand is (boards.tilts_deg): 03-04 by 15.0 deg; " in told


def _photographed(camera: Camera, cell: Cell, turned: bool) -> Observation:
    """What a look finds in one image by a camera, perhaps turned by 180 deg, that the cell takes for its own."""
    markers = []
    for true in SEEN.poses:
        for id, corners in zip(true.board.marker_ids, true.board.marker_corners(), strict=True):
            px = camera.project_base(apply(true.T_base_board, corners))
            if turned:
                px = np.array(camera.size) - 1.0 - px
            markers.append(Marker(id, frozen(px), "lines", noise=0.01**2 * np.eye(8)))
    limits = BoardLimits()
    assessed = [assess_board(b, [markers], cell.camera, limits, cell.tilts).pose for b in cell.boards]
    boards = [ObservedBoard(pose, ()) for pose in assessed if pose is not None]
    assert len(boards) == 2
    return Observation(tuple(boards), frames=(tuple(markers),))


def test_the_inverse_of_the_cameras_pose_is_told() -> None:
    cell = TASK.cell
    wrong = replace(cell, camera=cell.camera.at(cell.camera.T_camera_base))
    told = board_doubts(wrong, _photographed(cell.camera, wrong, turned=False))
    assert "with the inverse of T_base_camera all fit the zone and the stands: " in told


def test_images_turned_by_half_a_turn_are_told_from_a_wrong_pose() -> None:
    cell, T = TASK.cell, TASK.cell.camera.T_base_camera
    assert board_doubts(cell, _photographed(cell.camera, cell, turned=False)) == ""
    told = board_doubts(cell, _photographed(cell.camera, cell, turned=True))
    assert (
        "; if the images are turned by 180 deg, all fit the zone, the stands and the lens (residual 0.00"
        in told
    )
    assert "take them as those were taken with which lens and pose were calibrated" in told
    other = cell.camera.at(frozen(mul(T, transform(rot_z(np.pi)))))
    told = board_doubts(cell, _photographed(other, cell, turned=False))
    assert "all fit the zone and the stands, and the pose in lab.toml has " in told
    free = replace(cell, tilts=(), zone=replace(cell.zone, shape=Box((3.0, 3.0, 1.0))))
    told = board_doubts(free, _photographed(cell.camera, free, turned=True))
    assert told.startswith("boards were seen with a residual of 0.")
    assert "; if the images are turned by 180 deg, " in told
