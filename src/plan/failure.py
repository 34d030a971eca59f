"""Why a task cannot be planned, as data: the step that fails, and why each candidate was rejected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from arm.errors import ImpossibleError
from arm.former import renamed_arguments
from plan.cartesian.reachability import GraspCandidate
from plan.kinematics.nearest import AskedPose

OUT_OF_REACH = "out of reach"
LINE_BLOCKED = "line blocked"
TRANSIT_BLOCKED = "no way across"
START_BLOCKED = "start blocked"
AFTER_TIMING = "clearance after timing"
_JSON_KEYS = {"required_mm": "asked_mm"}  # JSON keys that differ from the attributes of `Rejected`


@renamed_arguments(asked_mm="required_mm")
@dataclass(frozen=True)
class Rejected:
    """One rejected candidate and the reason.

    Attributes:
        where: ``line at 03-04/1``, ``from 01-02/1 to 03-04/1``, ``start``, or the name of a step.
        reason: in words.
        yaw, branch: of a candidate at a station, else None.
        joint: the joint that exceeds its limit by `excess_deg`, or would have to move too fast (`excess_deg` None).
        outside_mm: distance of the line beyond the reach of the links.
        pair: the two bodies with the smallest distance.
        distance_mm: their distance; negative if they overlap.
        required_mm: the required clearance; ``asked_mm`` in JSON.
        at: where the two bodies are that near; see `plan.collision.world.World.state`.
        pose: that is out of reach; see `plan.kinematics.nearest.AskedPose`.
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
    required_mm: float | None = None
    at: Mapping[str, Any] | None = None
    pose: Mapping[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the attributes that are not None, as JSON types."""
        known = {_JSON_KEYS.get(key, key): value for key, value in vars(self).items() if value is not None}
        return {**known, "pair": list(self.pair)} if self.pair else known


def nearness(pair: Sequence[str], distance: float, asked: float) -> str:
    """Return the distance of two bodies against the required clearance `asked`, in words; lengths in m.

    The depth of an overlap is left out, because it may be measured through the far side of a body.
    """
    first, second = pair
    wanted = f"(required: {asked * 1e3:g} mm)"
    if distance <= 0.0:
        return f"{first} is inside {second} {wanted}"
    return f"{first} comes within {short_of(distance, asked)} mm of {second} {wanted}"


def short_of(distance: float, asked: float) -> str:
    """Return `distance` (m) in mm, with enough digits to tell it from `asked` (m) if it is less."""
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
        step: the step that fails.
        stations: names of the stations concerned.
        headline: summary in one line.
        ways: rejected candidates, for each station the nearest miss first.
        body: the body of the scene that obstructs (a moving cube by its own name), or None.
    """

    kind: str
    step: str
    stations: tuple[str, ...]
    headline: str
    ways: tuple[Rejected, ...]
    body: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the failure as JSON types."""
        ways = [way.to_json() for way in self.ways]
        return {**vars(self), "stations": list(self.stations), "ways": ways}


def failure_from_json(value: Mapping[str, Any]) -> Failure:
    """Invert `Failure.to_json`."""
    ways = tuple(map(_rejected, value["ways"]))
    return Failure(**{**value, "stations": tuple(value["stations"]), "ways": ways})


def _rejected(way: Mapping[str, Any]) -> Rejected:
    names = {key: name for name, key in _JSON_KEYS.items()}
    known = {names.get(key, key): value for key, value in way.items()}
    return Rejected(**{**known, "pair": tuple(known["pair"]) if "pair" in known else None})


def failure_in(error: ImpossibleError) -> Failure | None:
    """Return the failure in an error of `plan.program.tasks.plan_task`, or None."""
    value = error.data.get("failure")
    return failure_from_json(value) if value else None


def of_choice(choice: GraspCandidate) -> Rejected:
    """Return the rejection of a grasp that does not reach."""
    measures = choice.shortfall()
    measures.pop("miss", None)  # the reason says it
    if (racing := measures.pop("racing", "")) != "":
        measures["joint"] = racing
    pose = None if choice.T_worst is None else AskedPose(choice.T_worst).to_json()
    return Rejected(
        f"line at {choice.hole}", choice.reason(), choice.yaw, choice.branch, pose=pose, **measures
    )
