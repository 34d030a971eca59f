"""Fit the sides of a cube's top as straight lines with one rotation, and compute the likelihood of each side's place.

A side's place is its position along its outward normal. `vision.occupancy.cube_side` computes the evidence of each
piece of a side for each place. All sides have the same rotation and blur, which are found first. Then each side is
evaluated with all its pieces together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.se3 import Array, Bools, frozen
from vision.occupancy.cube_side import (
    ACROSS,
    NOWHERE,
    Beside,
    Side,
    beside,
    beside_unseen,
    evidence,
    own_evidence,
)

PIECES = 8  # of a side
PLACES: Array = frozen(np.arange(-128, 129) * 0.0125e-3)  # m, of a side outwards
COARSE = slice(None, None, 4)
TURNS: Array = np.radians(np.linspace(-3.6, 3.6, 73))
FINER: Array = np.radians(np.linspace(-0.15, 0.15, 7))
ACCIDENT = 12.0  # log likelihood: largest evidence of one piece against a line
STRAY = 8.0  # log likelihood: a piece that disagrees more with the line is left out
LEAST_PIECES = 5
UNLIKE = 1.15  # smallest mean squared deviation of a sample: no image fits the model exactly
FAINT = 60.0  # log likelihood: largest evidence against a place
HOPELESS = 150.0  # log evidence below the best: no finer search between places that are worse than this
ROOM = 0.4e-3  # m, around a foot that may be mistaken for the side
LEAST_STEP = 4.0  # grey levels: a smaller step may be shading


@dataclass(frozen=True, eq=False)
class Around:
    """The surroundings of a side.

    Attributes:
        empty: profiles without the cube, (pieces, n); None if there is no such image.
        mouth, corner: expected place of the pocket's mouth, and of its wall's lower edge, m outwards; -inf: no pocket.
    """

    empty: Array | None
    mouth: float
    corner: float


@dataclass(frozen=True, eq=False)
class SidesFit:
    """Sides as straight lines of one rotation, with the likeliest blur.

    Attributes:
        blur: standard deviation, m.
        lines: the rotation and the lines.
        each: per side, log evidence of each single piece at the k coarse places, (k, pieces).
        besides: what the image shows beside each side.
    """

    blur: float
    lines: _Lines
    each: list[Array]
    besides: list[Beside]


def fit_sides(
    sides: Sequence[Side], around: Sequence[Around], light: float, lever: Array, blurs: Sequence[float]
) -> SidesFit:
    """Find blur and rotation, by the evidence of single pieces.

    Args:
        sides, around: four each, in the order of `vision.occupancy.cube_top.OUTWARD`.
        light: present brightness, relative to that of the image without the cube.
        lever: outward displacement of each piece of a side per rad of rotation, (pieces,) m.
        blurs: standard deviations to try, m.
    """
    places, fits = PLACES[COARSE, None], []
    for blur in blurs:
        besides = [
            beside_unseen(side.plate_grey, PIECES, at.mouth)
            if at.empty is None
            else beside(at.empty, at.mouth, at.corner, blur, light)
            for side, at in zip(sides, around, strict=True)
        ]
        each = [own_evidence(side, at, places, blur) for side, at in zip(sides, besides, strict=True)]
        fits.append(SidesFit(blur, straight_lines(each, lever), each, besides))
    return max(fits, key=lambda fit: fit.lines.worth)


def likelihoods(sides: Sequence[Side], fit: SidesFit, lever: Array) -> tuple[float, list[Array], list[float]]:
    """Return the rotation (rad); per side, its log likelihood at `PLACES` and its log likelihood ratio to no side."""
    turn = _refined(fit, sides, lever)
    nowhere = np.array([[-NOWHERE], [NOWHERE]]) + np.zeros(PIECES)
    of_sides, shown = [], []
    for side, at, one, line in zip(sides, fit.besides, fit.each, fit.lines.of_sides, strict=True):
        places = PLACES[COARSE]
        good = _agreeing(one, places, float(places[np.argmax(line)]) + turn * lever)
        log, left = _evidence_along(side, at, turn * lever, fit.blur, good)
        none = evidence(side, at, nowhere, fit.blur, good)[0].max()
        peaks, top = likely(log, side.foot)
        shown.append(float(log[top] - none) if _step(side, float(PLACES[top])) >= LEAST_STEP else 0.0)
        of_sides.append(peaks / max(UNLIKE, float(left[top])))
    return turn, of_sides, shown


def _evidence_along(side: Side, at: Beside, off: Array, blur: float, pieces: Bools) -> tuple[Array, Array]:
    """`evidence` at `PLACES`, with each piece offset by `off` m; interpolated between hopeless coarse places."""
    coarse = PLACES[COARSE]
    log, left = evidence(side, at, coarse[:, None] + off, blur, pieces)
    hopeful = np.convolve(log > log.max() - HOPELESS, np.ones(3), mode="same") > 0.0
    fine = np.interp(PLACES, coarse, hopeful) > 0.0
    logs, lefts = np.interp(PLACES, coarse, log), np.interp(PLACES, coarse, left)
    logs[fine], lefts[fine] = evidence(side, at, PLACES[fine, None] + off, blur, pieces)
    return logs, lefts


def likely(log: Array, foot: float) -> tuple[Array, int]:
    """Convert log evidence at `PLACES` to log likelihood, from `-FAINT` to 0 at the best place; return also its index.

    If the cube's face is visible beside the top, up to `foot` m outwards, there is a second peak: the foot mistaken for
    the side, and the face for the top. That peak is never the best place.
    """
    mistaken = (np.abs(PLACES + foot) < ROOM) & (foot > 2.0 * ROOM)
    top = int(np.argmax(np.where(mistaken, -np.inf, log)))
    return np.clip(log - log[top], -FAINT, 0.0), top


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight sides with one rotation: joint log likelihood, rotation in rad, log likelihood of each side."""

    worth: float
    turn: float
    of_sides: list[Array]


