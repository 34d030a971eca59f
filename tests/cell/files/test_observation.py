"""Look files: a round trip loses nothing, damage is told, boards that moved are told by how much."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.board import Board
from arm.errors import FileInputError, ImpossibleError
from arm.io.storage import canonical_json, data_file
from arm.poses import BoardPose
from arm.se3 import frozen, inverse, rot_z, rotation, transform
from cell.files.board_shift import moved_boards
from cell.files.observation import observation_to_json, read_observation, require_boards
from cell.files.task import Task, read_task
from cell.files.world import board_placement
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import Occupancy

OCCUPANCY = (
    Occupancy("cube"),
    Occupancy("empty"),
    Occupancy("unsure", reason="something is across it"),
    Occupancy("cube"),
)


@pytest.fixture(scope="module")
def task() -> Task:
    return read_task(data_file("scenes/task2.toml"))


def _seen_board(board: Board, T_base_board: np.ndarray) -> ObservedBoard:
    root = np.random.default_rng(3).normal(size=(6, 6))
    pose = BoardPose(board, frozen(T_base_board), frozen(1e-8 * root @ root.T), 0.05, 21.0)
    if board.name == "01-02":
        pose = replace(pose, repeatability=frozen(1e-9 * root @ root.T))
    return ObservedBoard(pose, OCCUPANCY)


def _seen(task: Task) -> Observation:
    poses = (
        board_placement((0.46, 0.11, 0.04), 3.0, 0.12, 4.6),
        board_placement((0.46, -0.13, 0.09), 1.6, 0.26, 4.7),
    )
    return Observation(
        tuple(_seen_board(b, T) for b, T in zip(task.boards, poses, strict=True)), {"05-06": "not in view"}
    )


def test_round_trip(task: Task, tmp_path: Path) -> None:
    path, seen = tmp_path / "look.json", _seen(task)
    path.write_text(canonical_json(observation_to_json(seen, task.cell.camera)))
    again = read_observation(path, task.cell)
    assert again.missing == seen.missing
    for a, b in zip(again.boards, seen.boards, strict=True):
        assert a.occupancy == b.occupancy
        assert a.pose.board == b.pose.board
        assert a.pose.T_base_board == pytest.approx(b.pose.T_base_board, abs=1e-12)
        assert a.pose.covariance == pytest.approx(b.pose.covariance, abs=1e-20)
        assert (a.pose.repeatability is None) == (b.pose.repeatability is None) == (b.name != "01-02")
        if b.pose.repeatability is not None:
            assert a.pose.repeatability == pytest.approx(b.pose.repeatability, abs=1e-20)


def test_the_json_speaks_of_camera_and_base(task: Task) -> None:
    camera = task.cell.camera
    for entry in observation_to_json(_seen(task), camera)["scenes"][0]["boards"]:
        product = camera.T_base_camera @ np.array(entry["T_camera_board"])
        assert product == pytest.approx(np.array(entry["T_base_board"]), abs=1e-12)
        assert len(entry["holes"]) == 4
        assert [h.get("reason") for h in entry["holes"]] == [None, None, "something is across it", None]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: b.update(marker_ids=[1, 99]), r"marker_ids = \[1, 99\]: is not a board of the cell file"),
        (lambda b: b.update(T_base_board=np.zeros((4, 4)).tolist()), "01-02.T_base_board"),
        (lambda b: b["holes"][0].update(state="full"), "'full': must be one of cube, empty, unsure"),
        (
            lambda b: b["holes"].pop(),
            "must be 4, each one of cube, empty.*has 4 holes: is this a look at another",
        ),
        (lambda b: b.update(covariance=[[1.0]]), "01-02.covariance.*must be 6 rows of 6 finite numbers"),
        (
            lambda b: b.update(repeatability=[[1.0]]),
            "01-02.repeatability.*must be 6 rows of 6 finite numbers",
        ),
        (lambda b: b.update(covariance=np.full((6, 6), 1e400).tolist()), "finite"),
        *(
            (
                lambda b, k=key, C=C: b.update({k: C.tolist()}),
                f"01-02.{key}: must be a covariance: 6 rows of 6",
            )
            for key in ("covariance", "repeatability")
            for C in (-1e-6 * np.eye(6), 1e-8 * (np.eye(6) + 0.1 * np.eye(6, k=1)))
        ),
        (
            lambda b: b.update(repeatability=(101.0 * np.array(b["covariance"])).tolist()),
            "01-02.repeatability: must not exceed 2 times the board's covariance in any direction",
        ),
        (lambda b: b.update(verdict="refused"), "verdict = 'refused': must be one of accepted"),
        (lambda b: b["holes"].reverse(), "in the order of the board's file"),
        (
            lambda b: b.pop("residual_px"),
            "look.json: 01-02.residual_px: is missing .a465 look writes this file",
        ),
        (lambda b: b.update(residual_px="low"), "look again"),
    ],
)
def test_damage_is_told(
    task: Task, tmp_path: Path, change: Callable[[dict[str, Any]], Any], message: str
) -> None:
    value = json.loads(canonical_json(observation_to_json(_seen(task), task.cell.camera)))
    change(value["scenes"][0]["boards"][0])
    path = tmp_path / "look.json"
    path.write_text(json.dumps(value))
    with pytest.raises(FileInputError, match=message):
        read_observation(path, task.cell)


@pytest.mark.parametrize(
    ("by", "turn", "shift", "told"),
    [
        (0.030, 0.0, None, "they differ by 30.00 mm and 0.000 deg"),
        (0.0, 0.2, None, "they differ by 0.00 mm and 0.200 deg"),
        (0.04e-3, 0.004, None, ""),
        (0.0, 0.2, {"moved_mm": 4.0, "rotation_deg": [0.2, 0.0, 0.0]}, ""),  # the look was corrected for it
        (0.004, 0.0, {"moved_mm": 4.0, "rotation_deg": [0.2, 0.0, 0.0]}, ""),
        (0.0, 0.3, {"moved_mm": 4.0, "rotation_deg": [0.2, 0.0, 0.0]}, "0.00 mm and 0.300 deg"),
        (0.030, 0.0, "none", ""),  # a look of another program, without the camera's frame
    ],
)
def test_a_look_from_before_the_camera_moved_is_told(
    task: Task, tmp_path: Path, by: float, turn: float, shift: Any, told: str
) -> None:
    before = task.cell.camera.T_base_camera @ transform(rotation((np.radians(turn), 0, 0)), (by, 0, 0))
    value = observation_to_json(_seen(task), task.cell.camera.at(before))
    (scene,) = value["scenes"]
    if shift == "none":
        for board in scene["boards"]:
            del board["T_camera_board"]
    elif shift is not None:
        scene["camera"] = shift
    path = tmp_path / "look.json"
    path.write_text(json.dumps(value))
    if told:
        with pytest.raises(FileInputError, match=rf"look\.json: was made with another .*{told} .look again"):
            read_observation(path, task.cell)
    else:
        assert len(read_observation(path, task.cell).boards) == 2


def test_a_look_through_another_lens_is_told(task: Task, tmp_path: Path) -> None:
    camera, path = task.cell.camera, tmp_path / "look.json"
    value = observation_to_json(_seen(task), replace(camera, K=camera.K + np.diag([1e-3, 0.0, 0.0])))
    path.write_text(json.dumps(value))
    with pytest.raises(
        FileInputError, match=r"look.json: was made with other intrinsics than .*lab.toml has now"
    ):
        read_observation(path, task.cell)
    del value["scenes"][0]["lens"]  # of before it was kept, or of another program
    path.write_text(json.dumps(value))
    assert len(read_observation(path, task.cell).boards) == 2


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            lambda b: replace(b, marker_size=1.01 * b.marker_size),
            "01-02.marker_size_mm = 36.0: must be 36.36, which the cell has for board 01-02 now: the poses of this "
            "look rest on it (look again)",
        ),
        (
            lambda b: replace(b, second_marker=(0.141, 0.14)),
            "01-02.second_marker_mm = [180.0, 140.0]: must be [141, 140], where the cell has the second marker of "
            "board 01-02 now (look again)",
        ),
        (lambda b: replace(b, marker_size=b.marker_size * (1.0 + 1e-9)), ""),
    ],
)
@pytest.mark.parametrize("former", [False, True])
def test_a_look_at_markers_of_another_size_is_told(
    task: Task, tmp_path: Path, change: Callable[[Board], Board], told: str, former: bool
) -> None:
    """A look from before the sizes were kept is read as before."""
    value = observation_to_json(_seen(task), task.cell.camera)
    for board in value["scenes"][0]["boards"] if former else ():
        del board["marker_size_mm"], board["second_marker_mm"]
    path = tmp_path / "look.json"
    path.write_text(json.dumps(value))
    cell = replace(task.cell, boards=tuple(map(change, task.cell.boards)))
    if told and not former:
        with pytest.raises(FileInputError, match=re.escape(told)):
            read_observation(path, cell)
    else:
        assert len(read_observation(path, cell).boards) == 2


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"scenes": []}', '{"scenes": [{"boards": 3}]}', "{"])
def test_what_is_no_look_is_told(task: Task, tmp_path: Path, text: str) -> None:
    path = tmp_path / "look.json"
    path.write_text(text)
    with pytest.raises(FileInputError) as refused:
        read_observation(path, task.cell)
    assert "Error" not in str(refused.value)
    assert "object" not in str(refused.value)


def test_boards_that_moved_are_told_by_their_farthest_point(task: Task) -> None:
    before = _seen(task)
    first, second = before.boards
    nudged = _seen_board(second.pose.board, transform(t=(0.003, 0, 0)) @ second.pose.T_base_board)
    assert moved_boards(before, before, task) == []
    (line,) = moved_boards(before, Observation((first, nudged)), task)
    assert "board 03-04 moved by 3.0 mm" in line
    centre = transform(t=(0.09, 0.07, 0.0))
    turned = first.pose.T_base_board @ centre @ transform(rot_z(np.radians(1.5))) @ inverse(centre)
    (line,) = moved_boards(before, Observation((_seen_board(first.pose.board, turned), second)), task)
    assert "moved by 4.1 mm and 1.50 deg" in line  # 0.156 m from centre to corner


def test_task_1_wants_its_board_flat_and_as_high_as_stated() -> None:
    task = read_task(data_file("scenes/task1.toml"))
    good = board_placement((0.47, 0.0, 0.06), 1.6, 0.0, 0.0)
    require_boards(Observation((_seen_board(task.from_board, good),)), task)
    high = transform(t=(0, 0, 0.02)) @ good
    tilted = good @ transform(rotation((np.radians(4.0), 0, 0)))
    for bad in (high, tilted):
        with pytest.raises(ImpossibleError, match="but the task says 60 mm and flat"):
            require_boards(Observation((_seen_board(task.from_board, bad),)), task)


def test_a_missing_board_is_told_with_why(task: Task) -> None:
    seen = Observation(_seen(task).boards[:1], {"03-04": "marker 4 is hidden"})
    with pytest.raises(ImpossibleError, match=r"^board 03-04 was not found: marker 4 is hidden; move it"):
        require_boards(seen, task)
    why = (
        "4 markers of DICT_4X4_50 (ids 1 to 4) are: are the boards of these? boards.dictionary is DICT_5X5_50"
    )
    target = Observation(
        seen.boards, {"03-04": "a board: is this the target? boards have it (boards.dictionary)"}
    )
    with pytest.raises(ImpossibleError, match=r"\(boards.dictionary\); give images of the boards$"):
        require_boards(target, task)
    with pytest.raises(ImpossibleError, match=r"DICT_5X5_50; make file and print agree$"):
        require_boards(replace(seen, missing={"03-04": why}), task)
    told = r"^l1\.json: board 03-04 was not found: marker 4 .* and look again; this look has board 01-02$"
    with pytest.raises(ImpossibleError, match=told):
        require_boards(seen, task, Path("l1.json"))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda s: s["scenes"].append(s["scenes"][0]), r"look.json: scenes: has 2 scenes; must have one"),
        (lambda s: s["scenes"][0]["boards"].append(s["scenes"][0]["boards"][0]), r"boards: has board 01-02 a second"),
        (
            lambda s: s["scenes"][0]["boards"][0]["T_base_board"][0].__setitem__(3, 457.0),
            r"T_base_board = \[457.0, .*: is a position in m; must be within 10 m of the base .is it in mm\?",
        ),
    ],
)  # fmt: skip
def test_a_look_that_was_edited_by_hand_is_told(task: Task, tmp_path: Path, change: Any, told: str) -> None:
    path = tmp_path / "look.json"
    value = observation_to_json(_seen(task), task.cell.camera)
    change(value)
    path.write_text(canonical_json(value))
    with pytest.raises(FileInputError, match=told):
        read_observation(path, task.cell)
