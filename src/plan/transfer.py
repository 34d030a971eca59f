"""One cube from one place to another: which grip, which branch of the arm, and the ways between, chosen by time.

A pairing is a line choice (yaw and branch) at the pick with one at the place. All pairings are ranked by a lower
bound of their motion time; lines and transits are made, and proved, only for those that are tried. The first one in
that order whose transits are all straight is the best there is. If something is in the way of earlier ones, the
fastest few of them are also planned around it, and the best of all is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array, frozen
from arm.unit import Limits
from plan.check import check_curve, curve_of_waypoints
from plan.line import JointPath, Line, follow_line
from plan.options import PlanOptions
from plan.reach import LineChoice
from plan.scene import Station
from plan.stages import Stages
from plan.transit import improve_transit, plan_transit
from plan.travel import path_time, straight_time
from plan.world import Indices, World

# Transits are searched with this much more clearance than is asked, for what timing and rounding change, m.
MARGIN = 1e-3
# How many pairings are tried with straight transits, and how many with ways around (more if there is none yet).
_STRAIGHT = 60
_DETOURS = 3
_DETOURS_AT_MOST = 12
# Times nearer than this are the same, s; what came first is kept, whatever the last bits say.
_TIE = 1e-6


@dataclass(frozen=True)
class Grip:
    """A proved line at a station.

    Attributes:
        station: its name.
        yaw: index into the station's tool poses.
        branch: of the arm, see `plan.ik.BRANCH_NAMES`.
        line: of the tool, from the station to the offset point.
        path: the arm's motion along it.
    """

    station: str
    yaw: int
    branch: str
    line: Line
    path: JointPath

    @property
    def q_offset(self) -> Array:
        """Where the line ends, (n,) rad."""
        return np.asarray(self.path.q[-1])


@dataclass(frozen=True)
class Route:
    """A whole transfer, not timed yet.

    Attributes:
        pick, place: the grips.
        out, across: way-points (m, n) rad of the transits to the pick and to the place.
        back: of the one home, or None.
        time: of the transits, estimated, s.
    """

    pick: Grip
    place: Grip
    out: Array
    across: Array
    back: Array | None
    time: float


class TransferSearch:
    """The search for one transfer.

    Args:
        stages: its collision worlds.
        picks, places: choices that reach, from `plan.reach`.
        q_from: where the arm stands, (n,) rad.
        q_home: where it goes afterwards, or None to stay at the place's offset point.
        limits: that motion is planned under.
        options: clearances, lengths, seed.
    """

    def __init__(
        self,
        stages: Stages,
        picks: Sequence[LineChoice],
        places: Sequence[LineChoice],
        q_from: Array,
        q_home: Array | None,
        limits: Limits,
        options: PlanOptions,
    ) -> None:
        self.stages = stages
        # in an order that no rounding can change
        self.picks, self.places = (sorted(c, key=lambda c: (c.yaw, c.branch)) for c in (picks, places))
        self.q_from, self.q_home, self.limits, self.options = q_from, q_home, limits, options
        self._results: dict[tuple[object, ...], object] = {}

    def best(self) -> Route:
        """The fastest route that was found.

        Raises:
            ImpossibleError: none; data: cube, from, to, and in `rejected` what stopped each choice and pairing.
        """
        bound = self.bounds()
        best: Route | None = None
        blocked: list[tuple[int, int]] = []
        for index in self.order(bound):
            pick, place = (int(i) for i in np.unravel_index(index, bound.shape))
            if len(blocked) >= _STRAIGHT:
                break
            if self.grip("pick", pick) is None or self.grip("place", place) is None:
                continue
            best = self.route(pick, place, straight=True)
            if best is not None:
                break
            blocked.append((pick, place))
        for tried, (pick, place) in enumerate(blocked):
            if tried >= (_DETOURS_AT_MOST if best is None else _DETOURS):
                break
            if best is not None and bound[pick, place] >= best.time:
                break
            route = self.route(pick, place, straight=False)
            if route is not None and (best is None or route.time < best.time - _TIE):
                best = route
        if best is None:
            raise self._impossible()
        return self.improved(best)

    def bounds(self) -> Array:
        """Lower bound of the transits' time for each pairing, (picks, places) s; the lines take about the same."""
        above_pick = np.array([c.q_offset for c in self.picks])
        above_place = np.array([c.q_offset for c in self.places])
        out = straight_time(above_pick - self.q_from, self.limits)
        across = straight_time(above_place[None] - above_pick[:, None], self.limits)
        back = 0.0 if self.q_home is None else straight_time(self.q_home - above_place, self.limits)
        return np.asarray(out[:, None] + across + back)

    def order(self, bound: Array) -> Indices:
        """Flat indices of the pairings: the shortest bound first, then the least motion of all joints.

        Many pairings take the same time, that of one slow joint. Times count in microseconds and motion in
        microradians, so that ties are ties on every processor.
        """
        above_pick = np.array([c.q_offset for c in self.picks])
        above_place = np.array([c.q_offset for c in self.places])
        motion = np.abs(above_pick - self.q_from).sum(axis=1)[:, None]
        motion = motion + np.abs(above_place[None] - above_pick[:, None]).sum(axis=2)
        if self.q_home is not None:
            motion = motion + np.abs(self.q_home - above_place).sum(axis=1)
        return np.asarray(
            np.lexsort((np.round(motion, 6).ravel(), np.round(bound, 6).ravel())), dtype=np.intp
        )

    def route(self, pick: int, place: int, straight: bool) -> Route | None:
        """The transits of one pairing, or None where one of them cannot be had."""
        first, second = self.grip("pick", pick), self.grip("place", place)
        if first is None or second is None:
            return None
        stages = self.stages
        out = self.leg(("out", pick), stages.before, self.q_from, first.q_offset, straight)
        if out is None:
            return None
        across = self.leg(
            ("across", pick, place),
            lambda: stages.holding(first.yaw),
            first.q_offset,
            second.q_offset,
            straight,
        )
        if across is None:
            return None
        back = None
        if self.q_home is not None:
            world = lambda: stages.after(first.yaw, second.yaw)  # noqa: E731
            back = self.leg(("back", first.yaw, place), world, second.q_offset, self.q_home, straight)
            if back is None:
                return None
        legs = [out, across] if back is None else [out, across, back]
        return Route(first, second, out, across, back, sum(path_time(leg, self.limits) for leg in legs))

    def improved(self, route: Route) -> Route:
        """The route with faster ways around what is in the way."""
        stages, clearance = self.stages, self.options.clearance + MARGIN
        pick, place = route.pick.yaw, route.place.yaw

        def faster(waypoints: Array, world: World) -> Array:
            if len(waypoints) == 2:
                return waypoints
            return improve_transit(
                world, waypoints, self.limits, clearance, self.options.seed, self.options.transit
            )

        out, across = faster(route.out, stages.before()), faster(route.across, stages.holding(pick))
        back = None if route.back is None else faster(route.back, stages.after(pick, place))
        legs = [leg for leg in (out, across, back) if leg is not None]
        time = sum(path_time(leg, self.limits) for leg in legs)
        return replace(route, out=out, across=across, back=back, time=time)

    def leg(
        self, key: tuple[object, ...], world: Callable[[], World], q_from: Array, q_to: Array, straight: bool
    ) -> Array | None:
        """Way-points of a transit, or None where there is none; straight ones only, if so asked."""
        clearance = self.options.clearance + MARGIN
        if straight:
            ends = frozen([q_from, q_to])
            known = self._once(
                (*key, "straight"), lambda: check_curve(world(), curve_of_waypoints(ends), clearance).proved
            )
            return ends if known is True else None
        budget, seed = replace(self.options.transit, improvements=0), self.options.seed
        found = self._once(
            (*key, "around"),
            lambda: plan_transit(world(), q_from, q_to, self.limits, clearance, seed, budget),
        )
        return found if isinstance(found, np.ndarray) else None

    def grip(self, side: str, index: int) -> Grip | None:
        """The line of a choice, proved in both worlds that it is run in, or None where it cannot be had."""
        found = self._once((side, index), lambda: self._make_grip(side, index))
        return found if isinstance(found, Grip) else None

    def _make_grip(self, side: str, index: int) -> Grip:
        transfer, stages = self.stages.transfer, self.stages
        choice = (self.picks if side == "pick" else self.places)[index]
        station: Station = transfer.pick if side == "pick" else transfer.place
        T_start = station.T_base_tool[choice.yaw]
        T_end = np.array(T_start)
        T_end[:3, 3] -= self.options.offset * T_start[:3, 2]
        path = follow_line(stages.scene.robot_open, choice.q_hole, T_start, T_end, self.limits)
        if side == "pick":
            worlds = [stages.before(), stages.holding(choice.yaw, station.touches)]
        else:
            # any yaw of the pick will do: the cube is turned by a quarter, which changes no shape; the moves that
            # are really made are checked again
            yaw = self.picks[0].yaw
            worlds = [stages.holding(yaw, station.touches), stages.after(yaw, choice.yaw)]
        curve = curve_of_waypoints(path.q)
        for world in worlds:
            check = check_curve(world, curve, self.options.line_clearance)
            if not check.proved:
                raise ImpossibleError(
                    f"on the line at {station.name} (yaw {choice.yaw}, {choice.branch}) {check.pair[0]} comes to "
                    f"{check.seen * 1e3:.1f} mm of {check.pair[1]} (asked: {self.options.line_clearance * 1e3:g} mm)",
                    station=station.name,
                    yaw=choice.yaw,
                    branch=choice.branch,
                    pair=list(check.pair),
                    distance_m=check.seen,
                )
        return Grip(station.name, choice.yaw, choice.branch, Line(frozen(T_start), frozen(T_end)), path)

    def _once(self, key: tuple[object, ...], make: Callable[[], object]) -> object:
        """The result of `make`, made once; an ImpossibleError is a result too."""
        if key not in self._results:
            try:
                self._results[key] = make()
            except ImpossibleError as error:
                self._results[key] = error
        return self._results[key]

    def _impossible(self) -> ImpossibleError:
        transfer = self.stages.transfer
        rejected = [e for e in self._results.values() if isinstance(e, ImpossibleError)]
        reasons = list(dict.fromkeys(str(e) for e in rejected))
        shown = "; ".join(reasons[:2]) + (f"; and {len(reasons) - 2} more" if len(reasons) > 2 else "")
        return ImpossibleError(
            f"no way to bring {transfer.cube} from {transfer.pick.name} to {transfer.place.name}: {shown}",
            cube=transfer.cube,
            **{"from": transfer.pick.name, "to": transfer.place.name},
            rejected=[{"reason": str(e), **e.data} for e in rejected],
        )
