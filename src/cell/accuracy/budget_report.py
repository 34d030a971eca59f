"""Error budgets of placements as text, table and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cell.accuracy.insertion import percent
from cell.accuracy.placement import PlacementBudget
from cell.console import Console

UNKNOWN = "the cell has no calibration with a covariance, so the errors of the placements are not known; "
UNKNOWN += "accuracy.least_insertion is not checked"
HEADER = ("cube", "to", "offset mm", "height mm", "tilt deg", "enters %", "mostly due to")
_SHOWN = 3  # sources in a row of the table


def print_budgets(budgets: Sequence[PlacementBudget], console: Console) -> None:
    """Print one row per placement."""
    if not budgets:
        console.say(UNKNOWN)
        return
    console.table(
        HEADER, [(b.cube, b.target, *_millimetres(b), percent(b.insertion), _sources(b)) for b in budgets]
    )


def budget_rows(budgets: Sequence[PlacementBudget]) -> list[tuple[str, ...]]:
    """Return the same rows as texts, with the columns of `HEADER`."""
    return [
        (b.cube, b.target, *(f"{value:.2f}" for value in _millimetres(b)), percent(b.insertion), _sources(b))
        for b in budgets
    ]


def _millimetres(budget: PlacementBudget) -> tuple[float, float, float]:
    return 1e3 * budget.sideways, 1e3 * budget.height, float(np.degrees(budget.tilt))


def budget_words(budgets: Sequence[PlacementBudget]) -> str:
    """The least certain placement in one line; "" for none."""
    if not budgets:
        return ""
    worst = min(budgets, key=lambda b: (b.insertion, -b.sideways))
    return (
        f"every cube enters its pocket with a probability of {percent(worst.insertion)} %; the least certain one has "
        f"an RMS offset of {1e3 * worst.sideways:.2f} mm ({_sources(worst)})"
    )


def budget_to_json(budget: PlacementBudget) -> dict[str, Any]:
    """Return the object of ``--json``."""
    return {
        "cube": budget.cube,
        "from": budget.source,
        "to": budget.target,
        "sideways_mm": 1e3 * budget.sideways,
        "height_mm": 1e3 * budget.height,
        "tilt_deg": float(np.degrees(budget.tilt)),
        "insertion_probability": budget.insertion,
        "covariance": budget.covariance.tolist(),
        "sources": {
            name: {"sideways_mm": 1e3 * source.sideways, "share": source.share}
            for name, source in budget.sources.items()
        },
    }


def _sources(budget: PlacementBudget) -> str:
    shown = list(budget.sources.items())[:_SHOWN]
    return ", ".join(f"{name} {100.0 * source.share:.0f} %" for name, source in shown if source.share > 0.005)
