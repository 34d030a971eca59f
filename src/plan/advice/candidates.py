"""Candidate changes for a task that cannot be planned, in families, the least work for the user first.

`plan.advice.search` checks them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arm.numerics.angles import arccos
from arm.numerics.products import norm
from arm.se3 import Array
from plan.advice.changes import (
    Change,
    ChangeOptions,
    Groups,
    MoveBodies,
    RemoveBodies,
    Request,
    SkipCubes,
    TurnTool,
)
from plan.failure import AFTER_TIMING, LINE_BLOCKED, OUT_OF_REACH, START_BLOCKED, TRANSIT_BLOCKED, Failure
from plan.options import PlanOptions
from plan.scene import Station

STEP, STEPS = 0.010, 12  # m between displacements of a body, and their number
TURNS = tuple(float(np.radians(d)) for d in (15.0, -15.0, 30.0, -30.0, 45.0, -45.0, 90.0, -90.0))
FIXED = ("table", "post")  # kinds of bodies to leave in place: cameras and tables are calibrated
_TILTED = np.radians(3.0)  # boards that are tilted more can also be rotated about their normal
_PART = re.compile(r"(, stroke \d+)?( \(\d+\))?(, leg \d+)?$")  # of a step's paths, after its name
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Family:
    """Changes of one kind, the smallest first.

    Attributes:
        rank: families of a lower rank are less work for the user.
        changes: changes of growing size.
        anchors: indices of the changes to try first, in this order, if a larger change always helps more; bisection
            then finds the smallest one that helps.
    """

    rank: int
    changes: tuple[Change, ...]
    anchors: tuple[int, ...] = ()


def families(request: Request, failure: Failure, groups: Groups) -> Iterator[Family]:
    """Yield all families for a failure, in order of rank.

    Args:
        request: the request that failed.
        failure: the reason.
        groups: for each board, the names of the bodies that move with it.
    """
    yield from _options(request, failure)
    yield from _tool_round(request, failure)
    yield from _obstacle(request, failure, groups)
    yield from _boards(request, failure, groups)
    skipped = skipped_for(request, failure)
    if skipped is not None:
        yield Family(6, (skipped,))


def _options(request: Request, failure: Failure) -> Iterator[Family]:
    options = request.options
    if request.transfers and failure.kind in (LINE_BLOCKED, TRANSIT_BLOCKED, OUT_OF_REACH):
        if options.order == "given" and failure.kind != OUT_OF_REACH:
            yield Family(0, (ChangeOptions("let the planner choose the order", (("order", "free"),)),))
        if options.assignment == "given":
            text = "let the planner choose the destinations of the cubes"
            yield Family(0, (ChangeOptions(text, (("assignment", "free"), ("order", "free"))),))
    racing = any(w.joint and w.excess_deg is None for w in failure.ways)
    if racing and options.speed < 1.0:
        # a joint was too slow for a line at the slowest tool speed
        speeds = [s for s in (0.25, 0.5, 0.75, 1.0) if s > options.speed]
        yield Family(0, tuple(ChangeOptions(f"raise the speed to {s:g}", (("speed", s),)) for s in speeds))
    if failure.kind in (TRANSIT_BLOCKED, START_BLOCKED, AFTER_TIMING):
        yield from _less_clearance(options, failure)


def _tool_round(request: Request, failure: Failure) -> Iterator[Family]:
    """Yield the opposite direction of the tool's z axis on all paths of a step with one that is out of reach."""
    paths = {goal.name: _PART.sub("", goal.name) for goal in request.goals if goal.by == "path"}
    steps = {paths[name] for name in failure.stations if name in paths}
    if failure.kind == OUT_OF_REACH and len(steps) == 1:
        (step,) = steps
        text = f"give {step} the opposite axis (the tool's z axis the other way round)"
        names = frozenset(name for name, of in paths.items() if of == step)
        yield Family(0, (TurnTool(text, step, names),))


def _less_clearance(options: PlanOptions, failure: Failure) -> Iterator[Family]:
    """Yield clearances in whole millimetres below the required one.

    Try first the distance at an end of a transit, if an end is too near; then the default; then the minimum.
    """
    now, usual = options.clearance * 1e3, round(PlanOptions.clearance * 1e3)
    least = int(np.ceil(options.least_clearance * 1e3 - 1e-9))
    sizes = range(int(np.ceil(now - 1e-9)) - 1, least - 1, -1)
    if not sizes:
        return
    ends = [
        w.distance_mm for w in failure.ways if w.distance_mm is not None and not w.where.startswith("from ")
    ]
    first = [int(max(ends))] if ends else []
    text = "require {:g} mm of clearance instead of {:g} mm"
    yield Family(
        0,
        tuple(ChangeOptions(text.format(c, now), (("clearance", c / 1e3),)) for c in sizes),
        tuple(dict.fromkeys(sizes.index(c) for c in (*first, usual, least) if c in sizes)),
    )


