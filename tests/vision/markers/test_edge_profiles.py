"""Edges on grey profiles: where the gradient has its centroid, and none where nobody can tell."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from vision.markers.edge_profiles import LEAST_HALF_PX, LEAST_STEP_GREY, NARROW_PX, Edges, Grey, edge_offsets

DARK, LIGHT = 40.0, 180.0


def _edge(
    at: float, angle: float, blur: float = 0.9, light: float = LIGHT, rim_px: float = 0.0
) -> tuple[Grey, np.ndarray]:
    """An image whose light side begins `at` px from its middle along a direction, and that direction.

    Of the contrast a fifth comes `rim_px` earlier, as of a rim that gleams.
    """
    along = np.array([np.cos(angle), np.sin(angle)])
    y, x = np.mgrid[0:41, 0:41] - 20.0
    off = x * along[0] + y * along[1] - at
    edge, rim = (0.5 * (1.0 + erf((off + early) / (np.sqrt(2.0) * blur))) for early in (0.0, rim_px))
    return (DARK + (light - DARK) * (0.8 * edge + 0.2 * rim)).astype(np.float32), along


def _found(
    image: Grey, along: np.ndarray, centre: tuple[float, float] = (20.0, 20.0), half: float = 8.0
) -> Edges:
    return edge_offsets(image, np.array([centre]), along[None], np.array([half]))


@pytest.mark.parametrize("angle", np.radians([0.0, 17.0, 45.0, 100.0, 260.0]))
@pytest.mark.parametrize("at", [-2.3, 0.0, 0.37, 3.1])
def test_an_edge_is_found_to_a_fiftieth_of_a_pixel(at: float, angle: float) -> None:
    edges = _found(*_edge(at, angle))
    assert edges.good.all()
    assert edges.offset[0] == pytest.approx(at, abs=0.02)


@pytest.mark.parametrize("angle", np.radians([0.0, 17.0, 45.0]))
@pytest.mark.parametrize(("rim_px", "off"), [(3.0, 0.18), (3.5, 0.11), (4.0, 0.06)])
def test_a_gleaming_rim_inside_hardly_moves_an_edge(angle: float, rim_px: float, off: float) -> None:
    """The plain centroid was moved by 0.41, 0.36 and 0.27 px."""
    edges = _found(*_edge(0.2, angle, rim_px=rim_px), half=NARROW_PX)
    assert edges.good.all()
    assert edges.offset[0] == pytest.approx(0.2, abs=off)


def test_noise_far_from_an_edge_hardly_moves_it() -> None:
    """The plain centroid scattered by 0.050 px."""
    image, along = _edge(0.2, 0.3)
    rng = np.random.default_rng(0)
    noisy = (image + rng.normal(0.0, 2.0, image.shape).astype(np.float32) for _ in range(300))
    offsets = [_found(one, along, half=NARROW_PX).offset[0] for one in noisy]
    assert np.std(offsets) < 0.035
    assert np.mean(offsets) == pytest.approx(0.2, abs=0.006)


def test_a_faint_edge_and_one_from_light_to_dark_are_none() -> None:
    image, along = _edge(0.0, 0.0, light=DARK + 0.9 * LEAST_STEP_GREY)
    assert not _found(image, along).good.any()
    image, along = _edge(0.0, 0.0)
    assert not _found(image, -along).good.any()


@pytest.mark.parametrize(("room", "good"), [(LEAST_HALF_PX + 0.5, True), (LEAST_HALF_PX - 0.5, False)])
def test_where_the_image_ends_before_the_light_side_does_nothing_is_said(room: float, good: bool) -> None:
    image, along = _edge(18.0 - room + 2.0, 0.0)
    edges = _found(image, along, (40.0 - room, 20.0))
    assert edges.good.all() == good
