"""Biarcs join smoothly, round corners within a deviation, and follow smooth curves."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import Array
from cell.program.biarcs import arcs_along, biarc, rounded
from cell.program.outline import Arc, Outline, through
from programs.drawn import SEEDS, some_outline


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


@pytest.mark.parametrize("seed", range(60))
def test_a_biarc_meets_both_ends_and_turns_nowhere_at_once(seed: int) -> None:
    rng = np.random.default_rng([4, seed])
    start, end, ahead = rng.normal(0.0, 0.1, 3), rng.normal(0.0, 0.1, 3), _unit(rng)
    ahead_end = ahead if seed % 10 == 0 else _unit(rng)
    outline = Outline(biarc(start, ahead, end, ahead_end))
    ends = np.array([0.0, outline.length])
    np.testing.assert_allclose(outline.at(ends), [start, end], atol=1e-9)
    np.testing.assert_allclose(outline.directions(ends), [ahead, ahead_end], atol=1e-6)
    assert outline.turns().max(initial=0.0) < 1e-6


@pytest.mark.parametrize("turn_deg", [5.0, 30.0, 45.0, 60.0, 90.0, 150.0])
@pytest.mark.parametrize("deviation", [1e-4, 1e-3, 5e-3])
def test_a_corner_of_lines_gets_one_arc_that_just_deviates_so_far(turn_deg: float, deviation: float) -> None:
    """An arc of radius r in a corner that turns by t passes it at r (1 / cos(t / 2) - 1)."""
    t = np.radians(turn_deg)
    outline = through([(0, 0, 0), (0, 0, 0.5), (0.5 * np.sin(t), 0, 0.5 + 0.5 * np.cos(t))])
    smooth = rounded(outline, deviation)
    assert len(smooth.corners()) == 0
    radii = [p.radius for p in smooth.pieces if isinstance(p, Arc)]
    cut = smooth.pieces[0].length
    if 0.5 - cut < 0.49:  # not limited by the lines' lengths
        np.testing.assert_allclose(radii, deviation / (1.0 / np.cos(t / 2.0) - 1.0), rtol=1e-6)
    far = min(float(p.distances(np.array([[0.0, 0.0, 0.5]]))[0]) for p in smooth.pieces)
    assert far <= deviation * (1 + 1e-9)
    assert far == pytest.approx(deviation, rel=1e-6) or cut < 1e-6


@pytest.mark.few(12)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("deviation", [2e-4, 2e-3])
def test_rounded_corners_stay_within_the_deviation_both_ways(seed: int, deviation: float) -> None:
    outline = some_outline(seed)
    smooth = rounded(outline, deviation)
    sharp = outline.turns() >= np.radians(170.0)
    assert len(smooth.corners()) == sharp.sum()
    for a, b in ((smooth, outline), (outline, smooth)):
        points = a.at(np.linspace(0.0, a.length, 500))
        off = np.min([piece.distances(points) for piece in b.pieces], axis=0)
        assert off.max() <= deviation * 1.001  # of samples of a rounding
    ends = np.array([0.0, outline.length])
    np.testing.assert_allclose(smooth.at([0.0, smooth.length]), outline.at(ends), atol=1e-12)
    assert rounded(outline, 0.0) is outline


@pytest.mark.parametrize("tolerance", [5e-6, 1e-4])
def test_arcs_follow_a_smooth_curve_within_the_tolerance(tolerance: float) -> None:
    """A cubic Bezier curve, as an SVG has them, and an ellipse."""
    corners = np.array([[0, 0, 0], [0.05, 0.1, 0], [0.1, -0.1, 0], [0.15, 0.03, 0]])

    def bezier(u: float) -> Array:
        w = np.array([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3])
        return np.asarray(w @ corners)

    def along(u: float) -> Array:
        w = np.array([-((1 - u) ** 2), (1 - u) ** 2 - 2 * u * (1 - u), 2 * u * (1 - u) - u**2, u**2])
        v = w @ corners
        return np.asarray(v / np.linalg.norm(v))

    outline = Outline(arcs_along(bezier, along, tolerance))
    assert len(outline.corners()) == 0
    points = np.array([bezier(u) for u in np.linspace(0.0, 1.0, 2001)])
    off = np.min([piece.distances(points) for piece in outline.pieces], axis=0)
    assert off.max() <= 1.5 * tolerance
    assert len(outline.pieces) < 100


@pytest.mark.parametrize(("turns", "followed"), [(20, True), (20_000, False)])
def test_a_curve_is_followed_within_the_tolerance_or_refused(turns: int, followed: bool) -> None:
    wave = 2.0 * np.pi * turns

    def point(u: float) -> Array:
        return np.array([0.05 * u, 0.02 * np.sin(wave * u), 0.0])

    def direction(u: float) -> Array:
        d = np.array([0.05, 0.02 * wave * np.cos(wave * u), 0.0])
        return d / np.linalg.norm(d)

    if not followed:
        with pytest.raises(InputError, match="divide it, or draw it with fewer turns"):
            arcs_along(point, direction, 2e-6)
        return
    pieces = arcs_along(point, direction, 2e-6)
    at = np.array([point(u) for u in np.linspace(0.0, 1.0, 999)])
    assert np.min([piece.distances(at) for piece in pieces], axis=0).max() < 4e-6
