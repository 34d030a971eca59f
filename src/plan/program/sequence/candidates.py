"""Inverse kinematics solutions of goals, ranked by travel time through all goals, or the reason why there are none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.se3 import Array, rot_x, rot_y, transform
from plan.collision.missing_srdf import self_collision_help
from plan.kinematics.closed_form import has_closed_form
from plan.kinematics.ik import explain_pose
from plan.kinematics.nearest import AskedPose
from plan.kinematics.numeric_ik import SearchOptions, Solutions, solve_ik
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.paths import PathMoves
from plan.program.goals.target import Target
from plan.program.sequence.refusals import below_table, lean
from plan.program.setting import Setting
from plan.trajectory.time_estimates import straight_time, straight_times

# Continuous joints give thousands of solutions. Of more than _MANY, the _NEAR nearest (in time) to the best solution of
# the previous group are kept, and of these the _RANKED that are reached first.
_MANY, _NEAR, _RANKED = 1024, 512, 256

_LEANING = np.radians(0.05)  # of a pose: more than its digits


class Candidates:
    """Solutions at the first target of every group.

    Args:
        setting: arm, limits, clearances.
        worlds: worlds and goals of the program.
        groups: the goals of each chain.
        ik: budget of the inverse kinematics.
        paths: moves along the paths of the program; default: planned anew.
    """

    def __init__(
        self,
        setting: Setting,
        worlds: AttachmentWorlds,
        groups: Sequence[range],
        ik: SearchOptions,
        paths: PathMoves | None = None,
    ) -> None:
        self.robot, self.limits, self.options = setting.robot, setting.planned, setting.options
        self.worlds, self.targets, self.paths = worlds, worlds.targets, paths or PathMoves(setting, worlds)
        self.groups, self.ik = groups, ik
        self._found: list[Solutions] = []

    @property
    def most(self) -> int:
        """Largest number of solutions of any group."""
        return max(len(found) for found in self._found)

    def solve(self, q_start: Array) -> None:
        """Find and rank all solutions, from the arm at `q_start` (n,) rad.

        Raises:
            ImpossibleError: a target has no solution, or all of them are too near to a body.
        """
        reached = self._reached([group.start for group in self.groups])
        self._found = [self.free(group, some) for group, some in zip(self.groups, reached, strict=True)]
        at, here, steps = q_start[None], [np.zeros(1)], list[Array]()
        for number, found in enumerate(self._found):
            many = len(found) > _MANY
            if many:
                soon = straight_time(found.q - at[np.argmin(np.round(here[-1], 6))], self.limits)
                found = found.rows(np.sort(np.argsort(np.round(soon, 6), kind="stable")[:_NEAR]))
            step = straight_times(at, found.q, self.limits)
            come = (here[-1][:, None] + step).min(axis=0)
            kept = np.sort(np.argsort(np.round(come, 6), kind="stable")[: _RANKED if many else None])
            self._found[number] = found.rows(kept)
            at = found.q[kept]
            here.append(come[kept])
            steps.append(step[:, kept])
        there = np.zeros(len(at))
        for number in reversed(range(len(self._found))):
            through = np.round(here[number + 1] + there, 6)
            self._found[number] = self._found[number].rows(np.argsort(through, kind="stable"))
            there = (steps[number] + there).min(axis=1)

    def ranked(self, number: int) -> Solutions:
        """Return the solutions of a group, ordered by the time of the fastest straight motions through all groups."""
        return self._found[number]

    def _reached(self, indices: Sequence[int]) -> list[Solutions]:
        """Return all solutions of each target, of a path at its start. Those with the same free directions are solved
        together: numpy takes little longer for several poses than for one.
        """
        targets = [self.targets[index] for index in indices]
        found = [Solutions.at(np.zeros(0) if target.q is None else target.q) for target in targets]
        for free in dict.fromkeys(target.free for target in targets):
            alike = [
                i
                for i, target in enumerate(targets)
                if target.q is None and target.by != "path" and target.free == free
            ]
            poses = [self._poses(targets[i]) for i in alike]
            if not poses:
                continue
            T_base_tool, of = np.concatenate(poses), np.repeat(alike, [len(some) for some in poses])
            limits = self.limits
            every = solve_ik(self.robot, T_base_tool, limits.lower, limits.upper, free, self.ik)
            for i in alike:
                found[i] = every.rows(np.flatnonzero(of[every.pose] == i))
        for i, target in enumerate(targets):
            if target.by == "path":
                found[i] = self.paths.solutions(indices[i])
        return found

    def _poses(self, target: Target) -> Array:
        """Return the poses (k, 4, 4) that are tried of a target."""
        freedom = target.freedom
        if not freedom:
            return target.poses
        return np.concatenate([freedom.sampled(T, self.ik.poses, self.ik.seed) for T in target.poses])

    def _unreachable(self, target: Target) -> ImpossibleError:
        """Return the refusal of a target without solutions; data: target, solutions, joint and, for a closed form,
        excess_rad and outside_m of the best branch.
        """
        T_base_tool = target.poses[0]
        free = f" with {', '.join(target.free)} free" if target.free else ""
        free += " and anything within its ranges and tilt" if target.freedom else ""
        in_mm = (1e3 * T_base_tool[:3, 3]).tolist()
        place = ", ".join(f"{v:.3f}" if 5e-4 <= abs(v) < 1.0 else f"{v:.0f}" for v in in_mm)
        head = f"target {target.name!r} at ({place}) mm{free} is out of reach"
        under = below_table(T_base_tool[:3, 3], self.worlds.bodies.values())
        asked = AskedPose(T_base_tool, target.freedom, tuple(target.free)).to_json()
        if has_closed_form(self.robot):
            reports = explain_pose(self.robot, T_base_tool, self.limits.lower, self.limits.upper)
            best = min(reports, key=lambda report: report.miss)
            return ImpossibleError(
                f"{head}: in the nearest of {len(reports)} branches {best.why()}{under}{self._other_way(target)}; "
                "try another pose or more free directions",
                target=target.name,
                solutions=0,
                joint=None if best.outside > 0.0 else best.joint,
                excess_rad=best.excess,
                outside_m=best.outside,
                pose=asked,
            )
        why = f"none of {self.ik.starts} starts of the numerical search converged"
        help = "try another pose, more free directions, or more starts"
        if not target.freedom and (angle := lean(self.robot, T_base_tool, target.free)) > _LEANING:
            why = (
                "all joints that turn have parallel axes, so the tool keeps its tilt, and the pose leans from it by "
                f"{np.degrees(angle):.1f} deg"
            )
            help = "give a pose with that tilt, or free rx and ry"
        return ImpossibleError(
            f"{head}: {why}{under}; {help}",
            target=target.name,
            solutions=0,
            joint=None,
            pose=asked,
        )

    def _other_way(self, target: Target) -> str:
        """Say that a target is in reach with its z axis the other way round; "" if it is not."""
        if target.free not in ((), ("rx",), ("ry",), ("rz",)):  # what has a closed form
            return ""
        for axis, half_turn in (("x", rot_x(np.pi)), ("y", rot_y(np.pi))):
            turned = mul(target.poses[0], transform(half_turn))
            if len(solve_ik(self.robot, turned, self.limits.lower, self.limits.upper, target.free, self.ik)):
                return f"; with its z axis reversed, turned by 180 deg about its {axis} axis, it is in reach"
        return ""

    def free(self, group: range, solutions: Solutions) -> Solutions:
        """Return those solutions of the first target of a group that are clear of all bodies that are never moved.

        Raises:
            ImpossibleError: there are none.
        """
        target = self.targets[group.start]
        if not len(solutions):
            raise self._unreachable(target)
        alone = len(group) == 1 and target.approach == target.retract == 0.0 and target.by != "path"
        if alone:  # a transit ends there and another begins
            world, clearance = self.worlds.at_least(), self.options.clearance
        else:
            world, clearance = self.worlds.at_least(target.pairs), target.clearance_on_lines(self.options)
        # solutions that differ by whole revolutions are checked once
        turns = 2.0 * np.pi * np.array([not axis.slides for axis in product_of_exponentials(self.robot).axes])
        q = solutions.q
        places = np.round(q - turns * np.floor(q / (2.0 * np.pi)), 6)
        clear: dict[bytes, bool] = {}
        kept = []
        for row, place in enumerate(places.view(f"V{places.itemsize * places.shape[1]}").ravel().tolist()):
            if place not in clear:
                clear[place] = not world.in_collision(q[row], clearance)
            if clear[place]:
                kept.append(row)
        if kept:
            return solutions.rows(np.array(kept))
        misses = [world.distance(at) for at in q]
        near = [row for row, miss in enumerate(misses) if miss.value > 0.0]
        if near and alone and self.options.near_ends:
            return solutions.rows(np.array(near))
        pairs = Counter(miss.pair for miss in misses)
        best = max(misses, key=lambda miss: round(miss.value, 9))
        listed = ", ".join(f"{a} / {b} ({count} x)" for (a, b), count in sorted(pairs.items()))
        at = q[misses.index(best)]
        own = self_collision_help(world, at, clearance)
        help = own or (
            f"; all: {listed}; rotate the pose, free more directions, or allow that contact on the lines to "
            "it"
        )
        if target.q is None:
            help = below_table(target.poses[0][:3, 3], self.worlds.bodies.values()) + help
        which = f"all {len(solutions)} solutions are too near to a body; at best"
        if target.q is not None:
            which, help = "the configuration is too near to a body:", own or "; choose another one"
        raise ImpossibleError(
            f"target {target.name!r}: {which} "
            f"{best.pair[0]} is {best.value * 1e3:.1f} mm from {best.pair[1]} (required: {clearance * 1e3:g} mm){help}",
            target=target.name,
            solutions=len(solutions),
            pair=list(best.pair),
            distance_m=best.value,
            clearance_m=clearance,
            **world.state(at),
        )

    def not_followed(self, number: int, why: Sequence[ImpossibleError]) -> ImpossibleError:
        """Return the refusal of a group whose lines cannot be followed from any solution; it quotes the furthest."""
        target = self.targets[self.groups[number].start]
        order = [t.name for t in self.targets]
        best = max(
            why, key=lambda e: (order.index(e.data.get("target", target.name)), e.data.get("done_m", 0.0))
        )
        return ImpossibleError(
            f"the lines cannot be followed from any of {len(why)} solutions of {target.name!r}; the furthest: {best}",
            **{**best.data, "solutions": len(why)},
        )
