"""Which holes a task uses, and where the tool is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.io.storage import data_file
from arm.se3 import inverse
from cell.files.task import read_task
from cell.scene.build import RELEASE_GAP
from cell.scene.places import hole_stations, out_of_view, reach_of, unused_holes
from tasks.true_look import true_look
from typed.command_line import replace_in

TASK = read_task(data_file("scenes/task2.toml"))


def test_holes_that_the_task_leaves_out_are_no_stations() -> None:
    task = replace(TASK, to_holes=(1, 3))
    assert unused_holes(task) == {"03-04/2", "03-04/4"}
    names = [station.name for station in hole_stations(task, true_look(TASK))]
    assert names == ["01-02/1", "01-02/2", "01-02/3", "01-02/4", "03-04/1", "03-04/3"]
    assert unused_holes(TASK) == set()


def test_cubes_are_gripped_in_their_seats_and_released_above_them() -> None:
    seen = true_look(TASK)
    heights = {
        station.name[:5]: float((inverse(hole.T_base_hole) @ station.T_base_tool[0])[2, 3])
        for board in seen.boards
        for hole in board.pose.holes
        for station in hole_stations(TASK, seen)
        if station.name == hole.name
    }
    grip = TASK.cell.grip_height
    assert np.allclose([heights["01-02"], heights["03-04"]], [grip, grip + RELEASE_GAP])


def test_reach_is_of_every_hole_that_the_task_uses() -> None:
    table = reach_of(replace(TASK, to_holes=(2,)), true_look(TASK))
    assert len(table.holes) == 5
    assert all(hole.ok for hole in table.holes)


def test_places_that_the_camera_does_not_see_are_told(scenes: Path) -> None:
    file = scenes / "task1.toml"
    assert out_of_view(read_task(file)) == out_of_view(TASK) == ""
    replace_in(file, "origin_mm = [320, -215]", "origin_mm = [-215, 320]")
    told = "task1.toml: places.origin_mm: 0 of 8 places are in the camera's view, so looks cannot confirm the cubes"
    assert out_of_view(read_task(file)).startswith(told)
    replace_in(file, 'look_after = "each"', 'look_after = "never"')
    assert out_of_view(read_task(file)) == ""
