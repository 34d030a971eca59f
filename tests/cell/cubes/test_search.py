"""Where a cube that did not seat is released again."""

from __future__ import annotations

import numpy as np
import pytest

from arm.numerics.products import mul
from arm.se3 import Array, frozen, inverse, rot_x, rot_z, transform
from cell.cubes.search import EXPLAINS, Search, spiral_point
from cell.scene.build import grips_over
from plan.scene import Station

CAPTURE = 2e-3  # m, of a pocket


def _place(rng: np.random.Generator) -> tuple[Array, Station]:
    T = transform(mul(rot_z(rng.uniform(-3, 3)), rot_x(rng.uniform(-0.2, 0.2))), rng.uniform(-0.2, 0.2, 3))
    return T, Station("03-04/1", grips_over(T, 0.015))


def _released(T_base_place: Array, T_base_tool: Array, error: Array) -> Array:
    """Offset from its place of a cube that the jaws release, if they are off by `error` in the place's plane."""
    return (inverse(T_base_place) @ T_base_tool)[:2, 3] + error


@pytest.mark.parametrize("seed", range(20))
def test_measured_corrections_bring_a_cube_into_its_pocket(seed: int) -> None:
    """Along the jaws the arm's error repeats; along the fingers only that of the first grasp was larger."""
    rng = np.random.default_rng(seed)
    T_base_place, station = _place(rng)
    local, first = rng.uniform(
        -2.5e-3, 2.5e-3, (2, 2)
    )  # of the arm here; of the first grasp along the fingers
    search = Search()
    T_base_tool = station.T_base_tool[int(rng.integers(4))]
    along = int(np.argmax(np.abs(T_base_place[:3, :2].T @ T_base_tool[:3, 1])))
    error = np.where(np.arange(2) == along, local, first)
    offsets = [_released(T_base_place, T_base_tool, error)]
    while np.abs(offsets[-1]).max() > CAPTURE and len(offsets) < 4:
        search = search.after(T_base_place, T_base_tool, offsets[-1] + 0.1e-3 * rng.standard_normal(2))
        again = search.station(station, T_base_place)
        assert len(again.T_base_tool) == 2  # the jaws travel as before
        T_base_tool = again.T_base_tool[int(rng.integers(2))]
        near = np.where(np.arange(2) == along, local, 0.2e-3 * rng.standard_normal(2))
        offsets.append(_released(T_base_place, T_base_tool, near))
    assert np.abs(offsets[-1]).max() <= CAPTURE
    assert len(offsets) <= 2


def test_what_is_off_along_the_fingers_is_corrected_if_it_repeats() -> None:
    T_base_place, station = _place(np.random.default_rng(1))
    T_base_tool = station.T_base_tool[0]
    offset = np.array([3e-3, 2e-3])
    first = Search().after(T_base_place, T_base_tool, offset)
    assert np.count_nonzero(first.shift) == 1
    assert first.shift[first.along] == -offset[first.along]
    second = first.after(T_base_place, T_base_tool, offset)
    assert np.allclose(second.shift, [-2 * o if axis == first.along else -o for axis, o in enumerate(offset)])


def test_a_cube_that_was_pushed_away_is_released_as_before() -> None:
    T_base_place, station = _place(np.random.default_rng(2))
    search = Search().after(T_base_place, station.T_base_tool[0], None)
    again = search.after(T_base_place, station.T_base_tool[0], None)
    assert search.shift == again.shift == (0.0, 0.0)
    assert again.tried == 2


def test_an_offset_that_explains_nothing_is_followed_by_one_plain_release_and_a_spiral() -> None:
    T_base_place, station = _place(np.random.default_rng(3))
    search, shifts = Search(), []
    for _ in range(8):
        search = search.after(T_base_place, station.T_base_tool[0], np.array([0.5 * EXPLAINS, 0.0]))
        shifts.append(search.shift)
    assert shifts[0] == (0.0, 0.0)
    assert np.allclose(shifts[1:], [spiral_point(n) for n in range(1, 8)])
    points = np.array([spiral_point(n) for n in range(8)])
    distances = np.linalg.norm(points[:, None] - points, axis=2)[np.triu_indices(8, 1)]
    assert min(distances) > 0.5e-3  # no point twice
    assert max(np.hypot(*spiral_point(n)) for n in range(8)) < CAPTURE


def test_the_first_release_is_the_station_itself() -> None:
    T_base_place, station = _place(np.random.default_rng(4))
    assert Search().station(station, T_base_place) is station
    assert frozen(spiral_point(0)).tolist() == [0.0, 0.0]
