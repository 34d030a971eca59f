"""Refusals of goals in a given order: of single steps, with a `reason` that groups equal ones, and of the program."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np

from arm.errors import ImpossibleError
from arm.numerics.angles import arccos, arctan2
from arm.numerics.products import mul, norm
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import Array
from plan.collision.certificate import ClearanceCertificate
from plan.collision.world import World
from plan.failure import (
    AFTER_TIMING,
    LINE_BLOCKED,
    OUT_OF_REACH,
    START_BLOCKED,
    TRANSIT_BLOCKED,
    Failure,
    Rejected,
)
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.program.goals.target import Target
from plan.transit.straight import StraightLine

_PARALLEL = 1e-6  # sine between axes that are parallel

BELOW = "below the top of"  # in refusals of a pose that is in a table


def below_table(point: Array, bodies: Iterable[Body]) -> str:
    """Say that a point (3,) m is below the top of a table, which stands in `bodies`; "" if it is not."""
    for body in bodies:
        if body.kind == "table" and isinstance(body.shape, Box):
            at = mul(body.T_base_body[:3, :3].T, point - body.T_base_body[:3, 3])
            below = body.shape.size[2] / 2.0 - at[2]
            if (
                below > 0.0
                and abs(at[0]) <= body.shape.size[0] / 2.0
                and abs(at[1]) <= body.shape.size[1] / 2.0
            ):
                return f", and it is {1e3 * below:.0f} mm {BELOW} {body.name}"
    return ""


def lean(robot: Robot, T_base_tool: Array, free: Collection[str]) -> float:
    """Return the angle, rad, by which a pose (4, 4) leans from every pose of an arm whose turning joints have parallel
    axes, such as a SCARA, so that its tool keeps its tilt; 0 for another arm, or with more than one free rotation.
    """
    chain = product_of_exponentials(robot)
    directions = [axis.direction for axis in chain.axes if not axis.slides]
    turns = [name[1] for name in free if name.startswith("r")]
    if not directions or len(turns) > 1:
        return 0.0
    axis = directions[0]
    if any(np.abs(np.cross(axis, other)).max() > _PARALLEL for other in directions):
        return 0.0
    ours = mul(chain.T_base_tool_0[:3, :3].T, axis)  # the same at every configuration
    asked = mul(T_base_tool[:3, :3].T, axis)
    if not turns:
        return float(arctan2(norm(np.cross(ours, asked)), (ours * asked).sum()))
    # a free rotation keeps the angle to its own axis
    here, there = (arccos(np.clip(v["xyz".index(turns[0])], -1.0, 1.0)) for v in (ours, asked))
    return abs(float(here - there))


def end_blocked(
    before: str, name: str, line: StraightLine, world: World, clearance: float
) -> ImpossibleError:
    """Return the refusal of a transit with an end that is itself too near; `clearance` is required, m."""
    at_start, seen = line.end == "from", line.seen(world)
    where, verb = (before, "starts") if at_start else (name, "ends")
    pair, distance = seen.pair, seen.seen
    return ImpossibleError(
        f"the transit from {before} to {name} {verb} too near to a body: at {where}, {pair[0]} is "
        f"{distance * 1e3:{'.1f' if clearance - distance > 1e-4 else '.3f'}} mm from {pair[1]} (required: "
        f"{clearance * 1e3:g} mm); a longer approach or retract, "
        "a path that begins and ends further out (lift_mm), or less clearance may help",
        reason=f"{verb} with {pair[0]} too near to {pair[1]}",
        target=where,
        pair=list(pair),
        distance_m=distance,
        clearance_m=clearance,
        **world.state(line.a if at_start else line.b),
    )


def out_of_hand(target: Target, pair: tuple[str, str], distance: float) -> ImpossibleError:
    """Return the refusal to attach a body that is too far from the hand; lengths in m."""
    return ImpossibleError(
        f"target {target.name!r}: attach = {target.attach!r}: is {distance * 1e3:.1f} mm from {pair[0]} there; must be "
        f"at most {target.attach_within * 1e3:g} mm (attach_within) from the hand or from the tool frame; move the "
        "target to the body, or raise attach_within",
        target=target.name,
        reason=f"{pair[1]} too far from the hand",
        pair=list(pair),
        distance_m=distance,
        attach_within_m=target.attach_within,
    )


def straight_blocked(
    line: StraightLine, world: World, names: tuple[str, str], asked: float, tried: bool
) -> ImpossibleError:
    """Return the refusal of the straight motion between two `names`; `tried` states whether a detour was searched."""
    check = line.seen(world)
    more = "no detour was found" if tried else "the allowed number of detours was used up"
    near, other = check.pair
    return ImpossibleError(
        f"on the straight motion from {names[0]} to {names[1]} {near} comes within {check.seen * 1e3:.1f} mm of "
        f"{other} ({_asked(check, asked)}), and {more}",
        reason=f"{near} too near to {other}" + ("" if tried else ", detour not tried"),
        target=names[1],
        pair=list(check.pair),
        distance_m=check.seen,
        clearance_m=asked,
        **world.state(line.a + check.time * (line.b - line.a)),
    )


def line_blocked(
    role: str, name: str, check: ClearanceCertificate, clearance: float, at: Mapping[str, Any]
) -> ImpossibleError:
    """Return the refusal of a line with two bodies too near; `at`: `World.state` there."""
    return ImpossibleError(
        f"on the {role} at {name} {check.pair[0]} comes within {check.seen * 1e3:.1f} mm of {check.pair[1]} "
        f"({_asked(check, clearance)}); allow that contact on this line, move the goal or the body, or rotate the pose",
        reason=f"{role} with {check.pair[0]} too near to {check.pair[1]}",
        role=role,
        target=name,
        pair=list(check.pair),
        distance_m=check.seen,
        clearance_m=clearance,
        **at,
    )


def miss(error: ImpossibleError) -> float:
    """Return the distance by which a step was refused, m."""
    data = error.data
    if "attach_within_m" in data:
        return float(data["distance_m"] - data["attach_within_m"])
    return float(data["clearance_m"] - data["distance_m"])


def _asked(check: ClearanceCertificate, clearance: float) -> str:
    more = ", plus a margin for timing" if check.seen >= clearance else ""
    return f"required: {clearance * 1e3:g} mm{more}"


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
            at=data.get("at"),
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
        pose=data.get("pose"),
    )
    return Failure(OUT_OF_REACH, way.where, stations, headline, (way,))


def _kind(error: ImpossibleError) -> str:
    """Return the kind of failure of an error about two bodies that are too near."""
    if "proved_m" in error.data:
        return AFTER_TIMING
    if "reason" in error.data:
        return LINE_BLOCKED if error.data.get("role") else TRANSIT_BLOCKED
    return LINE_BLOCKED if "target" in error.data else START_BLOCKED
