"""Why goals in a given order cannot be planned, as the data of `plan.failure`, as for transfers."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from arm.errors import ImpossibleError
from plan.failure import (
    AFTER_TIMING,
    LINE_BLOCKED,
    NO_WAY_ACROSS,
    OUT_OF_REACH,
    START_BLOCKED,
    Failure,
    Rejected,
)


def with_failure(error: ImpossibleError, arm: Collection[str]) -> ImpossibleError:
    """Return an error of `plan.program.sequence.planner` with `failure` in its data; `arm` names the arm's bodies."""
    failure = _failure(error, arm)
    return (
        error
        if failure is None
        else ImpossibleError(str(error), **{**error.data, "failure": failure.to_json()})
    )


def _failure(error: ImpossibleError, arm: Collection[str]) -> Failure | None:
    data, headline = error.data, str(error)
    target = data.get("target")
    stations = () if target is None else (str(target),)
    pair = data.get("pair")
    if pair is not None:
        body = next((name for name in pair if name not in arm), None)
        way = Rejected(
            str(data.get("step", target or "start")),
            str(data.get("reason", headline)),
            pair=(str(pair[0]), str(pair[1])),
            distance_mm=1e3 * float(data["distance_m"]),
            required_mm=1e3 * float(data["clearance_m"]) if "clearance_m" in data else None,
        )
        return Failure(_kind(error), way.where, stations, headline, (way,), body)
    if target is None:
        return None
    joint, excess, outside = data.get("joint"), data.get("excess_rad"), data.get("outside_m")
    if excess is None and str(data.get("constraint", "")).endswith("limit"):
        excess = 0.0  # a line that stops at a joint limit; a joint that is too slow has no excess
    way = Rejected(
        f"target {target}",
        headline,
        joint=joint,
        excess_deg=None if joint is None or excess is None else float(np.degrees(excess)),
        outside_mm=1e3 * float(outside) if outside else None,
    )
    return Failure(OUT_OF_REACH, way.where, stations, headline, (way,))


def _kind(error: ImpossibleError) -> str:
    """Return the kind of failure of an error about two bodies that are too near."""
    if "proved_m" in error.data:
        return AFTER_TIMING
    if "reason" in error.data:
        return LINE_BLOCKED if error.data.get("role") else NO_WAY_ACROSS
    return LINE_BLOCKED if "target" in error.data else START_BLOCKED
