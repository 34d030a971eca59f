"""Map the samples of a log to the plan's clock: each sample to the nearest point of the planned motion.

The controller keeps the path and only stretches time (docs/sources.md, "Coordinated motion", row 14). So each sample
is compared with the nearest point of the planned path, near the segment that the unit reported. A delay shows in the
duration of the motion only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from arm.plan_file import Move, Plan, Step
from arm.se3 import Array, frozen
from cell.preview.overlays import ExecutedMove
from driver.log.motions import LoggedMotion
from driver.log.read import Session

STEP_S = 0.005  # grid on the planned path; positions are linear in between
LAG_SEGMENTS = 3  # number of segments by which the servos may lag behind the reference
BLIND_S = 3.0  # search range along the path if the unit did not report its segment


@dataclass(frozen=True)
class MatchedMotion:
    """A motion of the log and its place in the plan.

    Attributes:
        number: index of the session's motion.
        executed: its samples on the clock of the plan's step where it begins.
        difference: (m, 6) rad, executed minus planned at the nearest point.
        planned_s: duration of the segments sent.
        lasted_s: from the first segment to R!; None if that never came.
    """

    number: int
    executed: ExecutedMove
    difference: Array
    planned_s: float
    lasted_s: float | None


def match(session: Session, plan: Plan, unit: Unit) -> tuple[MatchedMotion, ...]:
    """Find the motions of a log in a plan: same start and same segments, or the first ones of a stopped motion.

    Durations may differ, because an override stretches them.
    """
    known: dict[tuple[int, ...], list[tuple[int, CountPath]]] = {}
    for motion in plan.motions:
        known.setdefault(motion.path.start, []).append((motion.first, motion.path))
    found = []
    for number, logged in enumerate(session.motions):
        for step, path in known.get(logged.start or (), []):
            if logged.segments and _begins(path.segments, logged.segments):
                found.append(_matched(number, step, logged, path, unit))
                break
    return tuple(found)


def plan_of(session: Session, unit: Unit) -> tuple[Plan, tuple[MatchedMotion, ...]]:
    """Create a plan from the lines sent, one step per motion, for a log whose plan file is not available."""
    steps: list[Step] = []
    matched = []
    for number, logged in enumerate(session.motions):
        path = _sent_path(logged)
        if path is None or path.duration_s <= 0.0:
            continue
        matched.append(_matched(number, len(steps), logged, path, unit))
        name = f"motion {number + 1}"
        steps.append(Move(name, "transit", None, path, None, 0.0, 0.0, ("", "")))
    plan = Plan(
        task={"name": f"log {session.file.name}"},
        unit=unit.name,
        speed=1.0,
        speed_registers=unit.speed_registers,
        acceleration_registers=unit.acceleration_registers,
        steps=tuple(steps),
        provenance={"log": session.file.name, "planned": "the lines that were sent; no plan file was found"},
    )
    return plan, tuple(matched)


def _begins(planned: Sequence[Segment], sent: Sequence[Segment]) -> bool:
    return len(sent) <= len(planned) and all(
        p.coefficients == s.coefficients for p, s in zip(planned, sent, strict=False)
    )


def _sent_path(logged: LoggedMotion) -> CountPath | None:
    """The segments sent; an absolute motion is one straight segment of its actual duration."""
    start, target, ready_s = logged.start, logged.target, logged.ready_s
    if target is None or start is None:
        return logged.path
    if ready_s is None or start == target:
        return None
    delta = tuple(b - a for a, b in zip(start, target, strict=True))
    return CountPath(start, (Segment(max(1, round(1e3 * (ready_s - logged.sent_s))), (delta,)),))


def _matched(number: int, step: int, logged: LoggedMotion, path: CountPath, unit: Unit) -> MatchedMotion:
    counts = np.array([s.position.counts for s in logged.samples], dtype=np.int64).reshape(-1, 6)
    places = [None if logged.target else logged.segment_of(s) for s in logged.samples]
    on_path = OnPath(path, unit)
    q = unit.positions(counts)
    found = [on_path.place(here, place) for here, place in zip(q, places, strict=True)]
    nearest = np.array([point for _, point in found]).reshape(-1, 6)
    begin_s = logged.sent_s if logged.target else logged.begin_s
    return MatchedMotion(
        number,
        ExecutedMove(step, frozen([time_s for time_s, _ in found]), frozen(counts)),
        frozen(q - nearest),
        sum(s.duration_ms for s in logged.segments or path.segments) / 1e3,
        None if logged.ready_s is None else logged.ready_s - begin_s,
    )


class OnPath:
    """Map the samples of a motion to its planned path, one after the other; the time on the path never decreases.

    Args:
        path: of the motion.
        unit: of its counts.
    """

    def __init__(self, path: CountPath, unit: Unit) -> None:
        count = max(1, int(np.ceil(path.duration_s / STEP_S)))
        self._grid = np.linspace(0.0, path.duration_s, count + 1)
        self._planned = unit.positions(path.at(self._grid))
        self._ends = path.knot_times()
        self._last = 0

    def place(self, q: Array, segment: int | None) -> tuple[float, Array]:
        """Return the nearest point of the path: its time on the path's clock, and joint positions (6,) rad.

        Args:
            q: the sample, (6,) rad.
            segment: index of the segment that ran, -1 before the first, or None if not known.
        """
        grid, ends = self._grid, self._ends
        first, end_s = self._last, grid[self._last] + BLIND_S
        if segment is not None:
            end_s = ends[min(max(segment + 1, 0), len(ends) - 1)]
            first = max(first, int(np.searchsorted(grid, ends[max(segment - LAG_SEGMENTS, 0)])) - 1)
        stop = max(first + 1, int(np.searchsorted(grid, end_s, side="right")))
        index, share = _on_lines(self._planned[first : stop + 1], q)
        low, high = first + index, min(first + index + 1, len(grid) - 1)
        self._last = low
        planned = self._planned[low] + share * (self._planned[high] - self._planned[low])
        return float(grid[low] + share * (grid[high] - grid[low])), planned


def _on_lines(knots: Array, here: Array) -> tuple[int, float]:
    """Index of the line between neighbouring knots that is nearest to a point, and the place on it, 0 to 1."""
    if len(knots) < 2:
        return 0, 0.0
    begin, line = knots[:-1], np.diff(knots, axis=0)
    length2 = np.einsum("ij,ij->i", line, line)
    along = np.einsum("ij,ij->i", here - begin, line)
    share = np.clip(np.divide(along, length2, out=np.zeros_like(along), where=length2 > 0.0), 0.0, 1.0)
    off = begin + share[:, None] * line - here
    index = int(np.argmin(np.einsum("ij,ij->i", off, off)))
    return index, float(share[index])
