"""The four sides of a cube's top as straight lines of one turn: how likely each lies where.

`vision.occupancy.cube_side` says for a piece of a side how likely it lies at each place. All sides turn
together, so one turn is searched, and the lens's blur with it; then each side is judged by all of its pieces together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from arm.se3 import Array, frozen
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
PLACES: Array = frozen(np.arange(-128, 129) * 0.0125e-3)  # m out, of a side
COARSE = slice(None, None, 4)
TURNS: Array = np.radians(np.linspace(-3.6, 3.6, 73))
FINER: Array = np.radians(np.linspace(-0.15, 0.15, 7))
ACCIDENT = 12.0  # log likelihood: so unlikely is a piece at most
STRAY = 8.0  # log likelihood: a piece that disagrees more with the others is left out
LEAST_PIECES = 5
UNLIKE = 1.15  # squared deviations of a sample: no picture is quite like the model
FAINT = 60.0  # log likelihood: so unlikely is a place at most
HOPELESS = 150.0  # log evidence: between places that are less likely than this there is no better one
ROOM = 0.4e-3  # m, about where a foot may be taken for a side
LEAST_STEP = 4.0  # grey levels: less may be a shading of the surface


@dataclass(frozen=True, eq=False)
class Around:
    """What is known of the surroundings of a side.

    Attributes:
        empty: profiles of the empty place, (pieces, n); None if it was not seen empty.
        mouth, corner: where the pocket's mouth should be seen, and where its wall begins, m out; -inf: no pocket.
    """

    empty: Array | None
    mouth: float
    corner: float


@dataclass(frozen=True, eq=False)
class SidesFit:
    """Sides as straight lines of one turn, under the blur that makes them likeliest.

    Attributes:
        blur: m.
        lines: the turn and the lines.
        each: log evidence of each piece by itself at coarse places, (k, pieces) a side.
        besides: what is seen beside each side.
    """

    blur: float
    lines: _Lines
    each: list[Array]
    besides: list[Beside]


def fit_sides(
    sides: Sequence[Side],
    around: Sequence[Around],
    light: float,
    lever: Array,
    blurs: Sequence[float],
) -> SidesFit:
    """Find blur and turn, by each piece's evidence.

    Args:
        sides, around: four, as `vision.occupancy.cube_top.OUTWARD` has them.
        light: how bright the place is now, of what it was when it was empty.
        lever: how far out each piece of a side comes with a turn of 1 rad, (pieces,) m.
        blurs: that are tried, m.
    """
    places = PLACES[COARSE]
    every = np.broadcast_to(places[:, None], (len(places), PIECES))
    best: SidesFit | None = None
    for blur in blurs:
        besides = [
            beside_unseen(side.plate_grey, PIECES, at.mouth)
            if at.empty is None
            else beside(at.empty, at.mouth, at.corner, blur, light)
            for side, at in zip(sides, around, strict=True)
        ]
        each = [own_evidence(side, at, every, blur) for side, at in zip(sides, besides, strict=True)]
        lines = straight_lines(each, lever)
        if best is None or lines.worth > best.lines.worth:
            best = SidesFit(blur, lines, each, besides)
    if best is None:
        raise ValueError("no blur to try")
    return best


def likelihoods(sides: Sequence[Side], fit: SidesFit, lever: Array) -> tuple[float, list[Array], list[float]]:
    """The turn, rad, each side's log likelihood at `PLACES`, and how much likelier it is than no side, log."""
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


def _evidence_along(
    side: Side, at: Beside, off: Array, blur: float, pieces: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """`evidence` at `PLACES` with pieces `off` from their line: at all of them only where it is not hopeless."""
    coarse = PLACES[COARSE]
    log, left = evidence(side, at, coarse[:, None] + off, blur, pieces)
    hopeful = np.convolve(log > log.max() - HOPELESS, np.ones(3), mode="same") > 0.0
    fine = np.interp(PLACES, coarse, hopeful) > 0.0
    logs, lefts = np.interp(PLACES, coarse, log), np.interp(PLACES, coarse, left)
    logs[fine], lefts[fine] = evidence(side, at, PLACES[fine, None] + off, blur, pieces)
    return logs, lefts


def likely(log: Array, foot: float) -> tuple[Array, int]:
    """Log likelihood at `PLACES`, from `-FAINT` to 0 at its best one, from log evidence; and which that is.

    Where a face is seen beside the top, up to `foot` m out, its foot may be taken for the side and the face for the
    top: that other peak is not counted as the best one.
    """
    mistaken = (np.abs(PLACES + foot) < ROOM) & (foot > 2.0 * ROOM)
    top = int(np.argmax(np.where(mistaken, -np.inf, log)))
    return np.clip(log - log[top], -FAINT, 0.0), top


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight sides of one turn: how likely they are together, the turn in rad, and each side's likelihood."""

    worth: float
    turn: float
    of_sides: list[Array]


def straight_lines(each: Sequence[Array], lever: Array) -> _Lines:
    """The turn at which sides are most likely, by their pieces' evidence (k, pieces) at coarse places."""
    places = PLACES[COARSE]
    capped = [np.maximum(one, one.max(axis=0) - ACCIDENT) for one in each]
    best: _Lines | None = None
    for turn in TURNS:
        of_sides = [_along(one, places + turn * lever[:, None]) for one in capped]
        worth = float(sum(float(np.max(one)) for one in of_sides))
        if best is None or worth > best.worth:
            best = _Lines(worth, float(turn), of_sides)
    if best is None:
        raise ValueError("no turn to try")
    return best


def _refined(fit: SidesFit, sides: Sequence[Side], lever: Array) -> float:
    """A finer turn, rad, by the evidence of whole sides near their lines."""
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


def _along(one: Array, at: Array) -> Array:
    """Likelihood of a side whose pieces lie at places (pieces, k), by their own (k, pieces) at coarse places; (k,)."""
    places, low = PLACES[COARSE], one.min(axis=0)
    pieces = [np.interp(at[j], places, one[:, j], left=low[j], right=low[j]) for j in range(PIECES)]
    return np.asarray(np.sum(pieces, axis=0))


def _agreeing(one: Array, places: Array, line: Array) -> npt.NDArray[np.bool_]:
    """Which pieces agree with a line: a corner or a shadow's edge beside one makes it go its own way."""
    at = np.array([np.interp(line[j], places, one[:, j]) for j in range(PIECES)])
    off = one.max(axis=0) - at
    return np.asarray(off <= max(STRAY, float(np.sort(off)[LEAST_PIECES - 1])))


def _step(side: Side, place: float) -> float:
    """The largest difference of grey between the top and what is just beyond a place, grey levels."""
    usual, beyond = np.median(side.grey, axis=0), ACROSS - place
    inner, outer = usual[np.abs(beyond + 0.5e-3) < 0.2e-3], usual[np.abs(beyond - 0.5e-3) < 0.3e-3]
    return float(np.abs(outer - np.median(inner)).max()) if len(inner) and len(outer) else 0.0