def _obstacle(request: Request, failure: Failure, groups: Groups) -> Iterator[Family]:
    """Yield displacements and the removal of the obstructing body."""
    scene, name = request.scene, failure.body
    if name is None:
        return
    handled = {t.cube for t in request.transfers} | {goal.attach for goal in request.goals}
    if name in {c.name for c in scene.cubes} - handled:
        yield Family(1, (RemoveBodies(f"take {name} away", name),))
    body = next((b for b in scene.bodies if b.name == name), None)
    if body is None or body.kind in FIXED:
        return
    board = next((g for g, names in groups.items() if name in names), None)
    at = _centre(request, failure.stations)
    if board is not None:
        if at is not None and not _on(request, groups[board], failure.stations):
            yield _moves(1, board, groups[board], _away(body.T_base_body[:3, 3], at), _from(failure))
        return
    for direction, words in _directions(np.array(body.T_base_body[:3, 3]), at, failure):
        yield _moves(1, name, frozenset({name}), direction, words)
    yield Family(2, (RemoveBodies(f"take {name} away", name),))


def _boards(request: Request, failure: Failure, groups: Groups) -> Iterator[Family]:
    """Yield displacements and rotations of the boards with the places that fail."""
    for board, names in groups.items():
        on = _on(request, names, failure.stations)
        if not on:
            continue
        at = np.mean([s.T_base_tool[0][:3, 3] for s in on], axis=0)
        out = _level(at)
        side = np.array([-out[1], out[0], 0.0])
        # a place out of reach must come at least this much nearer
        beyond = min((w.outside_mm for w in failure.ways if w.outside_mm is not None), default=0.0)
        steps = STEPS + int(np.ceil(beyond / 1e3 / STEP))
        yield _moves(3, board, names, -out, "towards the base", steps)
        yield _moves(3, board, names, out, "away from the base")
        for aside in (side, -side):
            yield _moves(3, board, names, aside, "sideways")
            yield _moves(
                3, board, names, (aside - out) / np.sqrt(2.0), "towards the base and sideways", steps
            )
        yield from _turns(request, board, names, on[0])
        yield _moves(5, board, names, _UP, "up")
        yield _moves(5, board, names, -_UP, "down")


def _turns(request: Request, board: str, names: frozenset[str], station: Station) -> Iterator[Family]:
    plates = [b for b in request.scene.bodies if b.name in names & station.touches]
    if not plates:
        return
    about = tuple(plates[0].T_base_body[:3, 3].tolist())
    normal = -station.T_base_tool[0][:3, 2]
    rotations = [("about the vertical, seen from above", _UP, names)]
    if arccos(abs(normal[2])) > _TILTED:
        # the board rotates on its stand, which stays in place
        stands = {b.name for b in request.scene.bodies if b.kind == "stand"}
        rotations.append(("about its own normal, seen from its front", normal, names - stands))
    for words, axis, bodies in rotations:
        x, y, z = np.round(axis, 12).tolist()
        turns = []
        for turn in TURNS:
            sense = "counter-clockwise" if turn > 0.0 else "clockwise"
            text = f"turn {board} by {abs(np.degrees(turn)):.0f} deg {sense} {words}"
            turns.append(MoveBodies(text, board, bodies, turn=turn, axis=(x, y, z), about=about))
        yield Family(4, tuple(turns))


def skipped_for(
    request: Request, failure: Failure, already: frozenset[str] = frozenset()
) -> SkipCubes | None:
    """Return the change that skips the cubes of the places that fail; None if no others remain."""
    failing = frozenset(failure.stations)
    cubes = already | {t.cube for t in request.transfers if {t.pick.name, t.place.name} & failing}
    if not cubes - already or len(cubes) >= len(request.transfers):
        return None
    names = ", ".join(t.cube for t in request.transfers if t.cube in cubes)
    return SkipCubes(f"leave {names} out", cubes)


def _moves(
    rank: int, name: str, bodies: frozenset[str], direction: Array, words: str, steps: int = STEPS
) -> Family:
    changes = []
    for count in range(1, steps + 1):
        size = STEP * count
        by = np.round(size * direction, 4) + 0.0
        axes = ", ".join(f"{a} {v * 1e3:+.0f}" for a, v in zip("xyz", by, strict=True) if abs(v) >= 5e-4)
        text = f"move {name} by {size * 1e3:.0f} mm {words} ({axes} mm)"
        changes.append(MoveBodies(text, name, bodies, (float(by[0]), float(by[1]), float(by[2]))))
    return Family(rank, tuple(changes))


def _directions(body: Array, at: Array | None, failure: Failure) -> list[tuple[Array, str]]:
    away = _away(body, at) if at is not None else _level(body)
    side = np.array([-away[1], away[0], 0.0])
    return [(away, _from(failure)), (side, "sideways"), (-side, "sideways"), (_UP, "up")]


def _from(failure: Failure) -> str:
    return f"away from {failure.stations[0]}" if failure.stations else "away from the base"


def _away(body: Array, at: Array) -> Array:
    """Return the horizontal unit vector from `at` to the body; away from the base if one is above the other."""
    apart = np.array([body[0] - at[0], body[1] - at[1], 0.0])
    return _level(apart) if norm(apart) > 5e-3 else _level(body)


def _level(vector: Array) -> Array:
    flat = np.array([vector[0], vector[1], 0.0])
    length = float(norm(flat))
    return flat / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])


def _centre(request: Request, names: Sequence[str]) -> Array | None:
    points = [s.T_base_tool[0][:3, 3] for s in request.stations() if s.name in names]
    points += [goal.poses[0][:3, 3] for goal in request.goals if goal.name in names and goal.q is None]
    return np.mean(points, axis=0) if points else None


def _on(request: Request, bodies: frozenset[str], names: Sequence[str]) -> list[Station]:
    """Return the places with these names that are on a board with these bodies."""
    return [s for s in request.stations() if s.name in names and s.touches & bodies]
