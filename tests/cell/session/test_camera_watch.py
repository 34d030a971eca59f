"""The watch on a cell's camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.board import PLATE_CENTRE
from arm.errors import ImpossibleError, InputError
from arm.se3 import apply
from cell.config.cell_file import read_cell
from cell.files.task import read_task
from cell.session.camera_watch import camera_watch, shift_words, take_background
from cell.session.connection import camera_at_start
from vision.background.features import write_background
from watched.scratched import scratched_table
from watched.specked import specked_world


def test_features_are_beside_boards_and_bound_to_the_calibration(scenes: Path) -> None:
    task = read_task(scenes / "task2.toml")
    cell = task.cell
    assert camera_watch(cell) is None
    background, seen = take_background(cell, camera_at_start(task, specked_world(scenes)).grab(5))
    assert len(seen.boards) == 2
    for board in seen.boards:
        middle = apply(board.pose.T_base_board, np.array([*PLATE_CENTRE, 0.0]))
        off = np.linalg.norm(background.points - cell.camera.project_base(middle), axis=1)
        assert off.min() > 380.0  # px; half a plate is 400 by 480
    write_background(scenes / "background.npz", background)
    text = (scenes / "cell.toml").read_text()
    (scenes / "cell.toml").write_text('background = "background.npz"\n' + text)
    watch = camera_watch(read_cell(scenes / "cell.toml"))
    assert watch is not None
    assert (watch.limit, watch.distance) == (2e-3, pytest.approx(1.195, abs=0.01))
    lab = scenes / "cameras/lab.toml"
    lab.write_text(lab.read_text().replace("0.49209]", "0.49309]"))
    with pytest.raises(InputError, match="taken for another calibration of the camera"):
        camera_watch(read_cell(scenes / "cell.toml"))


def test_no_words_where_nothing_moved() -> None:
    assert shift_words(None) is None


@pytest.mark.slow
def test_a_board_that_is_partly_in_view_is_refused(scenes: Path) -> None:
    task = read_task(scenes / "task2.toml")
    world = specked_world(scenes)
    world.write_text(world.read_text().replace("centre_mm = [460, 110, 40]", "centre_mm = [460, 200, 40]"))
    images = camera_at_start(task, world).grab(5)
    with pytest.raises(ImpossibleError, match="partly in view, so what it covers is unknown"):
        take_background(task.cell, images)


def test_images_of_other_things_make_no_background(scenes: Path) -> None:
    cell = read_task(scenes / "task2.toml").cell
    images = [scratched_table(seed=n, count=150).image(cell.camera, seed=n) for n in range(2)]
    with pytest.raises(ImpossibleError, match="do not show one scene at rest: image 1 of 2 shows"):
        take_background(cell, images)
