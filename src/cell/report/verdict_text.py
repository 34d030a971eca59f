"""Verdict of a calibration, for the terminal and for JSON."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from calib.model.verdict import Judged
from cell.console import Console


def print_verdict(c: Judged, console: Console, advice: Iterable[str] = ()) -> None:
    """Print the remarks, lines of advice, and the verdict with its reasons."""
    notes = (f"note: {remark}" for remark in c.remarks)
    reasons = (f"  {reason}" for reason in c.reasons)
    for line in (*notes, *advice, "accepted" if c.accepted else "refused:", *reasons):
        console.say(line)


def verdict_json(c: Judged) -> dict[str, Any]:
    """Return verdict, reasons and remarks for ``--json``."""
    verdict = "accepted" if c.accepted else "refused"
    return {"verdict": verdict, "reasons": list(c.reasons), "remarks": list(c.remarks)}
