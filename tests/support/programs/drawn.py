"""Outlines drawn at random."""

from __future__ import annotations

import numpy as np

from arm.se3 import Array
from cell.program.outline import Outline, Piece, arc_through, line

SEEDS = range(30)


def some_outline(seed: int, count: int = 5) -> Outline:
    """Lines and arcs with corners between them, some 50 to 500 mm long each."""
    rng = np.random.default_rng([21, seed])
    pieces: list[Piece] = []
    at = rng.normal(0.0, 0.1, 3)
    for _ in range(count):
        end = at + _step(rng)
        via = (at + end) / 2.0 + rng.normal(0.0, 0.03, 3)
        pieces.append(line(at, end) if rng.random() < 0.5 else arc_through(at, via, end))
        at = end
    return Outline(tuple(pieces))


def _step(rng: np.random.Generator) -> Array:
    way = rng.normal(0.0, 1.0, 3)
    return np.asarray(way / np.linalg.norm(way) * rng.uniform(0.05, 0.2))
