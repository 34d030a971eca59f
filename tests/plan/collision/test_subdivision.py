"""Pieces of a chain of cubics: the curve never leaves what a piece says of it, whichever way it bends in between."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import Array
from arms.grazing import ARMS, MOTIONS, arm, motion, place
from plan.collision.bezier import Curve
from plan.collision.subdivision import CurveIntervals, CurveSubdivision

CURVES = 60
SAMPLES = 41
ROUNDING = 1e-12  # rad


def curves(kind: str, name: str) -> list[Curve]:
    """Random motions of a kind, of an arm."""
    rng = np.random.default_rng([MOTIONS.index(kind), ARMS.index(name)])
    model = arm(name).model
    return [motion(kind, model.lowerPositionLimit, model.upperPositionLimit, rng) for _ in range(CURVES)]


def depths(curve: Curve, count: int = 3) -> list[CurveIntervals]:
    """The first pieces, and what they are cut into."""
    chain = CurveSubdivision(curve)
    found = [chain.first_pieces(3)]
    for _ in range(count - 1):
        found.append(chain.finer(found[-1]))
    return found


def beside(hull: Array, q: Array) -> Array:
    """How far each joint of q (s, pieces, n) is from the box of its control points (pieces, 4, n); the same, rad."""
    return np.maximum(np.maximum(hull.min(axis=1) - q, q - hull.max(axis=1)), 0.0)


@pytest.mark.parametrize("kind", MOTIONS)
def test_the_curve_stays_within_reach_of_the_middle_and_near_the_hull(kind: str) -> None:
    """At every place of every piece at every depth; the reach is what the certificate multiplies."""
    fullest, runs, parts = 0.0, 0, 0
    for curve in curves(kind, "open" if kind == "counts" else "seven joints"):
        for pieces in depths(curve):
            runs += int(pieces.runs().sum())
            parts += int((~pieces.runs()).sum())
            at = np.linspace(pieces.begin, pieces.end, SAMPLES)
            q = place(curve, at.ravel()).reshape(*at.shape, -1)
            away = np.abs(q - pieces.middle).max(axis=0)
            assert np.all(away <= pieces.reach + ROUNDING)
            assert np.all(beside(pieces.control, q).max(axis=0) <= pieces.spread + ROUNDING)
            moving = pieces.reach > 1e-6
            fullest = max(fullest, float((away[moving] / pieces.reach[moving]).max(initial=0.0)))
    assert parts > 1000
    assert runs > 0 or kind != "run"
    assert fullest > 0.99  # the reach is no larger than it must be


@pytest.mark.parametrize("kind", MOTIONS)
def test_pieces_of_a_depth_cover_the_curve_once(kind: str) -> None:
    for curve in curves(kind, "open"):
        for pieces in depths(curve):
            order = np.argsort(pieces.begin)
            begin, end = pieces.begin[order], pieces.end[order]
            assert begin[0] == 0.0
            assert end[-1] == len(curve.control)
            np.testing.assert_allclose(begin[1:], end[:-1], atol=1e-12)
            np.testing.assert_allclose(place(curve, pieces.cuts()), pieces.middle, atol=1e-9)
            assert np.all((pieces.first <= pieces.begin) & (pieces.end <= pieces.last))


def test_the_reach_of_a_cubic_that_ends_where_it_began_is_not_zero() -> None:
    """Out to one side, out to the other, and home: begin, middle and end are one configuration."""
    q = np.array([0.3, -0.2])
    swing = np.array([[0.0, 0.0], [0.09, 0.0], [-0.09, 0.0], [0.0, 0.0]])
    pieces = CurveSubdivision(Curve((q + swing)[None], np.array([1.0]))).first_pieces(1)
    farthest = 0.09 / (2.0 * np.sqrt(3.0))  # of 3 u (1 - u) (1 - 2 u) times 0.09
    np.testing.assert_allclose(pieces.middle, [q], atol=1e-12)
    assert pieces.reach[0, 0] >= farthest
    assert pieces.reach[0, 1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_a_first_piece_travels_less_than_twice_its_nominal_travel(count: int) -> None:
    """Unless there would be too many: cubics that are longer are cut in equal parts."""
    for travel in (0.15, 0.39, 0.4, 0.41, 0.75):  # of a cubic, rad; a piece is to have 0.2
        row = np.linspace(0.0, travel, 4)[:, None] * np.array([0.5, 0.0, -0.5])
        begins = travel * np.arange(count)[:, None, None] * np.array([0.5, 0.0, -0.5])
        pieces = CurveSubdivision(Curve(row[None] + begins, np.ones(count))).first_pieces(2)
        travels = np.ptp(pieces.control, axis=1).sum(axis=1)
        assert travels.sum() == pytest.approx(count * travel)
        assert travels.max() < 2.0 * 0.2 - 1e-6 or len(pieces) >= 8