def straight_lines(each: Sequence[Array], lever: Array) -> _Lines:
    """Find the likeliest rotation of sides, by their pieces' evidence (k, pieces) at coarse places."""
    of_sides = [_rotated(np.maximum(one, one.max(axis=0) - ACCIDENT), lever) for one in each]
    worth = np.sum([log.max(axis=1) for log in of_sides], axis=0)
    best = int(np.argmax(worth))
    return _Lines(float(worth[best]), float(TURNS[best]), [log[best] for log in of_sides])


def _refined(fit: SidesFit, sides: Sequence[Side], lever: Array) -> float:
    """Refine the rotation (rad) by the evidence of whole sides near their lines."""
    every, near = np.ones(PIECES, dtype=bool), PLACES[COARSE][1] - PLACES[COARSE][0]
    turns = fit.lines.turn + FINER
    worth = np.zeros(len(turns))
    for side, at, line in zip(sides, fit.besides, fit.lines.of_sides, strict=True):
        places = float(PLACES[COARSE][np.argmax(line)]) + near * np.linspace(-1.5, 1.5, 7)
        along = places[:, None] + turns[:, None, None] * lever
        usual = replace(side, feet=np.array([side.foot]))
        log = evidence(usual, at, along.reshape(-1, PIECES), fit.blur, every)[0]
        worth += log.reshape(len(turns), -1).max(axis=1)
    return float(turns[np.argmax(worth)])


def _rotated(one: Array, lever: Array) -> Array:
    """Log likelihood (turns, k) of a side at coarse places with each of `TURNS`, from that of its pieces there."""
    places, low = PLACES[COARSE], one.min(axis=0)
    at = places + TURNS[:, None] * lever[:, None, None]
    pieces = [np.interp(at[j], places, one[:, j], left=low[j], right=low[j]) for j in range(PIECES)]
    return np.asarray(np.sum(pieces, axis=0))


def _agreeing(one: Array, places: Array, line: Array) -> Bools:
    """Which pieces agree with a line; a corner or the edge of a shadow may spoil single ones."""
    at = np.array([np.interp(line[j], places, one[:, j]) for j in range(PIECES)])
    off = one.max(axis=0) - at
    return np.asarray(off <= max(STRAY, float(np.sort(off)[LEAST_PIECES - 1])))


def _step(side: Side, place: float) -> float:
    """Largest difference between the top and what lies just beyond a place, grey levels."""
    usual, beyond = np.median(side.grey, axis=0), ACROSS - place
    inner, outer = usual[np.abs(beyond + 0.5e-3) < 0.2e-3], usual[np.abs(beyond - 0.5e-3) < 0.3e-3]
    return float(np.abs(outer - np.median(inner)).max()) if len(inner) and len(outer) else 0.0
