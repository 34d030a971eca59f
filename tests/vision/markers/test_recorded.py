"""Recorded corners: read as they are, judged scene by scene, and never by what else stands in the file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import FileInputError, InputError
from arm.se3 import angle_between, inverse
from cell.commands.look_recorded import detections_step
from cell.console import Console
from pictures.boards import lab_board, lab_camera, random_pose, seen_corners
from recorded.sets import recorded_set
from vision.markers.recorded import read_detections

CAMERA = lab_camera()
BOARD = lab_board(marker_size=0.040)
POSES = [random_pose(np.random.default_rng(seed), tilt) for seed, tilt in enumerate((0.0, 7.0, 15.0))]


def recorded(noise_px: float = 0.1) -> dict[str, Any]:
    """A file's content, with its truth, in the format of recorded sets."""
    seen = [
        seen_corners(BOARD, T, CAMERA, np.random.default_rng(seed), noise_px=noise_px)
        for seed, T in enumerate(POSES)
    ]
    return recorded_set(BOARD, CAMERA, zip(seen, POSES, strict=True), noise_px)


def written(folder: Path, content: dict[str, Any]) -> Path:
    file = folder / "set.json"
    file.write_text(json.dumps(content))
    return file


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
    assert "marker 2 is in none of 5 photographs" in hidden["reasons"][0]
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
    assert "photograph 4 of 5 shows it" in moved["reasons"][0]
    assert "marker 2 is at" in other["reasons"][0]
    assert "it belongs to another board, or was glued elsewhere" in other["reasons"][0]
    assert good["verdict"] == "accepted"


def _set(*path: str | int, to: Any) -> Callable[[dict[str, Any]], None]:
    def change(content: Any) -> None:
        for key in path[:-1]:
            content = content[key]
        content[path[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_set("camera", to=3), "camera = 3: must be a table"),
        (
            _set("camera", "K_px", to=[[1, 2], [3, 4]]),
            "camera.K_px: must be 3 rows of 3 finite numbers in px",
        ),
        (_set("camera", "K_px", 0, 0, to=-1.0), "camera.K_px: must be [[fx, skew, cx]"),
        (
            _set("camera", "size_px", to=[1920.5, 1200]),
            "camera.size_px = [1920.5, 1200]: must be width and height",
        ),
        (_set("board", "markers", to=[]), "board.markers = []: must have two markers, not 0"),
        (_set("board", "markers", 1, "id", to=1), "board.markers[1].id = 1: must differ"),
        (_set("board", "markers", 0, "corners_m", 0, 0, to=0.5), "must be two squares of one size"),
        (
            _set("board", "holes_m", to=[[0, 0, 0]]),
            "board.holes_m = [[0, 0, 0]]: must be 4 rows of 3 finite numbers",
        ),
        (_set("scenes", to={}), "scenes = {}: must be a list"),
        (_set("scenes", 2, "frames", to=[]), "scenes[2].frames = []: must have at least one photograph"),
        (
            _set("scenes", 1, "frames", 3, "markers", 0, "id", to=1.5),
            "scenes[1].frames[3].markers[0].id = 1.5: must be",
        ),
        (
            _set("scenes", 1, "frames", 3, "markers", 1, "corners_px", 2, to=[1, None]),
            "scenes[1].frames[3].markers[1].corners_px: must be 4 rows of 2 finite numbers",
        ),
    ],
)
def test_what_breaks_the_format_is_told_by_its_key(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    content = recorded()
    change(content)
    with pytest.raises(FileInputError) as refused:
        read_detections(written(tmp_path, content))
    assert words in f"{refused.value.data['key']}: {refused.value.data['rule']}\n{refused.value}"


def test_what_is_read_is_not_written_over(tmp_path: Path) -> None:
    file = written(tmp_path, recorded())
    with pytest.raises(InputError, match="is read by this command"):
        detections_step(file, None, file, Console(True))
