"""Refusals of single steps in a sequence of goals: a message, and the same as data (`reason` groups equal refusals)."""

from __future__ import annotations

from arm.errors import ImpossibleError
from plan.collision.certificate import ClearanceCertificate
from plan.collision.world import World
from plan.program.goals.target import Target
from plan.transit.straight import StraightLine


def end_blocked(
    before: str, name: str, end: str, seen: ClearanceCertificate, clearance: float
) -> ImpossibleError:
    """Return the refusal of a transit that begins (``from``) or ends (``to``) too near; `clearance` is required, m."""
    where, verb = (before, "starts") if end == "from" else (name, "ends")
    pair, distance = seen.pair, seen.seen
    return ImpossibleError(
        f"the transit from {before} to {name} {verb} too near to a body: at {where}, {pair[0]} is "
        f"{distance * 1e3:.1f} mm from {pair[1]} (required: {clearance * 1e3:g} mm); a longer approach or retract, "
        "less clearance, or the option near_ends may help",
        reason=f"{verb} with {pair[0]} too near to {pair[1]}",
        target=where,
        pair=list(pair),
        distance_m=distance,
        clearance_m=clearance,
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
    )


def line_blocked(role: str, name: str, check: ClearanceCertificate, clearance: float) -> ImpossibleError:
    """Return the refusal of a line with two bodies too near."""
    return ImpossibleError(
        f"on the {role} at {name} {check.pair[0]} comes within {check.seen * 1e3:.1f} mm of {check.pair[1]} "
        f"({_asked(check, clearance)}); allow that contact (allowed_collisions), or rotate the pose",
        reason=f"{role} with {check.pair[0]} too near to {check.pair[1]}",
        role=role,
        target=name,
        pair=list(check.pair),
        distance_m=check.seen,
        clearance_m=clearance,
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
