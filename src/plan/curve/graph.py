"""Chains of configurations along a curve: the fastest clear path through a layered graph of its free directions.

Each station of the curve is a layer. Its nodes are the inverse kinematics solutions at all samples of the free
directions (`plan.curve.samples`); edges join neighbouring samples of neighbouring stations on the same branch (ladder
graphs: Descartes, ROS-Industrial). Dynamic programming finds the fastest chain. Only the nodes and edges of that chain
are checked for collisions; what is blocked is left out, and the fastest chain is computed again, from the first station
that changed (lazy evaluation: C. Dellin, S. Srinivasa, "A unifying formalism for shortest path problems with expensive
edge evaluations via lazy best-first search over paths with edge selectors", ICAPS 2016).
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.se3 import Array, Bools, Indices, frozen
from plan.collision.world import World
from plan.curve.samples import Samples, samples_of
from plan.curve.tool_curve import ToolCurve
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches
from plan.kinematics.freedom import coordinates_of
from plan.kinematics.ik import BranchReport, explain_pose, nearest_turns
from plan.kinematics.nearest import AskedPose

STEP = 0.008  # m (or 0.16 rad of turn) between stations
_JUMP = 0.5  # rad, largest motion of a joint from station to station
_HALF = 0.12  # rad; an edge with a longer motion of a joint is checked in its middle too
_MISSES = 200  # refused configurations at one station whose distances are compared


@dataclass(frozen=True, eq=False)
class Chain:
    """A clear chain: one configuration at each station.

    Attributes:
        places: (m,) of the stations on the curve, m.
        coordinates: (m, 6) of the free directions there.
        q: (m, n) rad.
        branch: of the inverse kinematics.
        time: estimate, s.
    """

    places: Array
    coordinates: Array
    q: Array
    branch: str
    time: float


class CurveGraph:
    """The layered graph of a curve for one arm in one world.

    Args:
        robot: an arm with closed-form inverse kinematics.
        curve: what the tool follows.
        world: the arm and all bodies.
        clearance: required, m.
        limits: of the joints.
        q_start: (n,) rad, where the arm is at the start of the curve; default: any solution there.
    """

    def __init__(
        self,
        robot: Robot,
        curve: ToolCurve,
        world: World,
        clearance: float,
        limits: Limits,
        q_start: Array | None = None,
    ) -> None:
        self.robot, self.curve, self.limits = robot, curve, limits
        self.world, self.clearance = world, clearance
        self.places = curve.stations(STEP)
        self.samples: Samples = samples_of(curve)
        T = curve.placed(
            self.places[:, None].repeat(len(self.samples.coordinates), axis=1).ravel(),
            np.tile(self.samples.coordinates, (len(self.places), 1)),
        )
        raw = all_branches(robot, T, exact=False)
        q = nearest_turns(raw.q, (limits.lower + limits.upper) / 2.0)
        inside = ((q >= limits.lower) & (q <= limits.upper)).all(axis=2)
        shape = len(self.places), len(self.samples.coordinates), len(BRANCH_NAMES)
        self.reached = (raw.reached & inside).reshape(shape)
        self.q = q.reshape(*shape, -1)
        self.coordinates = np.tile(self.samples.coordinates, (shape[0], 1, 1))
        if q_start is not None:
            self._begin_at(q_start)
        self.refused: list[list[Array]] = [[] for _ in self.places]  # configurations in collision, by station
        self.farthest = -1  # last station to which a clear chain leads, once all chains were asked for

    def _begin_at(self, q_start: Array) -> None:
        """Leave one node at the first station: the sample and branch nearest to q_start, moved there."""
        now = coordinates_of(self.curve.poses(np.zeros(1)), self.robot.T_base_tool(q_start)[None])[0]
        apart = self.samples.coordinates - now
        apart[:, 5] -= 2.0 * np.pi * np.rint(apart[:, 5] / (2.0 * np.pi))
        sample = int(np.argmin(np.round((apart**2).sum(axis=1), 9)))
        branch = int(np.argmin(np.round(np.abs(self.q[0, sample] - q_start).max(axis=1), 9)))
        self.reached[0] = False
        self.reached[0, sample, branch] = True
        self.q[0, sample, branch], self.coordinates[0, sample] = q_start, now

    def chains(self) -> Iterator[Chain]:
        """Yield the fastest clear chain of every branch that has one, the fastest first."""
        reached: Bools = np.asarray(self.reached.any(axis=1))
        branches = {b: _Branch(self, b) for b in range(len(BRANCH_NAMES)) if reached[:, b].all()}
        heap = [(branch.time, b) for b, branch in branches.items() if np.isfinite(branch.time)]
        heapq.heapify(heap)
        while heap:
            _, b = heapq.heappop(heap)
            branch = branches[b]
            if branch.checked():
                yield branch.chain()
            elif np.isfinite(branch.time):
                heapq.heappush(heap, (branch.time, b))
        gaps = [int(np.argmin(some)) - 1 for some in reached.T if not some.all()]
        self.farthest = max([*gaps, *(branch.farthest for branch in branches.values())])

    def impossible(self, name: str, clearance: float) -> ImpossibleError:
        """Return why there is no chain: a place is out of reach, or chains end there, and what is nearest there.

        Args:
            name: of the path.
            clearance: what was asked for, m; the graph may have more.
        """
        reached = self.reached.any(axis=(1, 2))
        stuck = int(np.argmin(reached)) if not reached.all() else self._last_refused()
        T_base_tool = self.curve.poses(self.places[stuck : stuck + 1])[0]
        at = ", ".join(f"{1e3 * x:.0f}" for x in T_base_tool[:3, 3])
        place = f"{1e3 * self.places[stuck]:.0f} mm from its start, at ({at}) mm"
        data = {"target": name, "done_m": float(self.places[stuck]), "length_m": self.curve.length}
        data["pose"] = AskedPose(T_base_tool, self.curve.freedom, self.curve.free).to_json()
        if not reached.all():
            branch = self._nearest(stuck)
            return ImpossibleError(
                f"path {name!r}: {place}, the tool is out of reach with everything that is free there: in the "
                f"nearest of all branches {branch.why()}; move the workpiece, or free more directions",
                solutions=0,
                joint=None if branch.outside > 0.0 else branch.joint,
                excess_rad=branch.excess,
                outside_m=branch.outside,
                **data,
            )
        data["solutions"] = int(self.reached.sum())
        refused = self.refused[stuck][-_MISSES:]
        misses = [self.world.distance(q) for q in refused]
        if not misses:
            why = f"path {name!r}: {place}, no solution continues; free more directions"
            return ImpossibleError(why, **data)
        best = max(misses, key=lambda miss: round(miss.value, 9))
        spare = f"{1e3 * clearance:g} mm required and {1e3 * (self.clearance - clearance):g} mm to spare"
        return ImpossibleError(
            f"path {name!r}: no sampled way along it keeps {1e3 * self.clearance:g} mm ({spare}); {place}, the nearest "
            f"miss is {best.pair[0]} {1e3 * best.value:.1f} mm from {best.pair[1]}; move the workpiece, or free more "
            "directions",
            pair=list(best.pair),
            distance_m=best.value,
            clearance_m=clearance,
            **data,
            **self.world.state(refused[misses.index(best)]),
        )

    def _nearest(self, station: int) -> BranchReport:
        """Return the branch that is nearest to the tool at a station, with the best of what is free there."""
        count = len(self.samples.coordinates)
        T = self.curve.placed(np.full(count, self.places[station]), self.samples.coordinates)
        lower, upper = self.limits.lower, self.limits.upper
        reports = [report for pose in T for report in explain_pose(self.robot, pose, lower, upper)]
        return min(reports, key=lambda report: report.miss)

    def _last_refused(self) -> int:
        """Return the station at which the chains that lead farthest end: the last one with a refusal, if there is."""
        stop = min(self.farthest + 1, len(self.places) - 1)
        return next((i for i in range(stop, -1, -1) if self.refused[i]), stop)


class _Branch:
    """The graph of one inverse kinematics branch, and the fastest chain through what is not known to be blocked."""

    def __init__(self, of: CurveGraph, number: int) -> None:
        self.of, self.number = of, number
        self.q, self.open = of.q[:, :, number], of.reached[:, :, number].copy()
        near = of.samples.neighbours
        self.steps = np.empty((len(self.q) - 1, *near.shape))
        for i, (before, after) in enumerate(zip(self.q, self.q[1:], strict=False)):
            moved = np.abs(after[:, None] - before[near])
            times = (moved / of.limits.velocity).max(axis=2)
            times[moved.max(axis=2) > _JUMP] = np.inf
            self.steps[i] = np.round(times, 9)
        self.best = np.full(self.open.shape, np.inf)
        self.back = np.zeros(self.open.shape, dtype=np.intp)
        self.clear = np.zeros(self.open.shape, dtype=bool)  # nodes that were checked
        self.passed: set[tuple[int, int, int]] = set()  # edges that were checked
        self.too_near = of.world.too_near(of.clearance)
        self._solve(0)

    @property
    def time(self) -> float:
        """Estimated time of the fastest chain, s; infinite if there is none."""
        return float(self.best[-1].min())

    @property
    def farthest(self) -> int:
        """Last station to which a chain from the first one leads that is not known to be blocked; -1 for none."""
        return int(np.isfinite(self.best).any(axis=1).sum()) - 1

    def _solve(self, first: int) -> None:
        """Compute the fastest chains again from station `first` on."""
        near = self.of.samples.neighbours
        if first == 0:
            self.best[0] = np.where(self.open[0], 0.0, np.inf)
        rows = np.arange(len(near))
        for i in range(max(first, 1), len(self.q)):
            total = self.best[i - 1][near] + self.steps[i - 1]
            choice = np.argmin(total, axis=1)
            self.back[i] = choice
            self.best[i] = np.where(self.open[i], total[rows, choice], np.inf)

    def nodes(self) -> Indices:
        """Return the sample at each station of the fastest chain (m,)."""
        near = self.of.samples.neighbours
        at = int(np.argmin(self.best[-1]))
        found = [at]
        for i in range(len(self.q) - 1, 0, -1):
            at = int(near[at, self.back[i, at]])
            found.insert(0, at)
        return np.array(found, dtype=np.intp)

    def checked(self) -> bool:
        """Return whether the fastest chain is clear; otherwise leave out what is blocked, and compute it again."""
        nodes = self.nodes()
        changed: list[int] = []
        for i, node in enumerate(nodes.tolist()):
            if self.clear[i, node]:
                continue
            if self.too_near(self.q[i, node]):
                self.of.refused[i].append(self.q[i, node])
                self.open[i, node] = False
                changed.append(i)
            else:
                self.clear[i, node] = True
        for i, (a, b) in enumerate(zip(nodes.tolist(), nodes[1:].tolist(), strict=False)):
            if not (self.clear[i, a] and self.clear[i + 1, b]) or (i, a, b) in self.passed:
                continue
            one, two = self.q[i, a], self.q[i + 1, b]
            if np.abs(two - one).max() > _HALF and self.too_near(0.5 * (one + two)):
                self.of.refused[i + 1].append(0.5 * (one + two))
                # all of them: a row of neighbours may repeat its own sample
                self.steps[i, b, self.of.samples.neighbours[b] == a] = np.inf
                changed.append(i + 1)
            else:
                self.passed.add((i, a, b))
        if changed:
            self._solve(min(changed))
        return not changed

    def chain(self) -> Chain:
        """Return the fastest chain."""
        nodes = self.nodes()
        of = self.of
        return Chain(
            frozen(of.places),
            frozen(of.coordinates[np.arange(len(nodes)), nodes]),
            frozen(self.q[np.arange(len(nodes)), nodes]),
            BRANCH_NAMES[self.number],
            self.time,
        )
