"""Lists of points, with arcs between them, as program and wire files have them; and wire files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.errors import A465Error
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import tables
from arm.robot.shapes import Body
from arm.se3 import Array
from cell.config.bodies import PLACE, read_body, require_names_differ
from cell.program.outline import Outline, Piece, arc_about, arc_through, line

WORK = "work"  # kind of bodies on the workpiece


class _ArcKeys(Keys):
    to: Array = key("to_mm", PLACE)
    centre: Array | None = key("centre_mm", PLACE, None)
    via: Array | None = key("through_mm", PLACE, None)


def _pieces(node: Node) -> Sequence[Piece]:
    places = node.items()
    if len(places) < 2 or isinstance(places[0].value, dict):
        raise node.error("must begin with a point, and have at least two")
    at, pieces = np.asarray(places[0].read(PLACE)), list[Piece]()
    for place in places[1:]:
        try:
            piece, at = _piece(at, place)
        except A465Error as error:
            raise error if error.data.get("file") else place.error(f"cannot be used: {error}") from error
        pieces.append(piece)
    return pieces


def _piece(start: Array, place: Node) -> tuple[Piece, Array]:
    """Return the piece from a point to the next place, and its end."""
    if not isinstance(place.value, dict):
        end = place.read(PLACE)
        return line(start, end), end
    arc = _ArcKeys.read(place)
    if (arc.centre is None) == (arc.via is None):
        raise place.error("must have centre_mm or through_mm besides to_mm")
    if arc.centre is not None:
        return arc_about(start, arc.centre, arc.to), arc.to
    return arc_through(start, np.asarray(arc.via), arc.to), arc.to


_SHORTEST = 5e-3  # m, of the line of a wire

POINTS = Rule("a list of points x, y, z in mm, and of arcs to a point", lambda n: Outline(tuple(_pieces(n))))
"""Rule of a path of lines and arcs.

An arc is a table with its end ``to_mm``, and with ``centre_mm`` (the shorter arc about it) or ``through_mm``.
"""


class WireKeys(Keys, file="a wire file"):
    """Keys of a wire file."""

    outline: Outline | None = key("line_mm", POINTS, None)
    bodies: tuple[Body, ...] = key("bodies", tables(lambda node: read_body(node, WORK)), [])


@dataclass(frozen=True, eq=False)
class Wire:
    """A thing on a workpiece, with a line that paths may follow.

    Attributes:
        file: its file.
        outline: its line, such as the centre line of a wire, from its foot to its free end; None if it has none.
        bodies: with poses in the frame of the workpiece.
    """

    file: Path
    outline: Outline | None
    bodies: tuple[Body, ...]


def read_wire(path: Path) -> Wire:
    """Read a wire file.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    root = Node.of_toml(path, "wire", "tool")
    keys = WireKeys.read(root)
    if keys.bodies:
        require_names_differ(root["bodies"], keys.bodies)
    if keys.outline is not None and keys.outline.length < _SHORTEST:
        rule = f"is {1e3 * keys.outline.length:.3g} mm long; must be {1e3 * _SHORTEST:g} mm or longer"
        raise root.error_at("line_mm", rule, "is it in metres?")
    return Wire(path, keys.outline, keys.bodies)
