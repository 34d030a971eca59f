"""The page of a study: maps of what varied, coloured by the answer, and what the numbers say."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from cell.files.study import Study, Varied
from cell.report.html import Table, render
from cell.study.answer.answers import NUMBERS, Best, Influence, Points, shares, shown, unsaid

_FEWEST, _CELLS, _IN_CELL = 6, 32, 4  # cells of a map along each side, and points that one should have
_SHOWN = 1500  # points that can be clicked
_REASONS = 9  # that have a colour of their own; all others share one
_MOST_MAPS = 15


def study_page(
    study: Study,
    points: Points,
    best: Best | None,
    matters: list[Influence],
    values_of: Callable[[int], tuple[Any, ...]],
    named: str,
) -> str:
    """Return the page.

    Args:
        study, points: with all points.
        best, matters: see `cell.study.answer.answers`.
        values_of: returns the values of a point by its number.
        named: path of the study file as the user gave it, for commands.
    """
    passed, computed, count = int(points.ok.sum()), int(points.computed.sum()), len(points.ok)
    figures = [(str(count), "points"), (str(passed), f"passed: {', '.join(study.stages)}")]
    of_all = "of all" if computed == count else f"of the {computed} that were computed"
    figures.append((f"{100.0 * passed / max(1, computed):.1f} %", of_all))
    reasons = Table(
        ("reason", "points", "share"),
        [(why, str(count), f"{100.0 * share:.1f} %") for why, count, share in shares(points)],
    )
    influence = Table(
        ("value", "index", "95 % interval"),
        [(one.name, f"{one.share:.3f}", f"{one.low:.3f} to {one.high:.3f}") for one in matters],
    )
    return render(
        "study/answer/study.html.j2",
        title=f"Study {study.file.stem}",
        figures=figures,
        reasons=reasons,
        influence=influence,
        unsaid=unsaid(study, points, matters),
        best=None if best is None else _best_table(study, best),
        best_command=None if best is None else f"a465 study {shlex.quote(named)} --point {best.number}",
        data=json.dumps(_maps(study, points, values_of, named), separators=(",", ":")).replace(
            "<", "\\u003c"
        ),
    )


def _best_table(study: Study, best: Best) -> Table:
    rows = [(one.name, *shown(one, best, k)) for k, one in enumerate(study.vary)]
    return Table(("value", "most robust", "from", "to"), rows)


def _maps(
    study: Study, points: Points, values_of: Callable[[int], tuple[Any, ...]], named: str
) -> dict[str, Any]:
    """Return what the page draws: a map for each two values, and points to click."""
    most = int(np.clip(np.sqrt(len(points.ok) / _IN_CELL), _FEWEST, _CELLS))
    axes = [_axis(one, most) for one in study.vary]
    at = [_cell_of(points.values[:, k], axis) for k, axis in enumerate(axes)]
    pairs = list(combinations(range(len(axes)), 2))[:_MOST_MAPS] or [(0, 0)]
    rng = np.random.default_rng(study.seed)
    n = len(points.ok)
    some = np.sort(rng.choice(n, _SHOWN, replace=False)) if n > _SHOWN else np.arange(n)
    return {
        "axes": axes,
        "reasons": list(points.reasons[:_REASONS]) + (["other"] if len(points.reasons) > _REASONS else []),
        "maps": [
            {"x": i, "y": j} | _map(points, at[i], at[j], axes[i]["cells"], axes[j]["cells"])
            for i, j in pairs
        ],
        "points": [_point(points, int(k), values_of) for k in some],
        "study": shlex.quote(named),
    }


def _axis(one: Varied, most: int) -> dict[str, Any]:
    """A side of a map; a grid with few values has a cell for each."""
    if one.grid:
        cells = len(one.grid) if len(one.grid) <= _CELLS else most
        ends = {"low": one.grid[0], "high": one.grid[-1]}
        return {"name": one.name, "cells": cells, "grid": cells == len(one.grid)} | ends
    return {"name": one.name, "cells": most, "grid": False, "low": one.low, "high": one.high}


def _cell_of(scaled: npt.NDArray[np.float64], axis: dict[str, Any]) -> npt.NDArray[np.int64]:
    """In which cell of a side each value lies."""
    cells: int = axis["cells"]
    if axis["grid"]:
        return np.rint(scaled * (cells - 1)).astype(np.int64)
    return np.minimum(scaled * cells, cells - 1).astype(np.int64)


def _map(
    points: Points, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], wide: int, high: int
) -> dict[str, Any]:
    at, size = y * wide + x, wide * high
    count = np.bincount(at, minlength=size)
    passed = np.bincount(at, points.ok, size)
    why = np.minimum(points.reason, _REASONS)
    kinds = int(why.max(initial=-1)) + 1
    by = np.zeros((max(kinds, 1), size))
    for kind in range(kinds):
        by[kind] = np.bincount(at[why == kind], minlength=size)
    found: dict[str, Any] = {
        "n": count.tolist(),
        "ok": passed.astype(int).tolist(),
        "why": np.where(by.max(axis=0) > 0, by.argmax(axis=0), -1).tolist(),
    }
    for name in NUMBERS:
        known = np.isfinite(points.numbers[name]) & points.ok
        if known.any():
            total = np.bincount(at[known], points.numbers[name][known], size)
            of = np.bincount(at[known], minlength=size)
            found[name] = [None if not k else round(float(t / k), 3) for t, k in zip(total, of, strict=True)]
    return found


def _point(points: Points, k: int, values_of: Callable[[int], tuple[Any, ...]]) -> list[Any]:
    return [
        k,
        [round(float(v), 4) for v in points.values[k]],
        list(values_of(k)),
        int(min(points.reason[k], _REASONS)),
    ]
