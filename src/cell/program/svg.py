"""Strokes of an SVG drawing as lines and arcs in the plane: x to the right, y up, from the lower left corner.

Shapes, paths, groups and their transforms are read; colours and widths do not matter. What would draw a line and is not
understood exactly is refused, as the arm would draw something else. Curves are followed by biarcs within `TOLERANCE`.
``svg.path`` parses the path data (SVG 1.1, chapter 8), once its grammar has been checked.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from svg.path import Arc, Close, Line, Move, parse_path

from arm.errors import FileInputError, InputError
from arm.io.storage import read_bytes
from arm.numerics.products import mul, norm
from arm.se3 import Array, frozen
from cell.program.biarcs import arcs_along
from cell.program.outline import SAME, Outline, Piece
from cell.program.outline import Line as Straight

TOLERANCE = 2e-6  # m, largest distance of a curve from the arcs that follow it
# Of a curve's extent; where its derivative is less, its direction is that of a chord over twice _NEAR of its parameter.
_VANISHES, _NEAR = 1e-6, 1e-4
_MOST = 10.0  # m, largest coordinate on the plane
_DEEPEST = 100  # groups inside each other
_NUMBER = re.compile(r"[\s,]*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_FLAG = re.compile(r"[\s,]*([01])")
_ARC = (*3 * (_NUMBER,), _FLAG, _FLAG, *2 * (_NUMBER,))
_TRANSFORM = re.compile(r"[\s,]*(\w+)\s*\(([^()]*)\)")
_COMMAND = re.compile(r"([A-DF-Za-df-z])([^A-DF-Za-df-z]*)")  # e and E are of numbers
_TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2}  # numbers of a command
_COUNTS = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3)} | dict.fromkeys(
    ("skewX", "skewY"), (1,)
)
_SVG = ("", "http://www.w3.org/2000/svg")  # elements of other namespaces are an editor's own
_SHAPES = ("path", "line", "polyline", "polygon", "rect", "circle", "ellipse")
_SKIPPED = {
    *(
        "defs",
        "symbol",
        "clipPath",
        "mask",
        "marker",
        "pattern",
        "linearGradient",
        "radialGradient",
        "filter",
    ),
    *("metadata", "title", "desc", "script", "view", "style"),
}


def strokes_of(path: Path, width: float) -> tuple[Outline, ...]:
    """Return the strokes of a drawing that is `width` m wide, in the order of the file.

    Raises:
        FileInputError: not an SVG, without a size, with an element that is not read, or without strokes.
    """
    try:
        root = ElementTree.fromstring(read_bytes(path, "SVG"))
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the others are of its encoding
        raise FileInputError(
            path, "", None, f"must be an SVG, and is not XML: {error}", "export it as SVG"
        ) from error
    if _tag(root) != "svg":
        raise FileInputError(path, "", f"<{_tag(root)}>", "must be an SVG, whose first element is <svg>")
    _require_plain(path, root, "svg")
    if _hidden(path, root):
        raise FileInputError(path, "<svg> display", "none", "must not hide the whole drawing")
    if root.get("transform"):
        rule = "must not be on <svg> itself; move it to a group"
        raise FileInputError(path, "transform", root.get("transform"), rule)
    left, top, wide, high = _view_box(path, root)
    scale = width / wide
    # y is down in an SVG
    to_plane = np.array([[scale, 0.0, -scale * left], [0.0, -scale, scale * (top + high)], [0.0, 0.0, 1.0]])
    found = tuple(stroke for data, A in _paths(path, root, to_plane) for stroke in _strokes(path, data, A))
    if not found:
        raise FileInputError(
            path, "", None, "has no strokes: no path, line, polyline, polygon, rect or ellipse"
        )
    return found


def _tag(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _style(element: Element) -> dict[str, str]:
    """Return the declarations of a style attribute."""
    pairs = (one.partition(":") for one in element.get("style", "").split(";"))
    return {name.strip().lower(): value.strip().lower() for name, _, value in pairs}


def _hidden(path: Path, element: Element) -> bool:
    """Whether SVG draws nothing of an element.

    Raises:
        FileInputError: it is a group in which elements may be visible again.
    """
    style = _style(element)
    if "none" in (style.get("display"), element.get("display")):
        return True
    invisible = bool({style.get("visibility"), element.get("visibility")} & {"hidden", "collapse"})
    if invisible and _tag(element) not in _SHAPES:
        rule = "must not be on a group, in which shapes may be visible again; hide the shapes, or use display"
        raise FileInputError(path, f"<{_tag(element)}> visibility", "hidden", rule)
    return invisible


def _require_plain(path: Path, element: Element, tag: str) -> None:
    """Refuse styles that move an element, or hide or move any.

    Raises:
        FileInputError: there is one.
    """
    if "transform" in _style(element):
        rule = "must not have a transform; use the attribute transform"
        raise FileInputError(path, "style", element.get("style"), rule)
    if tag == "style" and re.search(r"display|visibility|transform", "".join(element.itertext())):
        rule = "must not hide or move anything (display, visibility, transform); save as plain SVG in your editor"
        raise FileInputError(path, "", "<style>", rule)


def _scanned(text: str, *kinds: re.Pattern[str]) -> list[float] | None:
    """Return the numbers of a text that is the kinds in turn, any number of times; None if it is anything else.

    One after the other, since a single expression for all of them would try every division of their digits.
    """
    text, found, at = text.strip(), list[float](), 0
    bare = "".join(text.split())
    if ",," in bare or bare.startswith(",") or bare.endswith(","):
        return None
    while at < len(text):
        one = kinds[len(found) % len(kinds)].match(text, at)
        if one is None:
            return None
        found.append(float(one[1]))
        at = one.end()
    return found if len(found) % len(kinds) == 0 else None


def _numbers(path: Path, name: str, text: str) -> list[float]:
    """Return the numbers of an attribute that has nothing else.

    Raises:
        FileInputError: it has.
    """
    found = _scanned(text, _NUMBER)
    if found is None:
        rule = "must be plain numbers, with commas or spaces between them"
        raise FileInputError(path, name, text[:60], rule)
    return found


def _length(path: Path, element: Element, name: str, least: float = -np.inf) -> float:
    """Return an attribute in user units, 0 if there is none.

    Raises:
        FileInputError: it has another unit, or is less than `least`.
    """
    text = element.get(name, "0")
    found = _scanned(text.strip().removesuffix("px"), _NUMBER)
    if found is None or len(found) != 1:
        rule = "must be a number, in user units; other units and % are not read here"
        raise FileInputError(path, f"<{_tag(element)}> {name}", text[:60], rule)
    if not found[0] >= least:
        raise FileInputError(path, f"<{_tag(element)}> {name}", text[:60], f"must be {least:g} or more")
    return found[0]


def _view_box(path: Path, root: Element) -> tuple[float, float, float, float]:
    box = _numbers(path, "viewBox", root.get("viewBox", ""))
    if not box:  # then the size is that of the drawing in user units
        box = [0.0, 0.0, *(_length(path, root, name) for name in ("width", "height"))]
    if len(box) != 4 or not (box[2] > 0.0 and box[3] > 0.0):
        raise FileInputError(path, "viewBox", root.get("viewBox"), "must be left, top, width and height")
    return box[0], box[1], box[2], box[3]


def _paths(path: Path, element: Element, A: Array, depth: int = 0) -> Iterator[tuple[str, Array]]:
    """Yield the path data of all shapes, each with its affine map to the plane (3, 3)."""
    if depth > _DEEPEST:
        raise FileInputError(
            path, "", "<g>", f"are more than {_DEEPEST} groups inside each other; ungroup some"
        )
    for child in element:
        if not isinstance(child.tag, str) or child.tag.rpartition("}")[0].lstrip("{") not in _SVG:
            continue
        tag = _tag(child)
        _require_plain(path, child, tag)
        if tag in _SKIPPED or (tag in (*_SHAPES, "g", "a") and _hidden(path, child)):
            continue
        if tag not in (*_SHAPES, "g", "a"):
            raise FileInputError(path, "", f"<{tag}>", "is not read; convert it to paths in your editor")
        of_child = mul(A, _transform(path, child.get("transform", "")))
        if tag in ("g", "a"):
            yield from _paths(path, child, of_child, depth + 1)
        elif data := _data(path, child, tag):
            yield data, of_child


def _transform(path: Path, text: str) -> Array:
    """Return the affine map (3, 3) of a transform attribute.

    Raises:
        FileInputError: it has anything else than the six transforms with their numbers.
    """
    A: Array = np.eye(3)
    for name, inside in _TRANSFORM.findall(text):
        v = _numbers(path, "transform", inside)
        if len(v) not in _COUNTS.get(name, ()):
            break
        A = mul(A, _affine(name, v))
    else:
        if not _TRANSFORM.sub("", text).strip():
            return A
    rule = "must be matrix, translate, scale, rotate, skewX or skewY with their numbers"
    raise FileInputError(path, "transform", text[:60], rule)


def _affine(name: str, v: list[float]) -> Array:
    match name:
        case "matrix":
            a, b, c, d, e, f = v
            return np.array([[a, c, e], [b, d, f], [0, 0, 1]])
        case "translate":
            return np.array([[1, 0, v[0]], [0, 1, v[1] if len(v) > 1 else 0], [0, 0, 1]])
        case "scale":
            return np.diag([v[0], v[1] if len(v) > 1 else v[0], 1.0])
        case "rotate":
            c, s = np.cos(np.radians(v[0])), np.sin(np.radians(v[0]))
            about = np.array([[1, 0, v[1]], [0, 1, v[2]], [0, 0, 1.0]]) if len(v) > 1 else np.eye(3)
            back = np.array([[1, 0, -v[1]], [0, 1, -v[2]], [0, 0, 1.0]]) if len(v) > 1 else np.eye(3)
            return mul(mul(about, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])), back)
        case "skewX":
            return np.array([[1, np.tan(np.radians(v[0])), 0], [0, 1, 0], [0, 0, 1]])
        case "skewY":
            return np.array([[1, 0, 0], [np.tan(np.radians(v[0])), 1, 0], [0, 0, 1]])
    raise KeyError(name)


def _data(path: Path, shape: Element, tag: str) -> str:
    """Return the path data that draws a shape; "" for one that draws no line.

    Raises:
        FileInputError: an attribute is not understood exactly.
    """

    def of(*names: str, least: float = -np.inf) -> list[float]:
        return [_length(path, shape, name, least) for name in names]

    match tag:
        case "path":
            return _checked(path, shape.get("d", ""))
        case "line":
            x, y, u, v = of("x1", "y1", "x2", "y2")
            return f"M {x} {y} L {u} {v}"
        case "polyline" | "polygon":
            points = _numbers(path, "points", shape.get("points", ""))
            if len(points) % 2:
                raise FileInputError(path, "points", shape.get("points", "")[:60], "must be pairs of numbers")
            return f"M {' '.join(map(repr, points))}{' Z' if tag == 'polygon' else ''}" if points else ""
        case "rect":
            x, y = of("x", "y")
            w, h, rx, ry = of("width", "height", "rx", "ry", least=0.0)
            if rx or ry:
                name = "rx" if rx else "ry"
                rule = "must be 0: rounded corners are not read; convert the rectangle to a path"
                raise FileInputError(path, f"<rect> {name}", shape.get(name), rule)
            return f"M {x} {y} h {w} v {h} h {-w} Z" if w and h else ""
        case _:
            x, y = of("cx", "cy")
            a, b = of("r", "r", least=0.0) if tag == "circle" else of("rx", "ry", least=0.0)
            return f"M {x - a} {y} a {a} {b} 0 1 0 {2 * a} 0 a {a} {b} 0 1 0 {-2 * a} 0 Z" if a and b else ""


def _checked(path: Path, data: str) -> str:
    """Return path data after a check of its grammar: the parser leaves out what it does not understand.

    Raises:
        FileInputError: a command is unknown or lacks numbers, or the first one is not M or m.
    """
    commands = _COMMAND.findall(data)
    if (data.strip() and _COMMAND.sub("", data).strip()) or (commands and commands[0][0] not in "Mm"):
        raise FileInputError(path, "d", data[:60], "must be path data that begins with M or m")
    for letter, inside in commands:
        kind = letter.upper()
        numbers = _scanned(inside, *(_ARC if kind == "A" else (_NUMBER,)))
        takes = len(_ARC) if kind == "A" else _TAKES.get(kind)
        closes = kind == "Z" and not inside.strip()
        if not (closes or (takes and numbers and len(numbers) % takes == 0)):
            shown = f"{letter}{inside}".strip()[:60]
            raise FileInputError(
                path, "d", shown, "must be a command of SVG paths with its numbers, and no more"
            )
    return data


def _strokes(path: Path, data: str, A: Array) -> Iterator[Outline]:
    """Yield the strokes of path data, mapped to the plane."""
    try:
        segments = list(parse_path(data))
    except (ValueError, IndexError, AssertionError, OverflowError) as error:  # the first is the parser's own
        raise FileInputError(path, "d", data[:60], f"is no path data: {error}") from error
    pieces: list[Piece] = []
    for segment in segments:
        if isinstance(segment, Move):
            if pieces:
                yield Outline(tuple(pieces))
            pieces = []
        else:
            _require_drawable(path, data, segment, A)
            try:
                pieces += _pieces(segment, A)
            except InputError as error:
                raise FileInputError(path, "d", data[:60], f"cannot be followed: {error}") from error
            if isinstance(segment, Close):
                if pieces:
                    yield Outline(tuple(pieces))
                pieces = []
    if pieces:
        yield Outline(tuple(pieces))


def _require_drawable(path: Path, data: str, segment: Any, A: Array) -> None:
    """Require that a segment is within reach of any arm, and ends where its data say.

    Raises:
        FileInputError: it is not, or does not.
    """
    ends = (segment.start, segment.end, *(segment.point(u) for u in (0.0, 0.25, 0.5, 0.75, 1.0)))
    at = np.array([mul(A, np.array([z.real, z.imag, 1.0]))[:2] for z in ends])
    if not (np.abs(at) < _MOST).all():
        raise FileInputError(
            path, "d", data[:60], f"leaves the square of {_MOST:g} m around the lower left corner"
        )
    if np.abs(at[[0, 1]] - at[[2, -1]]).max() > SAME:
        raise FileInputError(path, "d", data[:60], "has an arc too large to be computed exactly; use a line")


def _pieces(segment: Any, A: Array) -> tuple[Piece, ...]:
    """Return the lines and arcs of a segment, mapped to the plane; none if it has no length."""

    def point(u: float) -> Array:
        z = segment.point(u)
        return np.append(mul(A, np.array([z.real, z.imag, 1.0]))[:2], 0.0)

    def direction(u: float) -> Array:
        z = _tangent(segment, u)
        d = np.append(mul(A[:2, :2], np.array([z.real, z.imag])), 0.0)
        if norm(d) <= _VANISHES * extent:
            before, after = point(max(u - _NEAR, 0.0)), point(min(u + _NEAR, 1.0))
            d = after - before if norm(after - before) > 0.0 else point(u) - before  # it turns back there
        return np.asarray(d / norm(d))

    start, end = point(0.0), point(1.0)
    if isinstance(segment, Line | Close) or (isinstance(segment, Arc) and not _is_round(segment)):
        return (Straight(frozen(start), frozen(end)),) if norm(end - start) > SAME else ()
    extent = max(norm(point(u) - start) for u in (0.25, 0.5, 0.75, 1.0))
    if extent <= SAME:
        return ()
    return arcs_along(point, direction, TOLERANCE)


def _is_round(arc: Arc) -> bool:
    """Whether an elliptic arc is none that SVG draws as a line."""
    return arc.start != arc.end and arc.radius.real > 0.0 and arc.radius.imag > 0.0


def _tangent(segment: Any, u: float) -> complex:
    """Return the derivative of a segment's point by its parameter; that of the library is not of an ellipse."""
    if not isinstance(segment, Arc):
        return complex(segment.tangent(u))
    angle, turned = np.radians(segment.theta + segment.delta * u), np.radians(segment.rotation)
    along = complex(-segment.radius.real * np.sin(angle), segment.radius.imag * np.cos(angle))
    sense = float(np.sign(segment.delta)) * segment.radius_scale
    return sense * along * complex(np.cos(turned), np.sin(turned))
