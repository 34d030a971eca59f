"""A cube that is not seated is located where it is, and nothing is located where there is no such cube."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import Array
from displaced.loose import KINDS, WITHIN, LooseScene, error_of, loose_scene
from vision.loose.locate import LooseCube, NotLocated, locate_cube
from vision.loose.sides import Sides, measure_sides, side_normals
from vision.occupancy.cube_top import EmptyPlace
from vision.occupancy.edge_response import PlateView
from vision.occupancy.seated import CubeWidth


def _located(scene: LooseScene, within: float = WITHIN) -> LooseCube | NotLocated:
    return locate_cube(
        scene.images,
        scene.camera,
        scene.T_base_place,
        scene.width,
        within,
        scene.pocket,
        scene.others,
        scene.empty,
    )


@pytest.mark.parametrize(
    ("kind", "world", "seed"),
    [
        ("aside", "realistic", 1),
        *(pytest.param(k, "realistic", 1, marks=pytest.mark.slow) for k in KINDS if k != "aside"),
        *(pytest.param(k, w, s, marks=pytest.mark.slow) for k in KINDS for w in ("ideal",) for s in (2, 3)),
    ],
)
def test_it_is_located_as_accurately_as_it_says(kind: str, world: str, seed: int) -> None:
    scene = loose_scene(seed, kind, world, width_std=1e-5, with_empty=seed % 2 == 1)
    found = _located(scene)
    assert isinstance(found, LooseCube), found
    error = error_of(found.T_base_cube, scene.T_base_cube)
    assert np.linalg.norm(error[:3]) < 1.5e-3
    assert np.degrees(np.linalg.norm(error[3:])) < 1.5
    assert (np.abs(error) < 4.0 * np.sqrt(np.diag(found.covariance))).all()


@pytest.mark.slow
def test_no_cube_and_a_cube_at_no_known_rest_are_not_located() -> None:
    for kind, seed in (("gone", 4), ("odd", 5)):
        assert isinstance(_located(loose_scene(seed, kind)), NotLocated)


@pytest.mark.slow
def test_a_known_cube_and_one_too_far_away_are_not_located() -> None:
    scene = loose_scene(1, "aside")
    known = locate_cube(
        scene.images, scene.camera, scene.T_base_place, scene.width, WITHIN, scene.pocket, [scene.T_base_cube]
    )
    assert isinstance(known, NotLocated)
    away = float(np.linalg.norm(scene.T_base_cube[:3, 3] - scene.T_base_place[:3, 3]))
    assert isinstance(_located(scene, 0.6 * away), NotLocated)


@pytest.mark.slow
def test_what_the_images_of_the_empty_place_show_too_is_no_cube() -> None:
    scene = loose_scene(1, "aside")
    empty = EmptyPlace(scene.images, scene.camera, scene.T_base_place)
    found = _located(replace(scene, empty=empty))
    assert isinstance(found, NotLocated)
    assert "empty" in found.reason


def test_a_height_that_the_width_does_not_tell_is_not_claimed() -> None:
    scene = loose_scene(1, "high")
    found = locate_cube(
        scene.images,
        scene.camera,
        scene.T_base_place,
        CubeWidth(scene.width.value, 1e-4),
        WITHIN,
        scene.pocket,
        scene.others,
    )
    assert isinstance(found, NotLocated)
    assert "too uncertain" in found.reason


@pytest.mark.slow
def test_a_leaning_cube_is_not_taken_for_a_wedged_one() -> None:
    """Its top fits a wedged cube's, but less well than that of one does: it was located 5 degrees off."""
    s = loose_scene(300_082, "half", "realistic", False, 12e-6, with_empty=False)
    found = locate_cube(s.images, s.camera, s.T_base_place, s.width, WITHIN, s.pocket, s.others, s.empty)
    if isinstance(found, LooseCube):
        error = error_of(found.T_base_cube, s.T_base_cube)
        assert np.linalg.norm(error[:3]) < 2e-3
        assert np.degrees(np.linalg.norm(error[3:])) < 4.0


@pytest.mark.slow
def test_an_upright_cube_may_be_higher_or_lower_than_it_seems_by_what_fingers_forgive() -> None:
    """Its sides hold at any height, so 1.1 mm of standard deviation do not make it a cube that nobody can take."""
    s = loose_scene(600_023, "high", "realistic", False, 12e-6, with_empty=True)
    found = locate_cube(s.images, s.camera, s.T_base_place, s.width, WITHIN, s.pocket, s.others, s.empty)
    assert isinstance(found, LooseCube), found
    assert 0.7e-3 < np.sqrt(found.covariance[2, 2]) < 1.2e-3
    error = error_of(found.T_base_cube, s.T_base_cube)
    assert np.linalg.norm(error[:2]) < 1e-3
    assert abs(error[2]) < 3e-3


def _two_sides_further_apart(by_px: float) -> Callable[..., Sides]:
    """Instead of `measure_sides`: exact places of two opposite sides further out, each by so many px."""

    def measured(
        view: PlateView, T_base_cube: Array, size: float, reach_px: float, noise: float, *exact: object
    ) -> Sides:
        sides = measure_sides(view, T_base_cube, size, reach_px, noise, *exact)  # type: ignore[arg-type]
        if not (exact and exact[0]):
            return sides
        _, normal = side_normals(view, T_base_cube, size, sides.side, sides.along)
        return replace(sides, points=sides.points + by_px * normal * (sides.side % 2 == 1)[:, None])

    return measured


@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_an_upright_cube_is_located_although_exact_places_of_its_sides_are_off(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As beside a narrow bright face and a dark gap: its top then seems to hover above the pocket."""
    scene = loose_scene(seed, "high", width_std=1e-5)
    monkeypatch.setattr("vision.loose.locate.measure_sides", _two_sides_further_apart(0.8))
    found = _located(scene)
    assert isinstance(found, LooseCube), found
    error = error_of(found.T_base_cube, scene.T_base_cube)
    assert np.linalg.norm(error[:3]) < 1.5e-3
    assert np.degrees(np.linalg.norm(error[3:])) < 2.5
    assert (np.abs(error) < 3.0 * np.sqrt(np.diag(found.covariance))).all()


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("half", 1), ("aside", 1), ("odd", 5), ("gone", 4)])
def test_nothing_else_is_taken_for_an_upright_cube(
    kind: str, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vision.loose.locate.measure_sides", _two_sides_further_apart(0.8))
    assert isinstance(_located(loose_scene(seed, kind, width_std=1e-5)), NotLocated)
