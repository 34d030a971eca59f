"""Why a task cannot be planned, as data: what fails where, and what stands against every way there is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from arm.errors import ImpossibleError
from plan.cartesian.reachability import LineChoice

OUT_OF_REACH = "out of reach"
LINE_BLOCKED = "line blocked"
NO_WAY_ACROSS = "no way across"
START_BLOCKED = "start blocked"
AFTER_TIMING = "clearance after timing"


@dataclass(frozen=True)
class Rejected:
    """One way that was rejected, and what stands against it.

    Attributes:
        where: ``line at 03-04/1``, ``from 01-02/1 to 03-04/1``, ``start``, or the name of a step.
        reason: in words.
        yaw, branch: of the way, where it is one of a place.
        joint: that goes `excess_deg` beyond its limit, or that would have to turn too fast (`excess_deg` is None).
        outside_mm: by how much the line leaves what the links reach.
        pair: the two bodies that come nearest, `distance_mm` apart (negative: they overlap).
        asked_mm: of clearance.
    """

    where: str
    reason: str
    yaw: int | None = None
    branch: str | None = None
    joint: str | None = None
    excess_deg: float | None = None
    outside_mm: float | None = None
    pair: tuple[str, str] | None = None
    distance_mm: float | None = None
    asked_mm: float | None = None

    def to_json(self) -> dict[str, Any]:
        """What is known, as JSON types."""
        known = {key: value for key, value in vars(self).items() if value is not None}
        return {**known, "pair": list(self.pair)} if self.pair else known


def nearness(pair: Sequence[str], distance: float, asked: float) -> str:
    """How near two bodies come, in words; lengths in m.

    How deep they overlap is not said: the shortest way out may be through the far side. Digits are enough to show that
    the distance is below what is asked.
    """
    first, second = pair
    wanted = f"(asked: {asked * 1e3:g} mm)"
    if distance <= 0.0:
        return f"{first} is inside {second} {wanted}"
    return f"{first} comes to {short_of(distance, asked)} mm of {second} {wanted}"


def short_of(distance: float, asked: float) -> str:
    """A distance in mm with as many digits as show that it is less than `asked`, where it is; both in m."""
    value, limit = distance * 1e3, asked * 1e3
    for digits in range(1, 6):
        shown = f"{value:.{digits}f}"
        if value >= limit or float(shown) < limit:
            return shown
    return f"less than {limit:g}"


@dataclass(frozen=True)
class Failure:
    """Why there is no plan.

    Attributes:
        kind: one of the constants of this module.
        step: that cannot be made.
        stations: names of the places concerned.
        headline: one line for people.
        ways: that were rejected, per place the nearest miss first.
        body: of the scene that is in the way (a cube that moves is named by its own name), or None.
    """

    kind: str
    step: str
    stations: tuple[str, ...]
    headline: str
    ways: tuple[Rejected, ...]
    body: str | None = None

    def to_json(self) -> dict[str, Any]:
        """JSON types."""
        return {
            "kind": self.kind,
            "step": self.step,
            "stations": list(self.stations),
            "headline": self.headline,
            "body": self.body,
            "ways": [way.to_json() for way in self.ways],
        }


def failure_from_json(value: Mapping[str, Any]) -> Failure:
    """The inverse of `Failure.to_json`."""
    ways = tuple(Rejected(**{**w, "pair": tuple(w["pair"]) if "pair" in w else None}) for w in value["ways"])
    return Failure(
        value["kind"], value["step"], tuple(value["stations"]), value["headline"], ways, value["body"]
    )


def failure_in(error: ImpossibleError) -> Failure | None:
    """The failure that an error of `plan.pick_place.planner.plan_task` carries."""
    value = error.data.get("failure")
    return failure_from_json(value) if value else None


def of_choice(choice: LineChoice) -> Rejected:
    """A way that does not reach."""
    near = Rejected(f"line at {choice.hole}", choice.reason(), choice.yaw, choice.branch)
    if choice.outside > 0.0:
        return replace(near, outside_mm=choice.outside * 1e3)
    if choice.margin < 0.0:
        return replace(near, joint=choice.joint, excess_deg=float(np.degrees(-choice.margin)))
    return replace(near, joint=choice.racing or None)
