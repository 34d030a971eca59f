"""The one cause of a task's refusal, chosen from all that the search rejected.

The search records why it rejected each line and leg. The cause is a place out of reach, a place with all its lines
blocked, a start too near to a body, or a leg that is blocked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.cartesian.reachability import GraspCandidate, ReachTable
from plan.collision.world import World
from plan.failure import (
    AFTER_TIMING,
    LINE_BLOCKED,
    OUT_OF_REACH,
    START_BLOCKED,
    TRANSIT_BLOCKED,
    Failure,
    Rejected,
    nearness,
    of_choice,
    short_of,
)
from plan.options import PlanOptions
from plan.program.assignment.legs import Site
from plan.program.assignment.worlds import TaskWorlds
from plan.scene import Scene, Transfer


def find_cause(
    error: ImpossibleError,
    scene: Scene,
    transfers: Sequence[Transfer],
    q_start: Array,
    options: PlanOptions,
    table: ReachTable,
) -> ImpossibleError:
    """Return the error with its cause as the message, and with ``failure`` in its data.

    Args:
        error: error of the search, or of reach.
        scene, transfers, q_start, options: those of the request.
        table: reach of all places of the transfers, and of all that could be chosen.
    """
    failure = _Cause(error, scene, transfers, q_start, options, table).found()
    data = dict(error.data)
    if "rejected" in data:  # the failure says where those are that matter
        data["rejected"] = [{k: v for k, v in entry.items() if k != "at"} for entry in data["rejected"]]
    return ImpossibleError(failure.headline, **data, failure=failure.to_json())


@dataclass(frozen=True, eq=False)
class _Cause:
    """The arguments of `find_cause`."""

    error: ImpossibleError
    scene: Scene
    transfers: Sequence[Transfer]
    q_start: Array
    options: PlanOptions
    table: ReachTable

    @property
    def moved(self) -> set[str]:
        """Names of the cubes to move."""
        return {t.cube for t in self.transfers}

    @property
    def rejected(self) -> list[dict[str, Any]]:
        """The data of the refusals of lines and legs."""
        return list(self.error.data.get("rejected", ()))

    def found(self) -> Failure:
        if "holes" in self.error.data:
            return out_of_reach(self.error, self.table)
        if "proved_m" in self.error.data:
            return self._after_timing({"reason": str(self.error), **self.error.data})
        return self._start() or self._lines() or self._across() or self._search_ended()

    def _start(self) -> Failure | None:
        world = World(self.scene.robot_open, (*self.scene.bodies, *self.scene.cubes))
        closest = world.distance(self.q_start)
        if closest.value >= self.options.clearance:
            return None
        near = _Near(closest.pair, closest.value, world.state(self.q_start)["at"])
        start = _too_near("start", near, self.options.clearance)
        headline = f"the arm cannot leave its start, where {start.reason}"
        return Failure(START_BLOCKED, "start", (), headline, (start,), self._body(closest.pair))

    def _lines(self) -> Failure | None:
        """Return the failure of a place with all grasps in reach blocked: by fixed bodies, or else by cubes too."""
        picks = {t.pick.name for t in self.transfers}
        for with_cubes in (False, True):
            entries = {h.hole: self._blocked_at(h.hole, with_cubes) for h in self.table.holes if h.ok}
            closed = [
                h for h in entries if set(entries[h]) >= {(c.yaw, c.branch) for c in self.table[h].feasible()}
            ]
            open_places = set(entries) - set(closed) - picks
            enough = self.options.assignment == "free" and len(open_places) >= len(self.transfers)
            for name in closed:
                if name in picks or not enough:
                    return self._line(name, entries[name])
        return None

    def _blocked_at(self, station: str, with_cubes: bool) -> dict[tuple[int, str], dict[str, Any]]:
        found: dict[tuple[int, str], dict[str, Any]] = {}
        for entry in self.rejected:
            if entry.get("station") == station and (with_cubes or not self._in_a_cubes_way(entry)):
                found.setdefault((entry["yaw"], entry["branch"]), entry)
        return found

    def _in_a_cubes_way(self, entry: Mapping[str, Any]) -> bool:
        """Return whether the obstacle is a cube that the task moves, other than the held one."""
        first, second = (_own_name(name) for name in entry["pair"])
        arm = {b.name for b in self.scene.robot_open.bodies}
        return second in self.moved or (first in self.moved and second in arm)

    def _line(self, name: str, entries: Mapping[tuple[int, str], dict[str, Any]]) -> Failure:
        hole = self.table[name]
        worlds = worlds_at(self.scene, self.transfers, name)
        grasps = []
        for grasp in hole.feasible():
            entry = entries[grasp.yaw, grasp.branch]
            nearest = _nearest(worlds, grasp.q_line, _Near.of(entry))
            grasps.append(_too_near(f"line at {name}", nearest, self.options.line_clearance, grasp))
        grasps.sort(key=_miss)
        near, (cube, direction) = grasps[0], self._cube_at(name)
        count = f"all {len(grasps)} grasps in reach are" if len(grasps) > 1 else "the only grasp in reach is"
        headline = (
            f"{cube} cannot be moved {direction} {name}: {count} blocked; with yaw {near.yaw}, {near.branch}, "
            f"{near.reason}"
        )
        others = tuple(of_choice(c) for c in hole.choices if not c.ok)
        body = self._most_named(grasp.pair for grasp in grasps if grasp.pair)
        return Failure(LINE_BLOCKED, f"line at {name}", (name,), headline, (*grasps, *others), body)

    def _cube_at(self, station: str) -> tuple[str, str]:
        for t in self.transfers:
            if t.pick.name == station:
                return t.cube, "from"
            if t.place.name == station and self.options.assignment == "given":
                return t.cube, "to"
        return "a cube", "to"

    def _across(self) -> Failure | None:
        legs = [entry for entry in self.rejected if "from" in entry]
        if not legs:
            return None
        body = self._most_named(entry["pair"] for entry in legs)
        entry = next((e for e in legs if self._body(e["pair"]) == body), legs[0])
        step = f"from {entry['from']} to {entry['to']}"
        stations = tuple(n for n in (entry["from"], entry["to"]) if n in {h.hole for h in self.table.holes})
        for name in stations:
            tight = self._tight_offsets(name)
            if tight:
                near = tight[0]
                headline = (
                    f"no path {step}: {self.options.offset * 1e3:g} mm from {name}, where the lines of its "
                    f"{len(tight)} grasps begin, there is too little room; with yaw {near.yaw}, {near.branch}, "
                    f"{near.reason}"
                )
                body = self._most_named(w.pair for w in tight if w.pair)
                return Failure(TRANSIT_BLOCKED, step, (name,), headline, tight, body)
        rejected = tuple(
            _too_near(_where(e), _Near.of(e), self.options.clearance)
            for e in (entry, *(e for e in legs if e is not entry))
        )
        return Failure(TRANSIT_BLOCKED, step, stations, entry["reason"], rejected, body)

    def _tight_offsets(self, name: str) -> tuple[Rejected, ...]:
        """Return the open grasps of a place as rejections, if none keeps the clearance at the outer end of its line."""
        closed, worlds = self._blocked_at(name, True), worlds_at(self.scene, self.transfers, name)
        where, required, grasps = f"{name}, outer end of the line", self.options.clearance, []
        for grasp in self.table[name].feasible():
            if (grasp.yaw, grasp.branch) in closed:
                continue
            nearest = _nearest(worlds, grasp.q_line[-1:], _Near(("", ""), float("inf"), None))
            if nearest.distance >= required:
                return ()
            grasps.append(_too_near(where, nearest, required, grasp))
        return tuple(sorted(grasps, key=_miss))

    def _after_timing(self, entry: Mapping[str, Any]) -> Failure:
        step, pair, required = entry["step"], entry["pair"], entry["clearance_m"]
        sent = _too_near(step, _Near.of(entry), required)
        if entry["distance_m"] >= required:
            proved = (
                f"only {short_of(entry['proved_m'], required)} mm between {pair[0]} and {pair[1]} are proved"
            )
            sent = replace(sent, reason=f"{proved} (required: {required * 1e3:g} mm)")
        headline = f"step {step!r}, as it would be sent: {sent.reason}; require less clearance or move the bodies apart"
        return Failure(AFTER_TIMING, step, (), headline, (sent,), self._body(pair))

    def _search_ended(self) -> Failure:
        for entry in self.rejected:
            if "proved_m" in entry:
                return self._after_timing(entry)
        return Failure(TRANSIT_BLOCKED, "search", (), str(self.error), ())

    def _body(self, pair: Iterable[str]) -> str | None:
        """Return the one of two bodies that belongs neither to the arm nor to the held cube."""
        names = [_own_name(name) for name in pair]
        known = {b.name for b in (*self.scene.bodies, *self.scene.cubes)}
        still = [name for name in names if name in known - self.moved]
        return next(iter(still + [name for name in names if name in known]), None)

    def _most_named(self, pairs: Iterable[Iterable[str]]) -> str | None:
        count = Counter(body for pair in pairs if (body := self._body(pair)) is not None)
        return min(count, key=lambda name: (-count[name], name)) if count else None


@dataclass(frozen=True, eq=False)
class _Near:
    """Two bodies, their distance in m, and where that is (`World.state`)."""

    pair: tuple[str, str]
    distance: float
    at: Mapping[str, Any] | None

    @staticmethod
    def of(entry: Mapping[str, Any]) -> _Near:
        first, second = entry["pair"]
        return _Near((first, second), entry["distance_m"], entry.get("at"))


def _too_near(where: str, near: _Near, required: float, grasp: GraspCandidate | None = None) -> Rejected:
    """Return the rejection of what comes too near to a body; `required` in m."""
    yaw, branch = (None, None) if grasp is None else (grasp.yaw, grasp.branch)
    names, lengths = near.pair, (near.distance * 1e3, required * 1e3)
    reason = nearness(names, near.distance, required)
    return Rejected(
        where, reason, yaw, branch, pair=names, distance_mm=lengths[0], required_mm=lengths[1], at=near.at
    )


def _miss(grasp: Rejected) -> tuple[object, ...]:
    """Return the key that sorts the nearest miss first."""
    return -round(grasp.distance_mm or 0.0, 3), grasp.yaw, grasp.branch


def _where(leg: Mapping[str, Any]) -> str:
    """Return the end of a leg that is itself too near, or the leg."""
    return f"{leg[leg['end']]}" if "end" in leg else f"from {leg['from']} to {leg['to']}"


def _own_name(name: str) -> str:
    """Return the name of a body; the search names a placed cube differently."""
    return name.split(" at ")[0]


def _nearest(worlds: Iterable[World], q: Array, known: _Near) -> _Near:
    """Return the closest pair over configurations q (m, n), or `known` if that is closer."""
    for world in worlds:
        for row in q:
            closest = world.distance(row)
            if closest.value < known.distance - 1e-9:
                known = _Near(closest.pair, closest.value, world.state(row)["at"])
    return known


def out_of_reach(error: ImpossibleError, table: ReachTable) -> Failure:
    """Return the failure in an error of `plan.cartesian.reachability.ReachTable.require`."""
    failing = {entry["hole"] for entry in error.data["holes"]}
    ways = tuple(of_choice(c) for h in table.holes if h.hole in failing for c in h.choices)
    names = tuple(h.hole for h in table.holes if h.hole in failing)
    return Failure(OUT_OF_REACH, f"line at {names[0]}", names, str(error), ways)


def worlds_at(scene: Scene, transfers: Sequence[Transfer], station: str) -> tuple[World, ...]:
    """Return the worlds of a place's lines without the other moving cubes; none if no transfer uses the place."""
    for t in transfers:
        if station in (t.pick.name, t.place.name):
            others = {other.cube for other in transfers} - {t.cube}
            left = replace(
                scene, cubes=tuple(c for c in scene.cubes if c.name not in others), allowed=frozenset()
            )
            at = TaskWorlds(left, [t], [t.place])
            if station == t.pick.name:
                return at.empty(frozenset([Site(False, 0)])), at.holding(0, frozenset(), t.pick.touches)
            return at.holding(0, frozenset(), t.place.touches), at.empty(frozenset([Site(True, 0)]))
    return ()
