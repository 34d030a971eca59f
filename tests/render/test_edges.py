"""Antialiasing: many rays on edges, spread over the pixel."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.model import load_a465
from pictures.rendered import TABLE, board_with_cubes
from render.edges import edge_pixels, pixel_offsets
from render.renderer import render
from vision.camera.model import Camera, read_camera


@pytest.fixture(scope="module")
def camera() -> Camera:
    return read_camera(data_file("scenes/cameras/lab.toml"))


@pytest.fixture(scope="module")
def small(camera: Camera) -> Camera:
    """The lab's view at a quarter of its resolution."""
    K = camera.K * np.array([[0.25], [0.25], [1.0]])
    return Camera(K, camera.distortion, (480, 300), camera.T_base_camera)


@pytest.mark.parametrize("count", [1, 2, 4, 16, 64])
def test_sample_places_are_spread_over_all_columns_and_rows(count: int) -> None:
    offsets = pixel_offsets(count)
    expected = (np.arange(count) + 0.5) / count - 0.5
    assert np.allclose(np.sort(offsets, axis=0), np.stack([expected, expected], axis=-1))
    assert np.unique(offsets, axis=0).shape == (count, 2)


@pytest.mark.parametrize("side", [2, 4, 8])
def test_sample_places_are_spread_over_the_pixel(side: int) -> None:
    cells = np.floor((pixel_offsets(side**2) + 0.5) * side)
    assert len(np.unique(cells, axis=0)) == side**2


def test_a_number_of_samples_that_cannot_be_spread_is_refused() -> None:
    for count in (0, 12):
        with pytest.raises(InputError, match=f"samples = {count}: must be a power of two"):
            pixel_offsets(count)


def test_edges_get_many_rays_and_smooth_parts_one() -> None:
    surface = np.zeros((9, 12), dtype=np.uint16)
    surface[:, 6:] = 33
    edge = edge_pixels(surface)
    assert np.flatnonzero(edge.any(axis=0)).tolist() == [5, 6]


@pytest.mark.slow
def test_sixteen_rays_are_enough(small: Camera) -> None:
    place, cubes = board_with_cubes((0, 1, 2))
    arm = load_a465(0.134112, 0.06).bodies_at(np.radians([0.0, 12.0, -105.0, 0.0, -40.0, 20.0]))
    picture, reference = (render(small, [TABLE, *cubes, *arm], [place], samples=n) for n in (16, 256))
    difference = (picture - reference)[np.abs(picture - reference) > 0.01]
    assert np.sqrt(np.mean(np.square(difference))) < 0.7
    assert np.abs(difference).max() < 12.0
