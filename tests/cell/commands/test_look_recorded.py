"""Poses of boards from recorded corners."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import angle_between, inverse
from cell.commands.look_recorded import detections_step
from cell.console import Console
from recorded.marker_files import BOARD, CAMERA, POSES, recorded, written


def test_poses_are_those_of_the_scenes_in_the_cameras_frame(tmp_path: Path) -> None:
    told = detections_step(written(tmp_path, recorded()), None, tmp_path / "out.json", Console(True))
    assert json.loads((tmp_path / "out.json").read_text()) == json.loads(json.dumps(told))
    for T, scene in zip(POSES, told["scenes"], strict=True):
        (board,) = scene["boards"]
        assert (board["verdict"], board["reasons"]) == ("accepted", [])
        assert board["T_base_board"] == board["T_camera_board"]
        found, true = np.array(board["T_camera_board"]), CAMERA.T_camera_base @ T
        assert np.abs(found[:3, 3] - true[:3, 3]).max() < 1e-3
        assert angle_between(found[:3, :3], true[:3, :3]) < np.radians(0.5)
        assert len(board["holes"]) == 4
        hole = found @ BOARD.T_board_hole(2)
        assert np.allclose(board["holes"][2]["T_base_hole"], hole)


def test_what_else_stands_in_the_file_changes_nothing(tmp_path: Path) -> None:
    content = recorded()
    told = detections_step(written(tmp_path, content), None, None, Console(True))
    del content["noise"], content["kind"]
    for scene in content["scenes"]:
        del scene["truth"]
    assert detections_step(written(tmp_path, content), None, None, Console(True)) == told


def test_with_a_task_poses_are_in_the_base_frame_of_its_cell(tmp_path: Path, scenes: Path) -> None:
    told = detections_step(written(tmp_path, recorded(0.0)), scenes / "task2.toml", None, Console(True))
    for T, scene in zip(POSES, told["scenes"], strict=True):
        found = np.array(scene["boards"][0]["T_base_board"])
        assert np.abs(inverse(T) @ found - np.eye(4)).max() < 1e-6


def test_scenes_that_must_not_be_used_say_why_and_the_others_are_judged(tmp_path: Path) -> None:
    content = recorded()
    for markers in (f["markers"] for f in content["scenes"][0]["frames"]):
        markers[0]["id"], markers[1]["id"] = markers[1]["id"], markers[0]["id"]
    for frame in content["scenes"][1]["frames"]:
        del frame["markers"][1]
    told = detections_step(written(tmp_path, content), None, None, Console(True))
    swapped, hidden, good = (scene["boards"][0] for scene in told["scenes"])
    assert swapped["verdict"] == hidden["verdict"] == "refused"
    assert "are swapped" in swapped["reasons"][0]
    assert "marker 2 is in none of 5 images" in hidden["reasons"][0]
    assert hidden["T_camera_board"] is None
    assert good["verdict"] == "accepted"


def test_a_board_that_moved_and_a_marker_of_another_board_are_told(tmp_path: Path) -> None:
    content = recorded()
    content["scenes"][0]["frames"][3] = content["scenes"][1]["frames"][3]
    for frame in content["scenes"][1]["frames"]:
        corners = np.array(frame["markers"][1]["corners_px"])
        frame["markers"][1]["corners_px"] = (corners + (60.0, -30.0)).tolist()
    told = detections_step(written(tmp_path, content), None, None, Console(True))
    moved, other, good = (scene["boards"][0] for scene in told["scenes"])
    assert moved["verdict"] == other["verdict"] == "refused"
    assert "image 4 of 5 shows it" in moved["reasons"][0]
    assert "marker 2 is at" in other["reasons"][0]
    assert "it belongs to another board, or was glued elsewhere" in other["reasons"][0]
    assert good["verdict"] == "accepted"


def test_what_is_read_is_not_written_over(tmp_path: Path) -> None:
    file = written(tmp_path, recorded())
    with pytest.raises(InputError, match="is read by this command"):
        detections_step(file, None, file, Console(True))
