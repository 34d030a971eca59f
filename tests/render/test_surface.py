"""Prints that are off, and a table with a texture."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import rotation, transform
from cell.files.world import board_placement
from pictures.rendered import SHADOWLESS, TABLE, corners, marker_camera, nominal_board
from render.light import KIND_GREY
from render.rays import pixel_rays
from render.renderer import PlacedBoard, render, with_noise
from render.solids import BodySolid
from render.surface import Print, Texture, TexturedSolid, sampled, texture_map
from vision.camera.model import Camera

FLAT = board_placement((0.46, 0.0, 0.04), np.radians(175.0), 0.0, 0.0)
BUSY = Texture(grain=3.0, specks=200.0, scratches=100.0, seed=4)


def seen_corners(how: Print) -> np.ndarray:
    """Corners (4, 2) px of the first marker; the camera's pixels are about 0.24 mm there."""
    camera = marker_camera(FLAT)
    place = PlacedBoard(nominal_board(), FLAT, (how, Print()))
    image = render(camera, [], [place], light=SHADOWLESS)
    return corners(with_noise(image, np.random.default_rng(0), 0.0), camera)


def expected_px(how: Print, points: np.ndarray) -> np.ndarray:
    """Where points (n, 2) m of the board appear."""
    on_board = np.column_stack([points, np.zeros(len(points)), np.ones(len(points))])
    return marker_camera(FLAT).project_base((on_board @ FLAT.T)[:, :3])


def test_a_print_as_designed_changes_no_point() -> None:
    x = np.arange(3, dtype=np.float32)
    assert Print().designed(x, x)[0] is x
    assert Print().margin == 0.0


@pytest.mark.parametrize("how", [Print(shift=(4e-4, -3e-4)), Print(turn=0.02), Print(scale=1.01)])
def test_a_marker_is_seen_where_it_was_glued_and_as_large_as_it_was_printed(how: Print) -> None:
    half = 0.018 * how.scale
    square = half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    c, s = np.cos(how.turn), np.sin(how.turn)
    true = square @ np.array([[c, s], [-s, c]]) + how.shift
    off = seen_corners(how) - expected_px(how, true)
    assert np.abs(off).max() < 0.03
    assert np.abs(seen_corners(Print()) - expected_px(how, true)).max() > 0.1


def test_ink_spreads_to_all_sides_and_detection_corrects_it() -> None:
    x = np.linspace(-1e-3, 1e-3, 201, dtype=np.float32)
    grown = Print(spread=1e-4).white_at(lambda x, y: x > 0.0, x, x)
    assert x[grown].min() == pytest.approx(1e-4, abs=1.1e-5)
    images = [
        render(marker_camera(FLAT), [], [PlacedBoard(nominal_board(), FLAT, (p, p))], light=SHADOWLESS)
        for p in (Print(), Print(spread=4e-5))
    ]
    assert images[1].mean() < images[0].mean() - 0.5
    assert np.abs(seen_corners(Print(spread=4e-5)) - seen_corners(Print())).max() < 0.03


def test_detection_corrects_less_than_half_of_a_border_that_lies_outwards() -> None:
    nominal = expected_px(Print(), 0.018 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]))
    out, whole = (
        np.abs(corners_px - nominal).mean()
        for corners_px in (
            seen_corners(Print(border=6e-5)),
            expected_px(Print(), 0.01806 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])),
        )
    )
    assert 0.45 * whole < out < 0.75 * whole


def test_warped_print_is_off_by_its_standard_deviation() -> None:
    true = expected_px(Print(), 0.018 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]))
    warp, side = 0.1e-3, np.linalg.norm(true[1] - true[0]) / 0.036
    offs = [seen_corners(Print(warp=warp, seed=(s,))) - true for s in range(8)]
    assert 0.6 < np.std(offs) / (warp * side) < 1.4
    grid = np.random.default_rng(0).uniform(-0.1, 0.1, (2, 500)).astype(np.float32)
    moved = [np.stack(Print(warp=1.0, seed=(seed, 1)).designed(*grid)) - grid for seed in range(60)]
    assert np.std(moved) == pytest.approx(1.0, abs=0.05)


def test_black_is_as_grey_as_the_print_says() -> None:
    place = PlacedBoard(nominal_board(), FLAT, (Print(black=90.0, white=200.0), Print()))
    camera = marker_camera(FLAT)
    ratio = [render(camera, [], [PlacedBoard(nominal_board(), FLAT)], light=SHADOWLESS)]
    image = render(camera, [], [place], light=SHADOWLESS)
    u, v = np.rint(expected_px(Print(), np.array([[-0.0155, 0.0155], [-0.0205, 0.0]]))).astype(int).T
    assert image[v, u] / ratio[0][v, u] == pytest.approx([90.0 / 22.0, 200.0 / 235.0], rel=1e-3)


def on_table(camera: Camera, points: np.ndarray, texture: Texture) -> np.ndarray:
    """Grey levels that a camera sees at points (n, 2) m of the table, before any blur."""
    rays = pixel_rays(camera)
    grey = TexturedSolid(BodySolid(TABLE, SHADOWLESS), texture).cast(camera.T_base_camera, rays).grey
    at = camera.project_base(np.column_stack([points, np.zeros(len(points))])).astype(np.float32)
    return sampled(grey, at[:, 0].copy(), at[:, 1].copy())


@pytest.mark.slow
def test_texture_is_fixed_to_the_table(camera: Camera) -> None:
    """A camera that moves and turns sees the same scratches at the same places of the table."""
    points = np.random.default_rng(1).uniform((0.40, -0.10), (0.52, 0.08), (4000, 2))
    first = on_table(camera, points, BUSY)
    moved = camera.at(camera.T_base_camera @ transform(rotation([0.01, -0.02, 0.3]), (0.01, 0.02, -0.01)))
    assert np.corrcoef(first, on_table(moved, points, BUSY))[0, 1] > 0.97
    assert np.array_equal(first, on_table(camera, points, BUSY))
    assert abs(np.corrcoef(first, on_table(camera, points + 2e-3, BUSY))[0, 1]) < 0.8
    other = on_table(camera, points, Texture(3.0, 0.0, 200.0, 100.0, seed=5))
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.2


def test_texture_has_the_stated_strength_and_repeats_without_a_seam() -> None:
    for texture in (Texture(grain=3.0), Texture(stain=4.0)):
        field = KIND_GREY["table"] * (texture_map(texture) - 1.0)
        assert field.std() == pytest.approx(texture.grain + texture.stain, rel=0.1)
        inner, seam = np.abs(np.diff(field, axis=1)), np.abs(field[:, 0] - field[:, -1])
        assert seam.mean() < 1.5 * inner.mean()
    specks = texture_map(Texture(specks=500.0))
    assert 0.001 < (specks < 0.95).mean() < 0.02
    assert Texture().plain
    assert not Texture(scratches=1.0).plain


def test_sides_of_the_table_have_no_texture(small: Camera) -> None:
    plain = BodySolid(TABLE, SHADOWLESS)
    from_side = small.at(transform(rotation([-np.pi / 2, 0, 0]), (0.35, -3.0, -0.02)))
    rays = pixel_rays(from_side)
    a, b = (s.cast(from_side.T_base_camera, rays) for s in (plain, TexturedSolid(plain, BUSY)))
    assert np.isfinite(a.depth).any()
    assert np.array_equal(a.grey, b.grey)
