"""Transits: straight in joint space if that is certified, else on a path around bodies.

The search has stages. Budgets are counted in attempts, and random numbers come from the given seed, so the same request
gives the same way-points:

1. paths over one or two corners (`plan.transit.corners`), in the order of their travel time; the first few that differ
   are optimised for time (`plan.transit.optimise`);
2. if none of these is collision-free, RRT-Connect (`plan.transit.rrt_connect`), shortcuts (`plan.transit.shortcuts`)
   and the same optimisation.

The search checks samples, by coal's collision test. Every edge of the returned path is certified
(`plan.collision.certificate`); an edge that cannot be proved gets another way-point (`plan.transit.proofs`). A caller
that certifies the motion as it is sent can leave out the proofs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np
import numpy.typing as npt

from arm.arguments import integer
from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array, frozen
from plan.budget import TransitBudget
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.missing_srdf import self_collision_help
from plan.collision.world import World
from plan.kinematics.configuration import check_configuration
from plan.transit.corners import FewCorners
from plan.transit.edges import SampledEdges
from plan.transit.near_ends import NearEnd, leave_near_end
from plan.transit.optimise import Ends, Shortening, TransitOptimiser
from plan.transit.proofs import PathProof
from plan.transit.rrt_connect import RrtConnect
from plan.transit.shortcuts import shortened

# Duration of the best path relative to the straight one: above `_POOR`, more paths are optimised; up to `_ALMOST`, the
# first ones suffice.
_POOR = 1.25
_ALMOST = 1.1
# Number of earlier paths to reuse, and the distance of their samples, rad summed over the joints.
_REMEMBERED, _SAMPLE_TRAVEL = 6, 0.2
# Distances of the samples on edges of trees, rad summed over the joints: the next one is used if the proof fails.
_RESOLUTIONS = 0.15, 0.05, 0.02
_FINER = 3.0  # factor by which samples are denser on the edges of a way-point that is added by a proof
_MARGINS = 1e-3, 2.5e-4  # m, added to the clearance of samples if both ends have it


@dataclass(frozen=True)
class Transit:
    """Way-points whose straight joint lines are certified.

    Attributes:
        waypoints: (m, n) rad.
        clearances: certified clearance of each line, (m - 1,) m: the required one, or less at a near end.
        near_ends: the ends with less than the required clearance.
    """

    waypoints: Array
    clearances: tuple[float, ...]
    near_ends: tuple[NearEnd, ...] = ()


def plan_transit(
    world: World,
    q_from: npt.ArrayLike,
    q_to: npt.ArrayLike,
    limits: Limits,
    clearance: float,
    seed: int,
    budget: TransitBudget | None = None,
    ends: Ends | None = None,
) -> Array:
    """Return way-points (m, n) rad from `q_from` to `q_to` such that the straight lines between them are certified.

    An end with less than the required clearance is refused; `find_transit` accepts it.

    Args:
        world: bodies to avoid.
        q_from, q_to: (n,) rad.
        limits: limits of position; velocity and acceleration rank the paths.
        clearance: required between all checked pairs, m.
        seed: seed of all random choices.
        budget: budget of the search.
        ends: velocities at both ends; default: at rest.

    Raises:
        InputError: an end is beyond a limit, or not one finite number per joint.
        ImpossibleError: an end itself is too near to a body, or no path was found; data: pair, distance_m (of the
            straight motion), end ("from", "to" or None).
    """
    start, goal = _checked_ends(world, q_from, q_to, limits)
    for end, q in (("from", start), ("to", goal)):
        if world.in_collision(q, clearance):
            raise _end_blocked(world, end, q, clearance)
    return find_transit(world, start, goal, limits, clearance, seed, budget, ends).waypoints


def find_transit(
    world: World,
    q_from: npt.ArrayLike,
    q_to: npt.ArrayLike,
    limits: Limits,
    clearance: float,
    seed: int,
    budget: TransitBudget | None = None,
    ends: Ends | None = None,
) -> Transit:
    """Plan a transit as `plan_transit` does, but accept an end with less than the required clearance.

    The line between such an end and the next way-point, which has the required clearance, is certified with what the
    end has; see `Transit`.

    Raises:
        InputError: as `plan_transit`.
        ImpossibleError: as `plan_transit`; an end is refused if it touches a body, or if no line from it was found.
    """
    start, goal = _checked_ends(world, q_from, q_to, limits)
    rng = np.random.default_rng(integer("seed", seed, 0))
    near: dict[str, NearEnd] = {}
    inner = {"from": start, "to": goal}
    for end, q in (("from", start), ("to", goal)):
        if world.in_collision(q, clearance):
            left = leave_near_end(world, limits, end, q, clearance, rng)
            if left is None:
                raise _end_blocked(world, end, q, clearance)
            near[end], inner[end] = left, left.waypoint
    search = TransitPlanner(world, limits, clearance, rng, budget or TransitBudget(), ends)
    waypoints = search.certified(inner["from"], inner["to"])
    clearances = [clearance] * (len(waypoints) - 1)
    if "from" in near:
        waypoints, clearances = [start, *waypoints], [near["from"].clearance, *clearances]
    if "to" in near:
        waypoints, clearances = [*waypoints, goal], [*clearances, near["to"].clearance]
    return Transit(frozen(waypoints), tuple(clearances), tuple(near.values()))


def _checked_ends(
    world: World, q_from: npt.ArrayLike, q_to: npt.ArrayLike, limits: Limits
) -> tuple[Array, Array]:
    start = check_configuration("q_from", q_from, world.robot, limits)
    return start, check_configuration("q_to", q_to, world.robot, limits)


def _end_blocked(world: World, end: str, q: Array, clearance: float) -> ImpossibleError:
    closest = world.distance(q)
    where = "start" if end == "from" else "end"
    return ImpossibleError(
        f"the {where} of the motion is itself too near: {closest.pair[0]} and {closest.pair[1]} are "
        f"{closest.value * 1e3:.1f} mm apart (required: {clearance * 1e3:g} mm)"
        + self_collision_help(world, q, clearance),
        pair=list(closest.pair),
        distance_m=closest.value,
        clearance_m=clearance,
        end=end,
        **world.state(q),
    )


class TransitPlanner:
    """Finds paths around bodies in one world.

    Args:
        world, limits, clearance: as in `plan_transit`.
        rng: source of all random choices.
        budget: budget of the search.
        ends: velocities at both ends; default: at rest.
        known: corners (c, n) of earlier paths, which are tried first; those of a new path are appended.
        slack: paths are certified with this much less than `clearance`, m, because the search checks only samples.
        prove: whether paths are certified; else they are checked at fine samples.
    """

    def __init__(
        self,
        world: World,
        limits: Limits,
        clearance: float,
        rng: np.random.Generator,
        budget: TransitBudget,
        ends: Ends | None = None,
        known: list[Array] | None = None,
        slack: float = 0.0,
        prove: bool = True,
    ) -> None:
        self.world, self.limits, self.clearance, self.rng, self.budget = world, limits, clearance, rng, budget
        still = np.zeros(len(limits.velocity))
        self.ends = ends or Ends(still, still)
        self.known = [] if known is None else known
        self.slack, self.prove = slack, prove
        self.too_near = world.too_near(clearance)
        self.optimiser = TransitOptimiser(world, limits, clearance, self.ends)
        self.time = self.optimiser.time

    def certified(self, start: Array, goal: Array) -> list[Array]:
        """Return certified way-points between two ends that have the clearance.

        Raises:
            ImpossibleError: no path was found.
        """
        straight = certify_curve(self.world, curve_of_waypoints([start, goal]), self.clearance)
        if straight.proved:
            return [start, goal]
        found = self.around(start, goal, straight.time)
        if found is None:
            near, body = straight.pair
            raise ImpossibleError(
                f"no path around {body}: {near} comes within {straight.seen * 1e3:.1f} mm of it on the straight motion "
                f"(required: {self.clearance * 1e3:g} mm), and RRT-Connect found no other path with "
                f"{self.budget.rrt} nodes; a smaller clearance or another place of the body may help",
                pair=[near, body],
                distance_m=straight.seen,
                clearance_m=self.clearance,
                end=None,
                **self.world.state(start + straight.time * (goal - start)),
            )
        return list(found)

    def around(self, start: Array, goal: Array, at: float) -> Array | None:
        """Return an optimised path, or None; the straight one is blocked at fraction `at`."""
        straight = self.time(np.stack([start, goal]))
        known = self.over_known_corners(start, goal)
        corners = FewCorners(self.world.robot, self.limits, self.too_near, self.rng, self.budget, self.ends)
        paths = corners.paths(start, goal, at)
        first = chain([] if known is None else [known], islice(paths, self.budget.starts))
        best = self.fastest_accepted(first, _ALMOST * straight)
        if best is None or self.time(best) > _POOR * straight:
            more = self.fastest_accepted(islice(paths, self.budget.more_starts), _POOR * straight)
            if more is not None and (best is None or self.time(more) < self.time(best)):
                best = more
        if best is not None:
            return self.remembered(best)
        return self.by_trees(start, goal)

    def by_trees(self, start: Array, goal: Array) -> Array | None:
        """Return a path by RRT-Connect, or None.

        Trees and shortcuts are checked at samples, with a margin if both ends have it. Only the path is proved (without
        proofs: checked at finer samples); if that fails, the search is repeated with finer samples.
        """
        margin = 0.0 if self.slack else _margin(self.world, (start, goal), self.clearance)
        too_near = self.world.too_near(self.clearance + margin)
        optimiser = TransitOptimiser(self.world, self.limits, self.clearance + margin, self.ends)
        for resolution in _RESOLUTIONS:
            edges = SampledEdges(too_near, resolution)
            rooted = RrtConnect(self.limits, edges, self.rng).search(start, goal, self.budget.rrt)
            if rooted is None:
                return None
            finer = SampledEdges(too_near, resolution / _FINER)
            proof = PathProof(self.world, self.limits, self.clearance - self.slack, finer, self.rng)
            for path in self._trials(rooted, edges, finer, optimiser):
                if not self.prove and finer.path_clear(path):
                    return self.remembered(path)
                found = proof.mended(path)
                if found is not None:
                    return self.remembered(found)
        return None

    def _trials(
        self, rooted: Array, edges: SampledEdges, finer: SampledEdges, optimiser: TransitOptimiser
    ) -> Iterator[Array]:
        """Yield a path of trees, the fastest form first: optimised, with shortcuts by coarse and by fine samples."""
        short = self._shortened(rooted, edges)
        faster = optimiser.shorten(short, self.budget.steps)
        if faster is not None:
            yield faster
        yield short
        yield self._shortened(rooted, finer)
        yield rooted

    def _shortened(self, path: Array, edges: SampledEdges) -> Array:
        """Return a path of trees after shortcuts that are clear at the samples of `edges`."""
        return shortened(path, edges, self.limits, self.time, self.rng, self.budget.shortcuts)

    def fastest_accepted(self, paths: Iterable[Array], enough: float) -> Array | None:
        """Optimise paths, and return the first one that is accepted in order of their estimated time, or None.

        No further path is optimised once one takes at most `enough` s.
        """
        steps, rough = self.budget.steps, list[Shortening]()
        first = max(steps // 3, 2)
        for path in paths:
            rough.append(Shortening(self.optimiser, path))
            rough[-1].run(first)
            if rough[-1].time <= enough:
                break
        for shortening in sorted(rough, key=lambda s: round(s.time, 6)):
            begun = shortening.path
            shortening.run(steps - first)
            settled = shortening.settled()
            if settled is not None and (not self.prove or self.proved(settled)):
                return settled
            if self.prove and self.proved(begun):
                return begun
        return None

    def remembered(self, path: Array) -> Array:
        """Append the corners of a path to the known ones and return the path."""
        self.known.append(path[1:-1])
        return path

    def over_known_corners(self, start: Array, goal: Array) -> Array | None:
        """Return the fastest path over known corners that has no sample in collision, or None."""
        paths = [np.concatenate([start[None], corners, goal[None]]) for corners in self.known[-_REMEMBERED:]]
        for path in sorted(paths, key=lambda w: round(self.time(w), 6)):
            if not self.optimiser.blocked(path, _SAMPLE_TRAVEL, 1):
                return path
        return None

    def proved(self, path: Array) -> bool:
        """Return whether every edge is certified."""
        return certify_curve(self.world, curve_of_waypoints(path), self.clearance - self.slack).proved


def _margin(world: World, ends: Iterable[Array], clearance: float) -> float:
    """Return the largest of a few margins, m, that both ends have beyond `clearance`; 0 if there is none.

    There are only a few, because the world keeps a broadphase for each clearance.
    """
    for margin in _MARGINS:
        if not any(world.in_collision(q, clearance + margin) for q in ends):
            return margin
    return 0.0
