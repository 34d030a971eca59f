"""Drawings: shapes, paths, groups and transforms become strokes on the plane, exactly or within the tolerance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError
from cell.program.outline import Line, Outline
from cell.program.svg import TOLERANCE, strokes_of


def strokes(
    folder: Path, body: str, box: str = 'viewBox="0 0 100 50"', width: float = 0.1
) -> tuple[Outline, ...]:
    file = folder / "drawing.svg"
    file.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {box}>{body}</svg>')
    return strokes_of(file, width)


def test_lines_are_where_they_are_drawn_with_y_up(tmp_path: Path) -> None:
    """100 units are 100 mm, so a unit is a millimetre; the lower left corner of the view box is the origin."""
    (stroke,) = strokes(tmp_path, '<polyline points="0,50 30,50 30,10"/>')
    assert all(isinstance(piece, Line) for piece in stroke.pieces)
    np.testing.assert_allclose(
        1e3 * stroke.at([0.0, 0.03, 0.07]), [[0, 0, 0], [30, 0, 0], [30, 40, 0]], atol=1e-9
    )
    (scaled,) = strokes(tmp_path, '<path d="M 0 50 h 30"/>', width=0.2)
    assert scaled.length == pytest.approx(0.06)
    (shifted,) = strokes(tmp_path, '<line x1="10" y1="20" x2="20" y2="20"/>', 'viewBox="10 10 100 50"')
    np.testing.assert_allclose(1e3 * shifted.at([0.0]), [[0, 40, 0]], atol=1e-9)


def test_transforms_of_groups_apply_from_the_outside_in(tmp_path: Path) -> None:
    body = '<g transform="translate(10 20) scale(2)"><line x1="1" y1="1" x2="4" y2="1" transform="rotate(90 1 1)"/></g>'
    (stroke,) = strokes(tmp_path, body)
    ends = 1e3 * stroke.at([0.0, stroke.length])
    np.testing.assert_allclose(ends, [[12, 50 - 22, 0], [12, 50 - 28, 0]], atol=1e-9)
    (skewed,) = strokes(tmp_path, '<line x1="0" y1="10" x2="0" y2="20" transform="skewX(45)"/>')
    np.testing.assert_allclose(1e3 * skewed.at([0.0, skewed.length]), [[10, 40, 0], [20, 30, 0]], atol=1e-9)
    (mapped,) = strokes(tmp_path, '<line x2="3" transform="matrix(0 1 -1 0 5 6)"/>')
    np.testing.assert_allclose(1e3 * mapped.at([0.0, mapped.length]), [[5, 44, 0], [5, 41, 0]], atol=1e-9)


@pytest.mark.parametrize("shape", ["circle", "path", "ellipse"])
def test_circles_and_ellipses_are_followed_within_the_tolerance(tmp_path: Path, shape: str) -> None:
    body = {
        "circle": '<circle cx="50" cy="25" r="20"/>',
        "path": '<path d="M 70 25 A 20 20 0 0 0 30 25 A 20 20 0 0 0 70 25"/>',
        "ellipse": '<ellipse cx="50" cy="25" rx="20" ry="10"/>',
    }[shape]
    (stroke,) = strokes(tmp_path, body)
    high = 10.0 if shape == "ellipse" else 20.0
    t = np.linspace(0.0, 2.0 * np.pi, 2000)
    points = np.stack([50 + 20 * np.cos(t), 25 + high * np.sin(t), 0 * t], axis=1) / 1e3
    off = np.min([piece.distances(points) for piece in stroke.pieces], axis=0)
    assert off.max() < 1.5 * TOLERANCE
    assert len(stroke.corners()) == 0
    assert len(stroke.pieces) < 150  # with wrong directions at its joints it would be thousands
    np.testing.assert_allclose(stroke.at([0.0]), stroke.at([stroke.length]), atol=1e-9)


def test_a_path_with_moves_has_a_stroke_for_each(tmp_path: Path) -> None:
    found = strokes(
        tmp_path, '<path d="M 0 0 h 10 v 10 z m 20 0 q 5 5 10 0 t 10 0 M 60 0 c 0 0 10 10 20 0"/>'
    )
    assert len(found) == 3
    closed, wave, blunt = found
    np.testing.assert_allclose(closed.at([0.0]), closed.at([closed.length]), atol=1e-12)
    assert len(closed.corners()) == 2
    assert len(wave.corners()) == 0  # t goes on smoothly
    np.testing.assert_allclose(1e3 * blunt.at([0.0, blunt.length]), [[60, 50, 0], [80, 50, 0]], atol=1e-9)
    u = np.linspace(0.0, 1.0, 500)[:, None]
    control = np.array([[60, 50], [60, 50], [70, 40], [80, 50]])
    weights = ((1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3)
    points = sum(w * c for w, c in zip(weights, control, strict=True))
    off = np.min([p.distances(np.insert(points, 2, 0, axis=1) / 1e3) for p in blunt.pieces], axis=0)
    assert off.max() < 2 * TOLERANCE


def test_what_draws_no_line_is_left_out(tmp_path: Path) -> None:
    body = '<!-- a remark --><defs><path d="M 0 0 h 9"/></defs><style>p {}</style><line x2="5"/><path d=""/>'
    assert len(strokes(tmp_path, body + '<g display="none"><line x2="7"/></g>')) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<svg", r"drawing.svg: must be an SVG, and is not XML.*\(export it as SVG\)"),
        ("<html/>", r"drawing.svg = '<html>': must be an SVG"),
        ('<svg><line x2="1"/></svg>', r"viewBox.*must be left, top, width and height"),
        ('<svg viewBox="0 0 0 5"/>', r"viewBox = '0 0 0 5': must be left, top, width and height"),
        ('<svg viewBox="0 0 5 5"/>', r"has no strokes"),
        ('<svg viewBox="0 0 5 5"><text>a</text></svg>', r"<text>': is not read; convert it to paths"),
        ('<svg viewBox="0 0 5 5"><path d="7 0 h 7"/></svg>', r"d = '7 0 h 7': must be path data that begins"),
        ('<svg viewBox="0 0 5 5"><line x2="1" transform="turn(3)"/></svg>', r"transform = 'turn\(3\)': must be matrix"),
        ('<svg viewBox="0 0 5 5"><line x2="1" transform="matrix(3)"/></svg>', r"transform.*with their numbers"),
    ],
)  # fmt: skip
def test_what_is_no_drawing_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "drawing.svg").write_text(text)
    with pytest.raises(FileInputError, match=message):
        strokes_of(tmp_path / "drawing.svg", 0.1)


def _svg(inside: str, root: str = "") -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100" {root}>{inside}</svg>'


LINE = '<line x1="10" y1="10" x2="40" y2="40"/>'


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        ('<path d="M 0 0 L 1 1 garbage"/>', "must be a command of SVG paths with its numbers, and no more"),
        ('<path d="M0 0L1 1; L 2 2"/>', r"d = 'L1 1;': must be a command"),
        ('<path d="M 0 0 X 10 10"/>', r"d = 'X 10 10': must be a command"),
        ('<path d="L 10 10 20 20"/>', "must be path data that begins with M or m"),
        ('<path d="M 0 0 L 1"/>', r"d = 'L 1': must be a command"),
        ('<path d="M 0 0 A 5 5 0 2 0 9 9"/>', "must be a command"),
        ('<path d="M 10 10 A 1e9 1e9 0 0 0 40 40"/>', "has an arc too large to be computed exactly"),
        ('<path d="M 0 0 L 1e300 10"/>', "leaves the square of 10 m"),
        ('<path d="M 0 0 L 1e12 10"/>', "leaves the square of 10 m"),
        ('<line x2="5" y2="5" transform="skewX(90)"/>', "leaves the square of 10 m"),
        ('<rect width="50" height="20" rx="20"/>', r"<rect> rx = '20': must be 0: rounded corners are not read"),
        ('<rect width="-50" height="20"/>', r"<rect> width = '-50': must be 0 or more"),
        ('<circle cx="5" cy="5" r="-1"/>', r"<circle> r = '-1': must be 0 or more"),
        (f'<svg x="5" y="5" width="10" height="10">{LINE}</svg>', "<svg>.* is not read"),
        (f"<switch>{LINE}{LINE}</switch>", "<switch>.* is not read"),
        ("<frobnicate/>", "<frobnicate>.* is not read"),
        (LINE.replace("/>", ' style="transform:rotate(30deg)"/>'), "must not have a transform"),
        (f"<style>line {{ display: none }}</style>{LINE}", "<style>.* must not hide or move"),
        *(
            (LINE.replace("/>", f' transform="{words}"/>'), "transform = ")
            for words in ("rotate 30", "none", "foo rotate(30) bar", "scale(1,2,3)", "translate(1em,2%)", "rotate()")
        ),
        ('<line x1="0cm" x2="5cm"/>', r"<line> x1 = '0cm': must be a number, in user units"),
        ('<line x2="100%"/>', r"<line> x2 = '100%': must be a number, in user units"),
        ('<polyline points="10,10 20,20 h 30"/>', "must be plain numbers"),
        ('<polyline points="10,10 20,20 30"/>', "must be pairs of numbers"),
        (f'<g visibility="hidden">{LINE}</g>', "must not be on a group, in which shapes may be visible again"),
        ('<path d="M 0 0 A ' + "10 10 0 0 1 20 20 " * 40 + '7"/>', "must be a command of SVG paths"),
        ('<path d="M 0 0 A ' + "1" * 20000 + '"/>', "must be a command of SVG paths"),
        ('<polyline points="' + "1" * 20000 + 'x"/>', "must be plain numbers"),
        ('<line x2="' + "1" * 20000 + 'x"/>', "must be a number, in user units"),
        ('<path d="M 1,,2 3 4"/>', "must be a command of SVG paths"),
        ("<g>" * 3000 + LINE + "</g>" * 3000, "are more than 100 groups inside each other"),
    ],
)  # fmt: skip
def test_what_is_not_understood_exactly_is_refused(tmp_path: Path, inside: str, told: str) -> None:
    """The arm would draw something else than the file shows."""
    file = tmp_path / "drawing.svg"
    file.write_text(_svg(inside))
    with pytest.raises(FileInputError, match=told):
        strokes_of(file, 0.1)


@pytest.mark.parametrize("encoding", ["foo", "utf-32", "idna"])
def test_an_encoding_that_is_unknown_is_refused(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "drawing.svg"
    file.write_text(f'<?xml version="1.0" encoding="{encoding}"?>{_svg(LINE)}')
    with pytest.raises(FileInputError, match="must be an SVG, and is not XML"):
        strokes_of(file, 0.1)


def test_a_transform_of_the_whole_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "drawing.svg"
    file.write_text(_svg(LINE, 'transform="rotate(30)"'))
    with pytest.raises(FileInputError, match="must not be on <svg> itself"):
        strokes_of(file, 0.1)


@pytest.mark.parametrize(
    "unseen",
    [
        LINE.replace("/>", ' style="display:none"/>'),
        LINE.replace("/>", ' visibility="hidden"/>'),
        f'<g style="fill:red; display: none">{LINE}</g>',
        f'<e:path xmlns:e="an editor" d="M 0 0 L 9 9"/><defs>{LINE}</defs>',
        '<rect width="0" height="20"/><circle r="0"/><path d=""/><polygon points=""/>',
    ],
)
def test_what_svg_does_not_draw_is_left_out(tmp_path: Path, unseen: str) -> None:
    file = tmp_path / "drawing.svg"
    file.write_text(_svg(unseen + LINE))
    assert len(strokes_of(file, 0.1)) == 1


@pytest.mark.parametrize(
    "data",
    [
        "M10-10l.5.5-3e1,2",
        "m 1 1 h 3 4 v 5 z m 2,2 t 1 1",
        "M0 0a5 5 0 01.5 9a5,5,0,1,0,-9-.5z",
        "M1 2 3 4 5 6",
    ],
)
def test_the_grammar_of_paths_is_understood(tmp_path: Path, data: str) -> None:
    """Compact numbers, flags without spaces, repeated commands."""
    file = tmp_path / "drawing.svg"
    file.write_text(_svg(f'<path d="{data}"/>'))
    assert strokes_of(file, 0.1)


@pytest.mark.filterwarnings("error")
def test_a_curve_that_returns_on_itself_is_drawn_there_and_back(tmp_path: Path) -> None:
    file = tmp_path / "drawing.svg"
    file.write_text(_svg('<path d="M 10 10 Q 60 10 10 10"/>'))
    (stroke,) = strokes_of(file, 0.1)
    ends = np.array([end for piece in stroke.pieces for end in (piece.start, piece.end)])
    assert ends[:, 0].max() == pytest.approx(0.035, abs=1e-4)
    assert np.ptp(ends[:, 1]) < 1e-5
    np.testing.assert_allclose(ends[0], ends[-1], atol=1e-9)


@pytest.mark.parametrize("size", ['width="5cm" height="5cm"', 'width="100%" height="100%"'])
def test_without_a_view_box_the_size_is_in_user_units(tmp_path: Path, size: str) -> None:
    """Of 5 cm a drawing has some 189 units: read as 5, all of it would be 38 times as large."""
    file = tmp_path / "drawing.svg"
    file.write_text(f"<svg {size}>{LINE}</svg>")
    with pytest.raises(FileInputError, match="must be a number, in user units"):
        strokes_of(file, 0.1)


@pytest.mark.parametrize("hidden", ['display="none"', 'visibility="hidden"'])
def test_a_drawing_that_is_hidden_as_a_whole_is_refused(tmp_path: Path, hidden: str) -> None:
    file = tmp_path / "drawing.svg"
    file.write_text(_svg(LINE, hidden))
    with pytest.raises(FileInputError, match="<svg>"):
        strokes_of(file, 0.1)
