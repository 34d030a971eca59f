"""What a study found: shares, reasons, the best point and how far it may move, and what matters how much."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.io.rules import is_number
from arm.se3 import Array
from cell.files.study import COLUMNS, RESULTS, Study, Varied
from cell.study.question.points import scaled_points
from cell.study.work.chunks import Chunk

ASIDE = "not computed"  # reason of the points of a chunk that was set aside
NUMBERS = ("margin_deg", "hole_std_mm", "clearance_mm", "motion_s", "insertion")
_BINS, _FEWEST = 12, 2  # of a range, for what matters how much, and points that a bin has on average
_DRAWS, _MOST = 200, 20_000  # of the bootstrap, and points that it draws from
_CONFIDENT = 1.96  # standard deviations on each side of an interval of 95 %


@dataclass(frozen=True)
class Points:
    """All points of a study as columns, in the order of their numbers.

    Attributes:
        values: (n, d) of what varies, each scaled so that its range or grid is 0 to 1.
        ok: (n,) whether all stages passed.
        reason: (n,) index into `reasons`; -1 for none.
        reasons: by how many points share them.
        numbers: (n,) columns of `NUMBERS`, NaN where unknown.
    """

    values: Array
    ok: npt.NDArray[np.bool_]
    reason: npt.NDArray[np.int32]
    reasons: tuple[str, ...]
    numbers: dict[str, Array]

    @property
    def computed(self) -> npt.NDArray[np.bool_]:
        """Of which points a stage said anything, (n,); the chunks of the others were set aside."""
        aside = self.reasons.index(ASIDE) if ASIDE in self.reasons else len(self.reasons)
        found: npt.NDArray[np.bool_] = self.reason != aside
        return found


@dataclass(frozen=True)
class Best:
    """The most robust point: the one that passed and is furthest from every refused one and from the ends of ranges.

    Attributes:
        number: of its point.
        values: as in the files.
        room: its distance from them, as a share of the ranges and grids.
        between: for each value the least and the largest between which no computed point was refused, if all values
            change at once. None for a value that is not a number.
    """

    number: int
    values: tuple[Any, ...]
    room: float
    between: tuple[tuple[float, float] | None, ...]


@dataclass(frozen=True)
class Influence:
    """How much of the variance of the answer the bin of one value explains by itself.

    Attributes:
        name: of the value.
        share: first-order sensitivity index of whether a point passes, 0 to 1.
        low, high: its 95 % confidence interval.
    """

    name: str
    share: float
    low: float
    high: float


def read_points(study: Study, chunks: Iterable[tuple[Chunk, str | None]]) -> Points:
    """Read the tables of all chunks, one after the other; None: it was set aside, so nobody knows its points."""
    at = {name: len(study.vary) + 1 + k for k, name in enumerate(RESULTS)}
    named = {"": -1}
    ok, reason = ([np.zeros(0, kind)] for kind in (np.bool_, np.int32))
    values, numbers = [np.zeros((0, len(study.vary)))], [np.zeros((len(NUMBERS), 0))]
    for chunk, table in chunks:
        values.append(scaled_points(study, chunk.first, chunk.count))
        if table is None:
            ok.append(np.zeros(chunk.count, dtype=bool))
            reason.append(np.full(chunk.count, named.setdefault(ASIDE, len(named) - 1), dtype=np.int32))
            numbers.append(np.full((len(NUMBERS), chunk.count), np.nan))
            continue
        cells = list(zip(*csv.reader(io.StringIO(table, newline="")), strict=True))
        ok.append(np.array(cells[at["ok"]]) == "1")
        whys = [named.setdefault(why, len(named) - 1) for why in cells[at["reason"]]]
        reason.append(np.array(whys, dtype=np.int32))
        numbers.append(np.array([[float(cell or "nan") for cell in cells[at[name]]] for name in NUMBERS]))
    whole = np.concatenate(reason)
    count = np.bincount(whole[whole >= 0], minlength=len(named) - 1)
    order = sorted(named.keys() - {""}, key=lambda why: (-count[named[why]], why))
    place = np.array([order.index(why) for why in list(named)[1:]] + [-1], dtype=np.int32)
    return Points(
        np.concatenate(values),
        np.concatenate(ok),
        place[whole],
        tuple(order),
        dict(zip(NUMBERS, np.concatenate(numbers, axis=1), strict=True)),
    )


def best_of(study: Study, points: Points, values_of: Any) -> Best | None:
    """Return the passed point that is furthest from what was refused; None if none passed.

    The distance is the largest change of any value, as a share of its range or grid (Chebyshev); so is that to the end
    of a range. A range with steps ends one step beyond its last value. Ties are broken by the larger margin of the
    joints, then by the lower number.

    Args:
        study, points: with all points.
        values_of: returns the values of a point by its number.
    """
    from scipy.spatial import cKDTree

    good = np.flatnonzero(points.ok)
    if not len(good):
        return None
    inside = points.values[good]
    room = np.full(len(good), np.inf)
    for k, one in enumerate(study.vary):
        if one.low is not None:  # beyond the end of a range nothing is known
            step = 1.0 / (len(one.grid) - 1) if one.grid else 0.0
            room = np.minimum(room, np.minimum(inside[:, k], 1.0 - inside[:, k]) + step)
    bad = points.values[~points.ok]
    if len(bad):
        room = np.minimum(room, cKDTree(bad).query(inside, p=np.inf)[0])
    margin = np.nan_to_num(points.numbers["margin_deg"][good], nan=0.0)
    k = int(np.lexsort((good, -margin, -np.round(room, 9)))[0])
    number, free = int(good[k]), float(room[k])
    return Best(
        number,
        values_of(number),
        min(free, 1.0),
        tuple(_between(one, float(inside[k, j]), free) for j, one in enumerate(study.vary)),
    )


def _between(one: Varied, scaled: float, room: float) -> tuple[float, float] | None:
    """Between which values one may change; of a grid, the last ones before the distance of a refused point."""
    if not one.grid and one.low is not None and one.high is not None:
        width, at = one.high - one.low, one.low + scaled * (one.high - one.low)
        return max(one.low, at - room * width), min(one.high, at + room * width)
    if not all(is_number(value) for value in one.grid):
        return None
    last = len(one.grid) - 1
    steps = last if math.isinf(room) else math.ceil(room * last - 1e-9) - 1
    middle = round(scaled * last)
    there = one.grid[max(0, middle - steps) : min(last, middle + steps) + 1]
    return float(min(there)), float(max(there))


def influences(study: Study, points: Points) -> list[Influence]:
    """Return how much each value matters for whether a point passes, the most first.

    A value whose bins have fewer than `_FEWEST` points each is left out: nothing tells its influence from chance.

    First-order indices from given data: the variance between bins of a value over the whole, less what chance makes of
    it (Saltelli and others, Global Sensitivity Analysis, 2008, section 1.2); the intervals are the standard deviation
    of the bootstrap, which covers where its percentiles do not.
    """
    there = np.flatnonzero(points.computed)
    if _all_alike(points):
        return []
    rng = np.random.default_rng(study.seed)
    some = there if len(there) <= _MOST else rng.choice(there, _MOST, replace=False)
    passed = points.ok[some].astype(float)
    draws = [rng.integers(0, len(some), len(some)) for _ in range(_DRAWS)]
    found = []
    for k, one in enumerate(study.vary):
        bins = len(one.grid) or _BINS
        scaled = points.values[some, k]
        bin_of = np.rint(scaled * (bins - 1)) if one.grid else np.minimum(scaled * bins, bins - 1)
        at = bin_of.astype(int)
        if len(at) < _FEWEST * len(np.unique(at)):
            continue
        # drawn again, points repeat and chance looks like influence: only the spread of these estimates is good
        spread = float(np.std([_index(at[draw], passed[draw], bins) for draw in draws]))
        share = _index(at, passed, bins)
        ends = np.clip([share, share - _CONFIDENT * spread, share + _CONFIDENT * spread], 0.0, 1.0)
        found.append(Influence(one.name, *ends.tolist()))
    return sorted(found, key=lambda one: -one.share)


def unsaid(study: Study, points: Points, matters: Sequence[Influence]) -> str:
    """Say why there are no indices, or of which values there are none; "" if of all."""
    if _all_alike(points):
        which = "All points passed" if points.ok.any() else "No point passed"
        return f"{which}: there is no variance to explain."
    known = {one.name for one in matters}
    left = [one.name for one in study.vary if one.name not in known]
    least = f"{_FEWEST * _BINS} points for a range, {_FEWEST} for each value of a grid"
    return f"Too few points for an index of {', '.join(left)}: it needs {least}." if left else ""


def _all_alike(points: Points) -> bool:
    return len(set(points.ok[points.computed].tolist())) < 2


def shown(one: Varied, best: Best, k: int) -> tuple[str, str, str]:
    """Return a best point's value, by its number in the study, and between which values it may change, for people.

    The ends are rounded inwards, with four digits of the width of the range.
    """
    value, ends = best.values[k], best.between[k]
    if ends is None:
        return str(value), "", ""
    first, *_, last = one.grid or (one.low, one.high)
    whole = all(isinstance(number, int) for number in one.grid) and bool(one.grid)
    digits = 0 if whole else max(0, 3 - math.floor(math.log10(last - first)))
    unit = 10.0**-digits
    least, most = math.ceil(ends[0] / unit - 1e-6) * unit, math.floor(ends[1] / unit + 1e-6) * unit
    return f"{value:.{digits}f}", f"{least:.{digits}f}", f"{most:.{digits}f}"


def _index(at: npt.NDArray[np.int64], passed: Array, bins: int) -> float:
    count = np.bincount(at, minlength=bins)
    there = count > 0
    mean = np.bincount(at, passed, bins)[there] / count[there]
    whole = float(np.sum((passed - passed.mean()) ** 2))
    if whole == 0.0 or there.sum() < 2 or len(passed) <= there.sum():
        return 0.0
    between = float(np.sum(count[there] * (mean - passed.mean()) ** 2))
    within = (whole - between) / (len(passed) - int(there.sum()))
    return (between - (int(there.sum()) - 1) * within) / whole


def shares(points: Points) -> list[tuple[str, int, float]]:
    """Return the reasons of refusals with the number of points and their share, the most frequent first."""
    counts = np.bincount(points.reason[points.reason >= 0], minlength=len(points.reasons))
    return [(why, int(n), float(n / len(points.ok))) for why, n in zip(points.reasons, counts, strict=True)]


def columns(study: Study) -> Sequence[str]:
    """Return the header of the table."""
    return (COLUMNS[0], *(one.name for one in study.vary), *COLUMNS[1:])
