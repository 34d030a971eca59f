"""Strokes of an SVG drawing as lines and arcs in the plane: x to the right, y up, from the lower left corner.

Shapes, paths, groups and their transforms are read; colours, widths, texts and images are not. Curves are followed by
biarcs within `TOLERANCE`. ``svg.path`` parses the path data (SVG 1.1, chapter 8).
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

from arm.errors import FileInputError
from arm.io.storage import read_bytes
from arm.numerics.products import mul, norm
from arm.se3 import Array, frozen
from cell.program.biarcs import arcs_along
from cell.program.outline import SAME, Outline, Piece
from cell.program.outline import Line as Straight

TOLERANCE = 2e-6  # m, largest distance of a curve from the arcs that follow it
# Of a curve's chord; where its derivative is less, its direction is that of a chord over twice _NEAR of its parameter.
_VANISHES, _NEAR = 1e-6, 1e-4
_TRANSFORM = re.compile(r"\s*,?\s*(\w+)\s*\(([^)]*)\)")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_SKIPPED = ("defs", "symbol", "clipPath", "mask", "marker", "pattern", "style", "metadata", "title", "desc")
_UNREAD = ("use", "text", "image", "foreignObject")


def strokes_of(path: Path, width: float) -> tuple[Outline, ...]:
    """Return the strokes of a drawing that is `width` m wide, in the order of the file.

    Raises:
        FileInputError: not an SVG, without a size, with an element that is not read, or without strokes.
    """
    try:
        root = ElementTree.fromstring(read_bytes(path, "SVG"))
    except ElementTree.ParseError as error:
        raise FileInputError(path, "", None, f"is not XML: {error}") from error
    if _tag(root) != "svg":
        raise FileInputError(path, "", f"<{_tag(root)}>", "must be an SVG, whose first element is <svg>")
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


def _numbers(text: str | None) -> list[float]:
    return [float(word) for word in _NUMBER.findall(text or "")]


def _view_box(path: Path, root: Element) -> tuple[float, float, float, float]:
    box = _numbers(root.get("viewBox"))
    if not box:
        size = _numbers(root.get("width"))[:1] + _numbers(root.get("height"))[:1]
        box = [0.0, 0.0, *size]
    if len(box) != 4 or not (box[2] > 0.0 and box[3] > 0.0):
        raise FileInputError(path, "viewBox", root.get("viewBox"), "must be left, top, width and height")
    return box[0], box[1], box[2], box[3]


def _paths(path: Path, element: Element, A: Array) -> Iterator[tuple[str, Array]]:
    """Yield the path data of all shapes, each with its affine map to the plane (3, 3)."""
    for child in element:
        tag = _tag(child)
        if tag in _SKIPPED or not isinstance(child.tag, str) or child.get("display") == "none":
            continue
        if tag in _UNREAD:
            raise FileInputError(path, "", f"<{tag}>", "is not read; convert it to paths in your editor")
        of_child = mul(A, _transform(path, child.get("transform", "")))
        if tag in ("g", "a", "svg", "switch"):
            yield from _paths(path, child, of_child)
        elif data := _data(child, tag):
            yield data, of_child


def _transform(path: Path, text: str) -> Array:
    """Return the affine map (3, 3) of a transform attribute."""
    A: Array = np.eye(3)
    for name, inside in _TRANSFORM.findall(text):
        v = _numbers(inside)
        try:
            A = mul(A, _affine(name, v))
        except (IndexError, ValueError, KeyError) as error:
            rule = "must be matrix, translate, scale, rotate, skewX or skewY with their numbers"
            raise FileInputError(path, "transform", text, rule) from error
    return A


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


def _data(shape: Element, tag: str) -> str:
    """Return the path data that draws a shape; "" for an element that draws no line."""

    def of(*names: str) -> list[float]:
        return [(_numbers(shape.get(name)) or [0.0])[0] for name in names]

    match tag:
        case "path":
            return shape.get("d", "")
        case "line":
            x, y, u, v = of("x1", "y1", "x2", "y2")
            return f"M {x} {y} L {u} {v}"
        case "polyline" | "polygon":
            points = shape.get("points", "").strip()
            return f"M {points}{' Z' if tag == 'polygon' else ''}" if points else ""
        case "rect":
            x, y, w, h = of("x", "y", "width", "height")
            return f"M {x} {y} h {w} v {h} h {-w} Z"
        case "circle" | "ellipse":
            x, y = of("cx", "cy")
            a, b = of("r", "r") if tag == "circle" else of("rx", "ry")
            return f"M {x - a} {y} a {a} {b} 0 1 0 {2 * a} 0 a {a} {b} 0 1 0 {-2 * a} 0 Z"
    return ""


def _strokes(path: Path, data: str, A: Array) -> Iterator[Outline]:
    """Yield the strokes of path data, mapped to the plane."""
    try:
        segments = list(parse_path(data))
    except (ValueError, IndexError, AssertionError) as error:  # the first is the parser's own
        raise FileInputError(path, "d", data[:60], f"is no path data: {error}") from error
    pieces: list[Piece] = []
    for segment in segments:
        if isinstance(segment, Move):
            if pieces:
                yield Outline(tuple(pieces))
            pieces = []
        else:
            pieces += _pieces(segment, A)
            if isinstance(segment, Close):
                if pieces:
                    yield Outline(tuple(pieces))
                pieces = []
    if pieces:
        yield Outline(tuple(pieces))


def _pieces(segment: Any, A: Array) -> tuple[Piece, ...]:
    """Return the lines and arcs of a segment, mapped to the plane; none if it has no length."""

    def point(u: float) -> Array:
        z = segment.point(u)
        return np.append(mul(A, np.array([z.real, z.imag, 1.0]))[:2], 0.0)

    def direction(u: float) -> Array:
        z = _tangent(segment, u)
        d = np.append(mul(A[:2, :2], np.array([z.real, z.imag])), 0.0)
        if norm(d) < _VANISHES * norm(point(1.0) - point(0.0)):
            d = point(min(u + _NEAR, 1.0)) - point(max(u - _NEAR, 0.0))
        return np.asarray(d / norm(d))

    start, end = point(0.0), point(1.0)
    if isinstance(segment, Line | Close) or (isinstance(segment, Arc) and not _is_round(segment)):
        return (Straight(frozen(start), frozen(end)),) if norm(end - start) > SAME else ()
    if max(norm(point(u) - start) for u in (0.25, 0.5, 0.75, 1.0)) <= SAME:
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
