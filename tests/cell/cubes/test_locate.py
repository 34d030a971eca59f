"""What is handed to the search for a cube, place by place."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import transform
from cell.cubes.locate import WITHIN, locate_displaced
from cell.files.task import read_task
from cell.scene.displaced import DisplacedCube
from tasks.true_look import true_look
from vision.loose.locate import LooseCube, NotLocated
from vision.observation import Observation
from vision.occupancy.seated import CubeWidth

TASK = read_task(data_file("scenes/task2.toml"))
IMAGES: Any = (np.zeros((2, 2), np.uint8),)
SEEN = replace(true_look(TASK), images=IMAGES)
CUBE = "cube 01-02/4"


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Arguments of each search; it finds a cube at the second place."""
    made: list[tuple[Any, ...]] = []

    def locate(*arguments: Any) -> LooseCube | NotLocated:
        made.append(arguments)
        here = transform(t=(0.4, 0.0, 0.1))
        return (
            LooseCube(here, np.diag([1, 1, 4, 1, 1, 1]) * 1e-6, 0.1)
            if len(made) == 2
            else NotLocated("nothing shows")
        )

    monkeypatch.setattr("cell.cubes.locate.locate_cube", locate)
    return made


def test_places_are_searched_in_turn_with_what_is_known_around_them(calls: list[tuple[Any, ...]]) -> None:
    width, other = CubeWidth(0.0401, 1e-5), SEEN.boards[1].pose.holes[0].T_base_hole
    known = [DisplacedCube("cube 01-02/1", "03-04/1", other)]
    found = locate_displaced(TASK, SEEN, CUBE, ["03-04/1", "01-02/4"], width, known, SEEN)
    assert isinstance(found, DisplacedCube)
    assert (found.name, found.near, found.height_std) == (CUBE, "01-02/4", 2e-3)
    at_target, at_home = calls
    assert at_target[2] is SEEN.boards[1].pose.holes[0].T_base_hole
    assert at_target[3] is at_home[3] is width
    assert at_target[4] == WITHIN
    assert at_target[5] == TASK.cell.boards[0].pocket
    assert len(at_target[6]) == 1  # the other displaced cube; the target board's holes are empty
    assert at_target[7].images is SEEN.images
    assert at_home[7] is None  # the look shows the first place empty, not the second
    assert all(np.hypot(*(T - at_home[2])[:2, 3]) < 2 * WITHIN for T in at_home[6])
    assert len(at_home[6]) >= 1  # seated neighbours, but not the cube itself
    assert all(np.hypot(*(T - at_home[2])[:2, 3]) > 0.04 for T in at_home[6])


def test_why_a_cube_is_not_located_is_said_for_each_place(calls: list[tuple[Any, ...]]) -> None:
    calls.append(())
    calls.append(())
    hidden = replace(SEEN, boards=SEEN.boards[:1])
    assert locate_displaced(TASK, hidden, CUBE, ["03-04/1", "01-02/4"]) == (
        "board 03-04 was not seen; near 01-02/4: nothing shows"
    )
    assert (
        locate_displaced(TASK, Observation(SEEN.boards), CUBE, ["01-02/4"])
        == "there are no images to find it in"
    )
