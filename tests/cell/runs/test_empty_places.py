"""Which look may tell what is beside a cube: one whose photographs surely show its place empty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from cell.cubes.confirm_placed import _empty
from cell.files.task import Task, read_task
from cell.preview.overlays import board_to_json
from tasks.true_look import true_look
from vision.observation import Observation


@pytest.fixture(scope="module")
def task() -> Task:
    return read_task(data_file("scenes/task2.toml"))


def _photographed(task: Task) -> Observation:
    image = np.zeros(task.cell.camera.size[::-1], dtype=np.uint8)
    return replace(true_look(task), images=(image,))


def test_only_a_place_that_the_photographs_show_empty_is_a_background(task: Task) -> None:
    seen = _photographed(task)
    assert seen.state("03-04/2") == "empty"
    empty = _empty(task, seen, "03-04/2")
    assert empty is not None
    assert empty.images is seen.images
    assert seen.state("01-02/1") == "cube"
    assert _empty(task, seen, "01-02/1") is None
    assert _empty(task, seen, "11-12/1") is None  # a board that was not found
    assert _empty(task, replace(seen, images=()), "03-04/2") is None


def test_a_cube_that_left_after_the_photographs_is_still_in_them(task: Task) -> None:
    after = _photographed(task).with_moves({"cube 01-02/1": "03-04/2"})
    assert after.state("01-02/1") == "empty"
    assert _empty(task, after, "01-02/1") is None
    assert _empty(task, after, "03-04/2") is None  # it has the cube by now, and is no place to put another
    assert _empty(task, after, "03-04/3") is not None


def test_the_page_draws_the_pockets_of_the_cell_file(task: Task) -> None:
    board = replace(task.cell.boards[0], pocket=(0.0435, 0.0385))
    pocket = board_to_json(board, np.eye(4), task.cell.dictionary)["pocket"]
    assert (pocket["mouth"], pocket["floor"], pocket["depth"]) == (0.0435, 0.0385, 0.010)
