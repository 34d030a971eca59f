"""Ways along a curve: chains of the layered graph, smoothed and certified.

A chain (`plan.curve.graph`) shows on which side of a body there is room; it is jagged. Smoothing
(`plan.curve.smoothing`) makes it fast. The spline through the result is compared with the curve and certified; where it
leaves what is free, it gets more stations, and where a certificate fails, it is smoothed again with more room.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.se3 import Array, Bools, frozen
from plan.cartesian.line import JointPath
from plan.collision.bezier import curve_of_path
from plan.collision.certificate import certify_curve
from plan.collision.search_margin import LINE_MARGIN, searched_clearance
from plan.collision.world import World
from plan.curve.graph import Chain, CurveGraph
from plan.curve.smoothing import Demand, Followed, Smoothing
from plan.curve.tool_curve import ToolCurve
from plan.failure import nearness
from plan.kinematics.product_of_exponentials import product_of_exponentials

TOLERANCE = 5e-5  # m, by which the tool may be beyond what is free, and
ANGLE_TOLERANCE = 1e-3  # rad
_MARGIN = 5e-4  # m, clearance of chains beyond the required one
_ROUNDS, _MORE_ROUNDS = 24, 3  # steps of the smoothing of a chain, and with more stations
_ROOM = 5e-3  # rad (m), to the limits of the joints, for what lies between stations
_MOST_STATIONS = 120  # with which a path is still smoothed after stations were added
_FINER = 8  # times that stations are added where the spline is off
_GIVEN = 2e-4  # m, of the largest distance, for the sake of time
_WIDER = (0.0, 5e-4, 1.5e-3)  # m, further clearance of the smoothing, after a certificate has failed


class CurvePlanner:
    """Plans ways along one curve in one world.

    Args:
        name: of the target, for messages.
        robot: an arm with closed-form inverse kinematics.
        curve: what the tool follows.
        world: the arm and all bodies.
        clearance: required, m.
        limits: of the joints.
        widened: names of bodies whose least distance is maximised, of all if empty; None: time alone is the aim.

    Raises:
        InputError: the arm has no closed form.
    """

    def __init__(
        self,
        name: str,
        robot: Robot,
        curve: ToolCurve,
        world: World,
        clearance: float,
        limits: Limits,
        widened: frozenset[str] | None = None,
    ) -> None:
        self.name, self.robot, self.curve, self.world = name, robot, curve, world
        self.clearance = clearance
        self.every = np.ones(len(world.pairs), dtype=bool)
        self.widened = None if widened is None else world.pairs_of(widened) if widened else self.every
        room = np.minimum(_ROOM, (limits.upper - limits.lower) / 4.0)
        self.limits = replace(limits, lower=frozen(limits.lower + room), upper=frozen(limits.upper - room))

    def chains(self, most: int, q_start: Array | None = None) -> list[Chain]:
        """Return the fastest clear chains, at most one for each branch of the inverse kinematics.

        Args:
            most: no more than these.
            q_start: (n,) rad, where they begin; default: anywhere.

        Raises:
            ImpossibleError: there is none; see `CurveGraph.impossible`.
        """
        clearance = self.clearance + _MARGIN
        if q_start is not None:  # a start that is given has what it has
            clearance = searched_clearance(self.world, [q_start], self.clearance, _MARGIN)
        graph = CurveGraph(self.robot, self.curve, self.world, clearance, self.limits, q_start)
        found = list(islice(graph.chains(), most))
        if not found:
            raise graph.impossible(self.name, self.clearance)
        return found

    def followed(self, chain: Chain, fixed: bool = False) -> JointPath:
        """Return the certified path of the joints that begins as a chain and is fast.

        Args:
            chain: one of `chains`.
            fixed: whether it begins exactly where the chain does.

        Raises:
            ImpossibleError: no path near the chain can be certified, or stays on the curve.
        """
        seen: ImpossibleError | None = None
        for wider in _WIDER:
            demand = Demand(self.clearance + LINE_MARGIN + wider, self.every)
            smoothing = Smoothing(self.robot, self.curve, self.world, [demand], self.limits, fixed)
            coordinates = np.array(chain.coordinates)
            coordinates[:, 5] = _unwrapped(coordinates[:, 5])
            way = smoothing.at(chain.places, coordinates, chain.q)
            if way is None:
                break
            if self.widened is not None:
                smoothing, way = self._widened(smoothing, way, self.widened)
            # positions at their limits may bend the path too sharply; then they stay as the chain has them
            for shifts in (True, False) if self.widened is None else (True,):
                try:
                    return self._certified(smoothing, way, shifts)
                except ImpossibleError as error:
                    seen = error
        why = f"path {self.name!r}: the tool cannot be kept on it near {chain.branch}"
        raise seen or ImpossibleError(why, target=self.name, length_m=self.curve.length)

    def _widened(self, smoothing: Smoothing, way: Followed, pairs: Bools) -> tuple[Smoothing, Followed]:
        """Return the way with the largest least distance of pairs (p,), and a smoothing that keeps it."""
        wide = smoothing.widened(way, _ROUNDS, pairs)
        demands = [*smoothing.demands, Demand(smoothing.least(wide, pairs) - _GIVEN, pairs)]
        return Smoothing(self.robot, self.curve, self.world, demands, self.limits, smoothing.fixed), wide

    def _certified(self, smoothing: Smoothing, way: Followed, shifts: bool) -> JointPath:
        # turns first: with all that is free at once, steps more often end in a slow way
        smooth = smoothing.smoothed(way, _ROUNDS, turns_only=True)
        smooth = smoothing.smoothed(smooth, _ROUNDS) if shifts else smooth
        beyond = self.beyond(smooth)
        for _ in range(_FINER):
            if beyond.max() <= 1.0:
                break
            finer = smoothing.finer(smooth, _with_neighbours(beyond > 1.0))
            if finer is None:
                break
            few = len(finer.q) <= _MOST_STATIONS
            smooth = smoothing.smoothed(finer, _MORE_ROUNDS, turns_only=not shifts) if few else finer
            beyond = self.beyond(smooth)
        if (off := float(beyond.max())) > 1.0:
            raise ImpossibleError(
                f"path {self.name!r}: the tool leaves it by {off:.1f} times what is allowed; the arm is close to a "
                "singular configuration, or the path has a corner; round it, or free more directions",
                target=self.name,
                length_m=self.curve.length,
            )
        path = JointPath(smooth.q, frozen(smooth.places))
        check = certify_curve(self.world, curve_of_path(path.spline), self.clearance + LINE_MARGIN)
        if not check.proved:
            raise ImpossibleError(
                f"path {self.name!r}: {nearness(check.pair, check.seen, self.clearance)}",
                target=self.name,
                pair=list(check.pair),
                distance_m=check.seen,
                clearance_m=self.clearance,
                **self.world.state(path.spline(check.time)),
            )
        return path

    def beyond(self, way: Followed) -> Array:
        """Return the largest deviation of the spline through a way in each step (m - 1,), in tolerances."""
        path = JointPath(way.q, way.places)
        between = (way.places[:-1, None] + np.diff(way.places)[:, None] * np.array([0.25, 0.5, 0.75])).ravel()
        poses = product_of_exponentials(self.robot).tool_poses(path.spline(between))
        off = self.curve.deviation(poses, None, between / self.curve.length)
        worst = np.maximum(off.distance / TOLERANCE, off.angle / ANGLE_TOLERANCE)
        return np.asarray(worst.reshape(-1, 3).max(axis=1))


def _with_neighbours(steps: Bools) -> Bools:
    """Return the steps (k,) with the one before and the one after each: a spline's change of spacing stays near."""
    wide = steps.copy()
    wide[1:] |= steps[:-1]
    wide[:-1] |= steps[1:]
    return wide


def _unwrapped(angles: Array) -> Array:
    """Return angles (m,) rad without jumps of whole revolutions."""
    steps = np.diff(angles)
    return np.concatenate(
        [angles[:1], angles[0] + np.cumsum(steps - 2.0 * np.pi * np.rint(steps / (2.0 * np.pi)))]
    )
