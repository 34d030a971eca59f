"""Lists of points with arcs, and wire files: read exactly, or refused with their place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.node import Node
from cell.program.outline import Arc, Line
from cell.program.points import POINTS, read_wire


def test_points_and_arcs_become_exact_pieces() -> None:
    """Wire D: the arc about (35, 0, 105), once by its centre and once by a point of it."""
    corner = [-15, 0, 105]
    by_centre = {"centre_mm": [35, 0, 105], "to_mm": [35, 0, 155]}
    half = 35 - 50 / np.sqrt(2)
    by_point = {"through_mm": [half, 0, 105 + 50 / np.sqrt(2)], "to_mm": [35, 0, 155]}
    found = []
    for arc in (by_centre, by_point):
        outline = POINTS.read(Node(Path("x"), "points_mm", [[-15, 0, 45], corner, arc, [85, 0, 155]]))
        assert [type(piece) for piece in outline.pieces] == [Line, Arc, Line]
        assert len(outline.corners()) == 0
        assert outline.length == pytest.approx(0.06 + 0.05 * np.pi / 2 + 0.05)
        found.append(outline.at(np.linspace(0.0, outline.length, 50)))
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([], r"line_mm.*must begin with a point, and have at least two"),
        ([[0, 0, 0]], r"must begin with a point, and have at least two"),
        ([{"to_mm": [0, 0, 1], "centre_mm": [0, 0, 0]}, [0, 0, 5]], r"must begin with a point"),
        ([[0, 0, 0], [0, 0]], r"line_mm\[1\] = \[0, 0\]: must be 3 numbers in mm from -5000 to 5000"),
        ([[0, 0, 0], [0, 0, 0]], r"line_mm\[1\].*two points of a path are the same, \(0, 0, 0\)"),
        ([[0, 0, 0], {"to_mm": [0, 0, 9]}], r"line_mm\[1\].*must have centre_mm or through_mm besides to_mm"),
        (
            [[0, 0, 0], {"to_mm": [0, 0, 9], "centre_mm": [0, 1, 0]}],
            r"line_mm\[1\].*1.000 and 9.055 mm from its centre",
        ),
        ([[0, 0, 0], {"to_mm": [0, 0, 9], "via_mm": [0, 1, 0]}], r"line_mm\[1\].via_mm.*is not a known key"),
        ([[0, 0, 0], {"to_mm": [0, 0, 0.05], "centre_mm": [0, 0, 0]}], r"line_mm\[1\].*is at its ends"),
        ([[0, 0, 0], {"centre_mm": [0, 1, 0]}], r"line_mm\[1\].to_mm: is missing"),
        (7, r"line_mm = 7: must be a list"),
    ],
)
def test_wrong_lines_are_refused_with_their_place(tmp_path: Path, value: object, message: str) -> None:
    file = tmp_path / "w.toml"
    file.write_text(f"line_mm = {_toml(value)}\n")
    with pytest.raises(InputError, match=message):
        read_wire(file)


def _toml(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_toml(v) for v in value)}]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + " }"
    return str(value)


def test_a_wire_file_has_bodies_with_different_names(tmp_path: Path) -> None:
    file = tmp_path / "w.toml"
    box = '[[bodies]]\nname = "bar"\ncentre_mm = [0, 0, 100]\nsize_mm = [10, 10, 200]\n'
    file.write_text(box)
    wire = read_wire(file)
    assert wire.outline is None
    assert [body.name for body in wire.bodies] == ["bar"]
    file.write_text(box + box)
    with pytest.raises(InputError, match=r"bodies\[1\].name = 'bar': is used twice"):
        read_wire(file)
    file.write_text("line_mm = [[0, 0, 0], [0, 0, 0.08], [0.07, 0, 0.15]]\n")
    with pytest.raises(
        InputError, match=r"line_mm.*: is 0.179 mm long; must be 5 mm or longer \(is it in metres\?"
    ):
        read_wire(file)
