"""Writes scenes/hoop/wires: the five wires as boxes that contain their bars, and their centre lines.

`python docs/wires.py` writes the files anew; a test compares them with what this module makes. The coordinates are
those of the laboratory's drawings.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from arm.io.storage import data_file
from arm.numerics.angles import arcsin, arctan2
from arm.se3 import Array
from cell.program.frames import first_x, transported
from cell.program.outline import Arc, Line, Outline, Piece, arc_about, line

HALF = 0.005  # m, of the bar's square section
ARC_STEP = np.radians(7.5)  # of an arc for each of its boxes
FOLDER = data_file("scenes/hoop/wires")
FOOT = (
    21.9,
    -21.9,
    5.0,
)  # mm, of the triangular foot plate: half of its straight edge, y of its apex and of that edge
FOOT_STEPS = (-21.9, -15.2, -8.5, -1.8, 5.0)
_MM = 1e-3

POINTS: dict[str, list[tuple[float, ...] | dict[str, tuple[float, ...]]]] = {
    "a": [(0, 0, 0), (0, 0, 200)],
    "b": [(0, 0, 0), (0, 0, 80), (70, 0, 150), (70, 0, 200)],
    "c": [(0, 0, 0), (0, 0, 50), (-50, 0, 100), (-50, -50, 150), (-50, -50, 200)],
    "d": [
        *((0, 0, 0), (0, 0, 30), (-15, 0, 45), (-15, 0, 105)),
        {"centre_mm": (35, 0, 105), "to_mm": (35, 0, 155)},
        (85, 0, 155),
    ],
    "e": [
        *((0, 0, 0), (0, 0, 30), (-17.32, 0, 60), (-17.32, -50, 110)),
        {"centre_mm": (-17.32, 0, 110), "to_mm": (-17.32, 0, 160)},
        *((32.68, 50, 160), (32.68, 100, 160)),
    ],
}
"""Centre lines from the foot to the free end, mm; z up from the top of the foot plate. An arc is a table."""


def centre_line(wire: str) -> Outline:
    """Return the centre line of a wire, m."""
    at, pieces = np.zeros(3), list[Piece]()
    for place in POINTS[wire][1:]:
        if isinstance(place, dict):
            end = _MM * np.array(place["to_mm"])
            pieces.append(arc_about(at, _MM * np.array(place["centre_mm"]), end))
        else:
            end = _MM * np.array(place)
            pieces.append(line(at, end))
        at = end
    return Outline(tuple(pieces))


def sections(outline: Outline) -> list[Array]:
    """Return the orientation (3, 3) of the bar's section at the start of each piece.

    Where two bars are mitred their sections are one in the plane between them, so each is the one before it, turned by
    the least angle.
    """
    starts, turned = [0], [outline.pieces[0].directions(np.zeros(1))[0]]
    for piece in outline.pieces:
        steps = np.linspace(0.0, piece.length, 1 if isinstance(piece, Line) else 200)
        turned += list(piece.directions(steps))
        starts.append(len(turned))
    z = np.array(turned)
    R = transported(z, first_x(z[0]))
    return [R[k] for k in starts[:-1]]


def boxes(outline: Outline) -> list[tuple[str, Array, Array, Array]]:
    """Return name, centre (3,), size (3,) and orientation (3, 3) of boxes that contain the bar, m."""
    found = []
    turns = outline.turns()
    for k, (piece, R) in enumerate(zip(outline.pieces, sections(outline), strict=True)):
        ends = [_mitre(outline, k - 1, turns), _mitre(outline, k, turns)]
        if isinstance(piece, Line):
            first, last = -ends[0], piece.length + ends[1]
            middle = piece.at(np.array([(first + last) / 2.0]))[0]
            size = np.array([2 * HALF, 2 * HALF, last - first])
            found.append((f"bar {k + 1}", middle, size, R))
        else:
            found += _of_arc(piece, R, ends, k)
    return found


def _mitre(outline: Outline, joint: int, turns: Array) -> float:
    """Return how far a bar reaches beyond the point where it is mitred, m: its edges lie sqrt(2) HALF from its axis."""
    if not 0 <= joint < len(turns):
        return 0.0
    return float(np.sqrt(2.0) * HALF * np.tan(turns[joint] / 2.0))


def _of_arc(arc: Arc, R: Array, ends: list[float], k: int) -> list[tuple[str, Array, Array, Array]]:
    found = []
    axis = np.cross(arc.outward, arc.ahead)
    count = int(np.ceil(arc.angle / ARC_STEP - 1e-9))
    corners = np.array([R @ (HALF * np.array([i, j, 0.0])) for i in (-1, 1) for j in (-1, 1)])
    for n in range(count):
        angles = arc.angle * np.linspace(n, n + 1, 21) / count
        middle = arc.angle * (n + 0.5) / count
        turned = _about(axis, middle) @ R
        points = np.array(
            [
                arc.centre + _about(axis, a) @ (arc.radius * arc.outward + corner)
                for a in angles
                for corner in corners
            ]
        )
        local = (points - arc.centre) @ turned
        low, high = local.min(axis=0), local.max(axis=0)
        low[2] -= ends[0] if n == 0 else 0.0
        high[2] += ends[1] if n == count - 1 else 0.0
        found.append((f"arc {k + 1}.{n + 1}", arc.centre + turned @ ((low + high) / 2.0), high - low, turned))
    return found


def _about(axis: Array, angle: float) -> Array:
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K)


def _shown(values: Array, digits: int = 4) -> str:
    return f"[{', '.join(f'{round(float(v), digits) + 0.0:g}' for v in values)}]"


def _point(place: tuple[float, ...] | dict[str, tuple[float, ...]]) -> str:
    if isinstance(place, dict):
        inside = ", ".join(f"{key} = {_shown(np.array(value))}" for key, value in place.items())
        return f"{{ {inside} }}"
    return _shown(np.array(place))


def text_of(wire: str) -> str:
    """Return the text of a wire's file."""
    lines = [
        f"# Wire {wire.upper()} of the laboratory on its foot: z up from the plate's top, origin on the bar's axis.",
        "# docs/wires.py makes this file. The bar is 10 x 10 mm; at a corner two bars meet in a mitre joint.",
        "line_mm = [  # centre line, from the foot to the free end",
        *(f"  {_point(place)}," for place in POINTS[wire]),
        "]",
    ]
    for number, (low, high) in enumerate(pairwise(FOOT_STEPS), start=1):  # of the triangle, along y
        wide = 2.0 * FOOT[0] * (high - FOOT[1]) / (FOOT[2] - FOOT[1])
        lines += ["", "[[bodies]]", f'name = "foot {number}"']
        lines += [f"centre_mm = [0, {_shown(np.array([(low + high) / 2.0]))[1:-1]}, -1.25]"]
        lines += [f"size_mm = {_shown(np.array([wide, high - low, 2.5]) + 1e-3)}"]
    for name, centre, size, R in boxes(centre_line(wire)):
        roll, pitch, yaw = arctan2(R[2, 1], R[2, 2]), -arcsin(R[2, 0]), arctan2(R[1, 0], R[0, 0])
        turned = np.degrees(np.array([roll, pitch, yaw]))
        lines += ["", "[[bodies]]", f'name = "{name}"', f"centre_mm = {_shown(centre / _MM)}"]
        lines += [f"size_mm = {_shown(size / _MM + 1e-3)}", f"rpy_deg = {_shown(turned)}"]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for name in POINTS:
        (Path(FOLDER) / f"{name}.toml").write_text(text_of(name))
