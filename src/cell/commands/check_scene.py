"""``a465 check`` of a scene file: evaluate every query and motion and compare with the expected results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.arguments import option_numbers
from arm.errors import InputError
from cell.config.doubts.angles import doubt_of_deg
from cell.console import Console
from cell.files.scene import (
    MOTION_VERDICTS,
    QUERY_VERDICTS,
    Expected,
    Pair,
    Query,
    SceneFile,
)
from cell.files.scene_doubts import scene_doubts
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World

AGREES = 1e-5  # tolerance for equal distances, m
CLOSEST = 5  # pairs reported for a configuration


@dataclass(frozen=True)
class Answer:
    """Result of one query or motion.

    Attributes:
        name, expected: from the scene file.
        verdict: one of `QUERY_VERDICTS` or `MOTION_VERDICTS`.
        proved, seen: bounds of the distance, m: the certified one, and the smallest distance computed along the motion.
            They are equal for a query. The check of a colliding motion ends at the first overlap, so `proved` may be
            far below `seen`.
        pair: the closest two bodies.
        agrees: whether everything is as expected.
    """

    name: str
    expected: Expected
    verdict: str
    proved: float
    seen: float
    pair: tuple[str, str]
    agrees: bool


def answer_query(scene: SceneFile, query: Query) -> Answer:
    """Compute the distances at one configuration."""
    world = scene.world(query.allowed)
    distance = world.distance(query.q[0])
    free, collides = QUERY_VERDICTS
    verdict = free if distance.value > 0.0 else collides
    expected = query.expected
    agrees = (
        _verdict_agrees(expected, verdict, free)
        and _same(expected.distance, distance.value, distance.value)
        and _pair_agrees(world, query.q[0], expected, distance.value)
    )
    return Answer(query.name, expected, verdict, distance.value, distance.value, distance.pair, agrees)


def answer_motion(scene: SceneFile, motion: Query) -> Answer:
    """Certify one straight joint motion, with bounds tight enough to report its clearance."""
    world = scene.world(motion.allowed)
    check = certify_curve(world, curve_of_waypoints(motion.q), motion.asked, tight=True)
    clear, too_close = MOTION_VERDICTS
    verdict = clear if check.proved else too_close
    agrees = (
        _verdict_agrees(motion.expected, verdict, clear)
        and _same(motion.expected.distance, check.clearance, check.seen)
        and _pair_agrees_along(scene, motion, check.seen)
    )
    return Answer(motion.name, motion.expected, verdict, check.clearance, check.seen, check.pair, agrees)


def _verdict_agrees(expected: Expected, verdict: str, good: str) -> bool:
    """Whether the verdict is as expected. If the file states no expectation, it must be `good`."""
    if expected.verdict is None:
        return expected != Expected() or verdict == good
    return verdict == expected.verdict


def _same(expected: float | None, low: float, high: float) -> bool:
    return expected is None or low - AGREES <= expected <= high + AGREES


def _checked(world: World) -> list[Pair]:
    """Return the pairs of bodies that a world checks, in its order."""
    return [frozenset(world.pair_names(i)) for i in range(len(world.pairs))]


def _pair_agrees(world: World, q: npt.ArrayLike, expected: Expected, closest: float) -> bool:
    """Whether the expected pair is as close as the closest one, which need not be the only one."""
    if expected.pair is None:
        return True
    names = _checked(world)
    if expected.pair not in names:
        return False
    index = np.array([names.index(expected.pair)])
    return float(world.pair_distances(q, index)[0]) <= closest + AGREES


def _pair_agrees_along(scene: SceneFile, motion: Query, seen: float) -> bool:
    """Whether the expected pair alone comes as close as all pairs together."""
    if motion.expected.pair is None:
        return True
    names = _checked(scene.world(motion.allowed))
    if motion.expected.pair not in names:
        return False
    alone = scene.world({*motion.allowed, *names} - {motion.expected.pair})
    least = certify_curve(alone, curve_of_waypoints(motion.q), motion.asked, tight=True)
    if seen < 0.0:
        return least.seen < 0.0
    closest = seen if motion.expected.distance is None else motion.expected.distance
    return _same(closest, least.clearance, least.seen)


def check_scene(scene: SceneFile, console: Console) -> dict[str, Any]:
    """Evaluate every query and motion of a scene file, print a table, and return the object for ``--json``.

    Raises:
        InputError: the file has neither queries nor motions.
    """
    if not scene.queries and not scene.motions:
        why = f"{scene.file}: nothing to check; add [[queries]] or [[motions]], or give a configuration with --q"
        raise InputError(why, file=str(scene.file))
    queries = [answer_query(scene, q) for q in scene.queries]
    motions = [answer_motion(scene, m) for m in scene.motions]
    before, after = ("expected", "found", "mm exp."), ("closest", "as expected")
    if queries:
        console.table(("query", *before, "mm", *after), [_row(a, (a.seen,)) for a in queries])
    if motions:
        console.say()
        header = ("motion", *before, "proved mm", "seen mm", *after)
        console.table(header, [_row(a, (_down(a.proved), _up(a.seen))) for a in motions])
        console.say("proved: lower bound of the clearance over the whole motion; seen: upper bound")
    if any(a.seen < 0.0 for a in motions):
        console.say(
            "the check of a colliding motion ends at the first overlap; the expected one is the deepest"
        )
    differing = [a.name for a in (*queries, *motions) if not a.agrees]
    doubts = scene_doubts(scene)
    for doubt in doubts:
        console.say(f"NOTE: {scene.file}: {doubt}")
    console.say(
        f"{scene.file}: {len(queries) + len(motions) - len(differing)} as expected, {len(differing)} not"
    )
    return {
        "scene": str(scene.file),
        "as_expected": not differing,
        "differing": differing,
        "doubts": list(doubts),
        "differences": [
            f"{a.name} ({_difference(a, key)})"
            for key, answers in (("distance_mm", queries), ("clearance_mm", motions))
            for a in answers
            if not a.agrees
        ],
        "queries": [_to_json(a, "distance_mm") for a in queries],
        "motions": [
            _to_json(a, "clearance_mm")
            | {"clearance_mm": _finite(a.proved), "proved_mm": _finite(a.proved), "seen_mm": _finite(a.seen)}
            for a in motions
        ],
    }


def _difference(answer: Answer, key: str) -> str:
    """Say what differs from the file, and in which unit or sign the file may have it."""
    expected, low, high = answer.expected, answer.proved, answer.seen
    if expected.distance is not None and not _same(expected.distance, low, high):
        found = f"{1e3 * high:.4g}"
        if high - low > 2.0 * AGREES:
            found = f"{1e3 * low:.4g} to {found}" if np.isfinite(low) else f"{found} or less"
        why = f"{key} is {found}, {1e3 * expected.distance:.6g} in the file"
        if _same(1e3 * expected.distance, low - 1e-3, high + 1e-3):
            return f"{why}: is it in metres?"
        return f"{why}: an overlap is negative" if _same(-expected.distance, low, high) else why
    if not _verdict_agrees(expected, answer.verdict, QUERY_VERDICTS[0]) and expected.verdict is not None:
        return f"{answer.verdict}, {expected.verdict} in the file"
    if expected.pair is not None and expected.pair != frozenset(answer.pair):
        return f"closest are {' - '.join(answer.pair)}, {' - '.join(sorted(expected.pair))} in the file"
    return f"{answer.verdict}: {' - '.join(answer.pair)} {1e3 * high:.4g} mm"


def _row(answer: Answer, distances: tuple[float, ...]) -> tuple[object, ...]:
    expected = answer.expected
    return (
        answer.name,
        expected.verdict or "-",
        answer.verdict,
        None if expected.distance is None else 1e3 * expected.distance,
        *map(_finite, distances),
        " - ".join(answer.pair),
        answer.agrees,
    )


def _to_json(answer: Answer, distance_key: str) -> dict[str, Any]:
    expected = answer.expected
    return {
        "name": answer.name,
        "verdict": answer.verdict,
        distance_key: _finite(answer.seen),
        "pair": list(answer.pair),
        "expected": {
            "verdict": expected.verdict,
            distance_key: None if expected.distance is None else 1e3 * expected.distance,
            "pair": None if expected.pair is None else sorted(expected.pair),
        },
        "as_expected": answer.agrees,
    }


def _finite(distance: float) -> float | None:
    """Convert to mm; None if no pair is checked."""
    return 1e3 * distance if np.isfinite(distance) else None


def _down(distance: float) -> float:
    """Round down to the 0.01 mm of the table, so that the displayed bound is still proved."""
    return float(np.floor(distance * 1e5 + 1e-6)) / 1e5


def _up(distance: float) -> float:
    return float(np.ceil(distance * 1e5 - 1e-6)) / 1e5


def closest_pairs(scene: SceneFile, configuration: str, console: Console) -> dict[str, Any]:
    """Print and return the closest pairs at a configuration, given as six comma-separated angles in deg.

    Raises:
        InputError: the text is not six angles, or a joint limit is exceeded.
    """
    degrees = option_numbers("--q", configuration, 6, "J1 to J6 in deg")
    rule = scene.unit.beyond_limits(np.radians(degrees))
    if rule:
        raise InputError(f"q = {configuration!r}: {rule}", q=configuration)
    found = scene.world().distances_below(np.radians(degrees), float("inf"))[:CLOSEST]
    console.table(("closest", "mm"), [(" - ".join(d.pair), 1e3 * d.value) for d in found])
    if doubt := doubt_of_deg(np.radians(degrees), scene.unit):
        console.say(f"NOTE: --q {doubt}")
    verdict = QUERY_VERDICTS[bool(found) and found[0].value <= 0.0]
    console.say(f"{scene.file}: {verdict}")
    return {
        "scene": str(scene.file),
        "q_deg": degrees.tolist(),
        "verdict": verdict,
        "closest": [{"pair": list(d.pair), "distance_mm": 1e3 * d.value} for d in found],
    }
