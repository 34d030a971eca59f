"""Draws the pictures of docs/certificates.md.

python docs/pictures/certificates.py
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
INK, BLUE, RED, GREY = "#222", "#2563a8", "#b3261e", "#9aa0a6"


def main() -> None:
    """Both pictures."""
    (HERE / "certificate-chords.svg").write_text(chords())
    (HERE / "certificate-plane.svg").write_text(plane())


def chords() -> str:
    """A point turned about the inner axis first, then about the outer one."""
    inner, outer = np.array([60.0, 215.0]), np.array([230.0, 185.0])
    p0 = np.array([370.0, 215.0])
    first, second = -0.3, -0.55
    p1 = turned(p0, inner, first)
    outer1 = turned(outer, inner, first)
    p2 = turned(p1, outer1, second)
    return svg(
        460,
        260,
        [
            line([inner, outer, p0], GREY, 5),
            line([inner, outer1, p1], GREY, 5, "6 5"),
            line([outer1, p2], GREY, 5),
            line([turned(p0, inner, u * first) for u in np.linspace(0, 1, 30)], BLUE, 1.5, "3 3"),
            line([turned(p1, outer1, u * second) for u in np.linspace(0, 1, 30)], RED, 1.5, "3 3"),
            line([p0, p1], BLUE, 2.5),
            line([p1, p2], RED, 2.5),
            *(dot(at, INK) for at in (inner, outer, outer1)),
            *(dot(at, BLUE) for at in (p0, p1, p2)),
            text(inner + (-20, 24), "inner axis k"),
            text(outer + (-30, 26), "outer axis"),
            text(p0 + (10, 5), "p(q)"),
            text((p0 + p1) / 2 + (10, 4), "&#8804; r&#8342; |&#916;q&#8342;|", BLUE),
            text((p1 + p2) / 2 + (-2, -10), "&#8804; r |&#916;q|", RED),
            text(p2 + (-16, -12), "p(q')"),
        ],
    )


def plane() -> str:
    """Two bodies, the plane between them, the outer one as it moves, and the normal tilted by that motion."""
    box = np.array([[70, 150], [330, 150], [330, 220], [70, 220]], dtype=float)
    body = np.array([[150, 60], [250, 48], [256, 98], [156, 110]], dtype=float)
    moved = np.array([turned(p, np.array([40.0, 40.0]), 0.13) for p in body]) + (60.0, -32.0)
    normal = np.array([0.0, -1.0])
    tilted = turned(normal, np.zeros(2), -0.13)  # as far as the body turns, the other way
    lowest = max(body, key=lambda p: float(-tilted @ p))
    along = np.array([-tilted[1], tilted[0]])
    tip = lowest + 40 * tilted
    foot = np.array([156.0, 150.0])
    return svg(
        460,
        260,
        [
            shape(box, "#e8eaed", INK),
            shape(body, "#d2e3f7", BLUE),
            shape(moved, "none", BLUE, "5 4"),
            line([(30, 150), (430, 150)], RED, 1.5, "8 4"),
            line([(30, 110), (430, 110)], RED, 1.5, "8 4"),
            line([foot, foot + 40 * normal], RED, 2.5),
            line([foot + 40 * normal + (-4, 9), foot + 40 * normal, foot + 40 * normal + (4, 9)], RED, 2.5),
            line([lowest - 60 * along, lowest + 66 * along], GREY, 1.5, "3 3"),
            line([lowest, tip], GREY, 2.5),
            line(
                [tip + turned(np.array(v), np.zeros(2), -0.13) for v in ((-4, 9), (0, 0), (4, 9))], GREY, 2.5
            ),
            dot(lowest, GREY),
            text(lowest + 68 * along + (4, 4), "n + &#931; dq n &#215; d", GREY),
            text(foot + (8, -14), "n", RED),
            text(np.array([180.0, 190.0]), "a, fixed"),
            text(np.array([186.0, 84.0]), "b at q"),
            text(np.array([318.0, 40.0]), "b at q'"),
            text(np.array([200.0, 135.0]), "least n&#183;p over b, less most over a", RED),
        ],
    )


def turned(p: np.ndarray, about: np.ndarray, angle: float) -> np.ndarray:
    """A point turned about another, pixels."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(about + np.array([[c, -s], [s, c]]) @ (p - about))


def svg(width: int, height: int, parts: Sequence[str]) -> str:
    """The whole file."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
    head += f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">'
    return (
        "\n".join([head, f'<rect width="{width}" height="{height}" fill="white"/>', *parts, "</svg>"]) + "\n"
    )


def line(
    points: Sequence[np.ndarray | tuple[float, float]], colour: str, width: float, dash: str = ""
) -> str:
    """Open line through points."""
    return f'<polyline points="{_points(points)}" fill="none" {_stroke(colour, width, dash)}/>'


def shape(points: np.ndarray, fill: str, colour: str, dash: str = "") -> str:
    """Closed and filled."""
    return f'<polygon points="{_points(points)}" fill="{fill}" {_stroke(colour, 1.5, dash)}/>'


def dot(at: np.ndarray, colour: str) -> str:
    """A round mark."""
    return f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="4.5" fill="{colour}"/>'


def text(at: np.ndarray, words: str, colour: str = INK) -> str:
    """Words that begin at a place."""
    return f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" fill="{colour}">{words}</text>'


def _points(points: Sequence[np.ndarray | tuple[float, float]] | np.ndarray) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _stroke(colour: str, width: float, dash: str) -> str:
    return f'stroke="{colour}" stroke-width="{width:g}"' + (f' stroke-dasharray="{dash}"' if dash else "")


if __name__ == "__main__":
    main()
