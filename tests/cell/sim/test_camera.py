"""The true camera: it moves and exposes as the world file says, measured from its images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import transform
from cell.config.cell_file import read_cell
from cell.files.world import World, read_world
from cell.sim.camera import SimulatedCamera, TrueCamera, drift, shaken
from cell.sim.cell import SimulatedCell
from pictures.boards import smaller
from pictures.rendered import changed, corners, marker_camera, nominal_board, world_with
from render.renderer import PlacedBoard
from vision.camera.model import Camera, Image, read_camera


@pytest.fixture
def world(tmp_path: Path) -> World:
    return world_with(tmp_path, "seed = 5\nnoise_grey = 0.5\n")


def images(world: World, camera: Camera, count: int, now_ms: int = 0) -> list[Image]:
    """Images of the first marker, without a table."""
    board = world.boards[0]
    place = PlacedBoard(nominal_board(), board.T_base_board)
    return TrueCamera(camera, world).images(count, now_ms, [], [place], "DICT_4X4_50", [])


def seen(world: World, count: int = 1, **values: Any) -> np.ndarray:
    """Corners (count, 4, 2) px of the marker in `count` images."""
    camera = marker_camera(world.boards[0].T_base_board)
    return np.array([corners(i, camera) for i in images(changed(world, "image", **values), camera, count)])


def test_a_camera_without_keys_stands_still(world: World) -> None:
    camera = TrueCamera(read_camera(data_file("scenes/cameras/lab.toml")), world)
    assert camera.alike
    assert camera.at(0, 0) is camera.at(7, 10**6)
    assert camera.texture.plain


def test_markers_move_by_the_stated_sway_and_all_corners_alike(world: World) -> None:
    moved = seen(world, 10, sway=0.5) - seen(world)
    assert np.std(moved.mean(axis=1)) == pytest.approx(0.5, rel=0.4)
    assert np.abs(moved - moved.mean(axis=1, keepdims=True)).max() < 0.05
    assert np.array_equal(seen(world, 2, sway=0.5), seen(world)[0] + moved[:2])


def test_sway_is_that_of_the_middle_of_the_image(world: World) -> None:
    lab = read_camera(data_file("scenes/cameras/lab.toml"))
    camera = TrueCamera(lab, changed(world, "image", sway=0.5, sway_turn=np.radians(0.01)))
    at = np.array(
        [np.append(lab.normalised(lab.K[:2, 2]), 1.0), np.append(lab.normalised((1800.0, 500.0)), 1.0)]
    )
    base = at @ lab.T_base_camera[:3, :3].T + lab.T_base_camera[:3, 3]
    before = lab.project_base(base)
    moves = np.array([camera.at(n, 0).project_base(base) - before for n in range(300)])
    assert moves[:, 0].std(axis=0) == pytest.approx([0.5, 0.5], rel=0.1)
    turns = (moves[:, 1, 1] - moves[:, 0, 1]) / (1800.0 - lab.K[0, 2])
    assert turns.std() == pytest.approx(np.radians(0.01), rel=0.15)


def test_a_shaken_camera_shifts_the_middle_of_its_image() -> None:
    lab = read_camera(data_file("scenes/cameras/lab.toml"))
    middle = np.append(lab.normalised(lab.K[:2, 2]), 1.0)
    seen_now = lab.project(np.linalg.inv(shaken(lab, np.array([2.0, -1.0]), 0.01)[:3, :3]) @ middle)
    assert seen_now - lab.K[:2, 2] == pytest.approx([2.0, -1.0], abs=0.02)


def test_drift_is_slow_and_of_unit_variance() -> None:
    at = np.array([drift(seed, 100.0 * seed) for seed in range(400)])
    assert at.std() == pytest.approx(1.0, abs=0.06)
    steps = np.array([drift(seed, 10.0) - drift(seed, 0.0) for seed in range(100)])
    assert np.abs(steps).max() < 0.4
    assert np.array_equal(drift(3, 77.0), drift(3, 77.0))


def test_a_turned_camera_stays_turned(world: World) -> None:
    lab = read_camera(data_file("scenes/cameras/lab.toml"))
    camera = TrueCamera(lab, changed(world, "image", turned=np.radians([0.02, 0.0, 0.0]))).at(0, 0)
    middle = (
        np.append(lab.normalised(lab.K[:2, 2]), 1.0) @ lab.T_base_camera[:3, :3].T + lab.T_base_camera[:3, 3]
    )
    shift = camera.project_base(middle) - lab.project_base(middle)
    assert shift == pytest.approx([0.0, lab.K[1, 1] * np.radians(0.02)], abs=0.02)


def test_corners_scatter_on_their_own(world: World) -> None:
    moved = seen(world, 10, corner_scatter=0.1) - seen(world)
    assert 0.08 < moved.std() < 0.2  # a corner is where two lines cross, which adds to the scatter of points
    assert np.std(moved.mean(axis=1)) < 0.7 * moved.std()


def test_a_gradient_and_an_exposure_are_seen(world: World) -> None:
    camera = marker_camera(world.boards[0].T_base_board)
    plain, bright = (
        np.array(images(changed(world, "image", **v), camera, 8), dtype=float).mean(axis=(1, 2))
        for v in ({}, {"exposure": 0.8, "exposure_scatter": 0.05})
    )
    assert bright.mean() / plain.mean() == pytest.approx(0.8, rel=0.06)
    assert 0.02 < bright.std() / bright.mean() < 0.09
    assert plain.std() / plain.mean() < 1e-3
    gamma = images(changed(world, "image", gamma=2.0), camera, 1)[0].astype(float)
    linear = images(world, camera, 1)[0].astype(float)
    assert np.abs(gamma - 255.0 * (linear / 255.0) ** 2).mean() < 1.5


def test_blur_widens_edges(world: World) -> None:
    camera = marker_camera(world.boards[0].T_base_board)
    steep = [
        np.abs(np.diff(images(changed(world, "image", blur=b), camera, 1)[0].astype(float))).max()
        for b in (0.7, 1.4)
    ]
    assert steep[1] < 0.7 * steep[0]


def test_an_image_shows_the_boards_where_they_are_by_then() -> None:
    task = read_cell(data_file("scenes/cell.toml"))
    truth = read_world(data_file("scenes/task2.world.toml"), 0.036)
    push = transform(t=(0.01, 0.02, 0.0))
    pushed = replace(
        truth, boards=tuple(replace(b, T_base_board=push @ b.T_base_board) for b in truth.boards)
    )

    class Catching(SimulatedCell):
        def catch_up(self) -> None:
            self.world = SimulatedCell(task, pushed).world

    def image(simulated: SimulatedCell) -> Image:
        simulated._cubes = []
        counts = task.unit.counts(task.q_start)
        camera = smaller(task.nominal_camera, 0.25)
        return SimulatedCamera(simulated, camera, lambda: counts, task.dictionary).grab(1)[0]

    assert np.array_equal(image(Catching(task, truth)), image(SimulatedCell(task, pushed)))
