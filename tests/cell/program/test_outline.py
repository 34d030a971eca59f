"""Outlines: arc length, directions, parts and samples of lines and arcs drawn at random."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest

from arm.errors import InputError
from cell.program.outline import Arc, Line, arc_about, arc_through, line, through
from programs.drawn import SEEDS, some_outline


@pytest.mark.parametrize("seed", SEEDS)
def test_arc_length_is_what_finite_differences_say(seed: int) -> None:
    outline, h = some_outline(seed), 1e-6
    joints = outline.joints
    s = np.linspace(0.0, outline.length, 200)[1:-1]
    s = s[np.abs(s[:, None] - joints).min(axis=1) > 2 * h]
    speed = (outline.at(s + h) - outline.at(s - h)) / (2 * h)
    np.testing.assert_allclose(speed, outline.directions(s), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(outline.directions(s), axis=1), 1.0, atol=1e-12)
    fine = outline.at(np.union1d(np.linspace(0.0, outline.length, 20001), joints))
    assert np.linalg.norm(np.diff(fine, axis=0), axis=1).sum() == pytest.approx(outline.length, rel=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_pieces_meet_and_go_on_straight_beyond_the_ends(seed: int) -> None:
    outline = some_outline(seed)
    for before, after in zip(outline.pieces, outline.pieces[1:], strict=False):
        np.testing.assert_allclose(before.at(np.array([before.length])), after.at(np.zeros(1)), atol=1e-12)
    ends = np.array([0.0, outline.length])
    beyond = outline.at(ends + np.array([-0.1, 0.1]))
    np.testing.assert_allclose(beyond[0], outline.at(ends)[0] - 0.1 * outline.directions(ends)[0], atol=1e-12)
    last = outline.pieces[-1]
    ahead = last.directions(np.array([last.length]))[0]
    np.testing.assert_allclose(beyond[1], outline.at(ends)[1] + 0.1 * ahead, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_backwards_and_parts_are_the_same_points(seed: int) -> None:
    outline = some_outline(seed)
    s = np.linspace(0.0, outline.length, 57)
    np.testing.assert_allclose(outline.backwards().at(outline.length - s), outline.at(s), atol=1e-12)
    begin, end = -0.05, 0.6 * outline.length
    part = outline.cut(begin, end)
    assert part.length == pytest.approx(end - begin)
    s = np.linspace(0.0, part.length, 57)
    np.testing.assert_allclose(part.at(s), outline.at(begin + s), atol=1e-12)
    whole = outline.cut(0.0, outline.length)
    assert whole.pieces == outline.pieces


def test_a_line_that_is_prolonged_stays_one_piece() -> None:
    outline = through([(0, 0, 0), (0, 0, 0.2)])
    (piece,) = outline.cut(-0.06, 0.17).pieces
    np.testing.assert_allclose(piece.at(np.array([0.0, piece.length])), [[0, 0, -0.06], [0, 0, 0.17]])
    with pytest.raises(InputError, match="nothing is left of a path of 200 mm between 100 and 100 mm"):
        outline.cut(0.1, 0.1)


@pytest.mark.few(15)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("chord_error", [5e-6, 1e-4])
def test_chords_between_samples_stay_within_the_stated_error(seed: int, chord_error: float) -> None:
    outline = some_outline(seed)
    s = outline.sampled(chord_error, 0.05)
    assert np.diff(s).min() > 0.0
    assert np.diff(s).max() <= 0.05 + 1e-12
    assert np.abs(s[:, None] - outline.joints).min(axis=0).max() < 1e-12
    worst = 0.0
    for a, b in pairwise(s):
        between = outline.at(np.linspace(a, b, 21))
        worst = max(worst, float(Line(between[0], between[-1]).distances(between).max()))
    assert worst <= chord_error * (1 + 1e-9)
    if any(isinstance(p, Arc) for p in outline.pieces) and chord_error > 5e-6:
        assert worst > 0.3 * chord_error  # no more samples than needed


@pytest.mark.parametrize("seed", SEEDS)
def test_distances_are_those_of_the_nearest_samples(seed: int) -> None:
    outline, rng = some_outline(seed), np.random.default_rng(seed)
    points = rng.normal(0.0, 0.2, (20, 3))
    for piece in outline.pieces:
        dense = piece.at(np.linspace(0.0, piece.length, 4001))
        nearest = np.linalg.norm(points[:, None] - dense, axis=2).min(axis=1)
        np.testing.assert_allclose(piece.distances(points), nearest, atol=1e-6)


def test_arcs_by_their_centre_and_by_a_point() -> None:
    """Wire D's arc: about (35, 0, 105) with a radius of 50 mm, tangent to the lines before and after it."""
    start, centre, end = (-0.015, 0.0, 0.105), (0.035, 0.0, 0.105), (0.035, 0.0, 0.155)
    arc = arc_about(start, centre, end)
    assert arc.angle == pytest.approx(np.pi / 2)
    assert arc.length == pytest.approx(0.05 * np.pi / 2)
    np.testing.assert_allclose(
        arc.directions(np.array([0.0, arc.length])), [[0, 0, 1], [1, 0, 0]], atol=1e-12
    )
    via = np.array(centre) + 0.05 * np.array([-np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    same = arc_through(start, via, end)
    s = np.linspace(0.0, arc.length, 9)
    np.testing.assert_allclose(same.at(s), arc.at(s), atol=1e-12)
    longer = arc_through(start, np.array(centre) + (0.0, 0.0, -0.05), end)
    assert longer.angle == pytest.approx(1.5 * np.pi)
    np.testing.assert_allclose(longer.at(np.array([longer.length])), [end], atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: through([(0, 0, 0)]), "a path has 1 points; must have at least two"),
        (lambda: line((0, 0, 0.1), (0, 0, 0.1)), "two points of a path are the same, (0, 0, 100)"),
        (lambda: arc_about((0.05, 0, 0), (0, 0, 0), (0, 0.051, 0)), "50.000 and 51.000 mm from its centre"),
        (lambda: arc_about((0.05, 0, 0), (0, 0, 0), (-0.05, 0, 0)), "turns by 180 deg"),
        (lambda: arc_about((0.05, 0, 0), (0, 0, 0), (0.05, 0, 0)), "ends are the same point, (50, 0, 0)"),
        (lambda: arc_through((0, 0, 0), (0.1, 0, 0), (0.2, 0, 0)), "lie on a line"),
    ],
)
def test_what_is_no_path_is_refused(make: object, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        make()  # type: ignore[operator]


def test_a_centre_at_the_ends_of_an_arc_is_refused() -> None:
    """Both are within the tolerance of each other, so the radii alone do not tell."""
    with pytest.raises(InputError, match=r"the arc's centre .* is at its ends"):
        arc_about((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 5e-5))
