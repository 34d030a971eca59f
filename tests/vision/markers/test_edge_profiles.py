"""Edges on grey profiles: where the gradient has its centroid, and none where nobody can tell."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from vision.markers.edge_profiles import LEAST_HALF_PX, LEAST_STEP_GREY, Edges, Grey, edge_offsets

DARK, LIGHT = 40.0, 180.0


def _edge(at: float, angle: float, blur: float = 0.9, light: float = LIGHT) -> tuple[Grey, np.ndarray]:
    """An image whose light side begins `at` px from its middle along a direction, and that direction."""
    along = np.array([np.cos(angle), np.sin(angle)])
    y, x = np.mgrid[0:41, 0:41] - 20.0
    off = x * along[0] + y * along[1] - at
    return (DARK + (light - DARK) * 0.5 * (1.0 + erf(off / (np.sqrt(2.0) * blur)))).astype(np.float32), along


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
