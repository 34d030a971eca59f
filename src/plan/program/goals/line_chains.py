"""Chains: a target that is reached by a transit, and the lines and targets that follow it without another transit.

The configuration at the first target determines the configurations along all lines of its chain. So a chain has one
candidate for each inverse kinematics solution at its first target.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import ImpossibleError
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, norm
from arm.se3 import Array, frozen, rotation, rotation_vector
from plan.cartesian.clear_line import follow_clear_line
from plan.cartesian.line import Line, LineOptions, follow_line
from plan.collision.world import World
from plan.kinematics.freedom import coordinates_of
from plan.kinematics.numeric_ik import FREE
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.linear_move import LinearMove
from plan.program.goals.paths import PathMoves
from plan.program.goals.target import Target
from plan.program.setting import Setting
from plan.transit.near_ends import NearEnd

_TOLERANCE = 5e-6  # m, largest deviation of the tool from a line
_SAME = 1e-6  # m and rad, between the end of one path and the start of the next
_NOWHERE = 1e-9  # m or rad, length below which a line is left out


@dataclass(frozen=True, eq=False)
class TargetReached:
    """The arm at a target: index of the target, q (n,) rad and tool pose (4, 4), both at whole counts."""

    target: int
    q: Array
    T_base_tool: Array


@dataclass(frozen=True, eq=False)
class LineChain:
    """One candidate of a chain: lines and targets in order.

    Attributes:
        items: in order of time.
        branch: inverse kinematics branch at the first target; "" if the arm has no closed form.
        q_in, q_out: (n,) rad at its ends.
    """

    items: tuple[LinearMove | TargetReached, ...]
    branch: str
    q_in: Array
    q_out: Array

    @property
    def lines(self) -> list[LinearMove]:
        """Its lines in order."""
        return [item for item in self.items if isinstance(item, LinearMove)]


@dataclass(frozen=True, eq=False)
class SequenceStep:
    """One step of a sequence: the transit to a chain, and the chain.

    Attributes:
        chain: the chain that follows.
        waypoints: (m, n) rad of the transit.
        index: number of the chain among its candidates.
        near: ends of the transit with less than the required clearance; its first or last line joins them to the rest.
    """

    chain: LineChain
    waypoints: Array
    index: int = 0
    near: tuple[NearEnd, ...] = ()


def groups(targets: Sequence[Target]) -> list[range]:
    """Return the indices of the targets of each chain."""
    starts = [i for i, target in enumerate(targets) if i == 0 or not _continues(targets[i - 1], target)]
    return [range(a, b) for a, b in zip(starts, [*starts[1:], len(targets)], strict=True)]


def _continues(before: Target, target: Target) -> bool:
    """Return whether a target is reached without a transit: by a line, or by a path that begins where it follows.

    What is free before must be free at the start of the path too: the tool may be anywhere within it.
    """
    if target.by != "path" or before.T_base_tool is None:
        return target.by == "line"
    T = before.T_base_tool[0] if before.back else before.poses[0]
    now = coordinates_of(target.curve.T_start, T)
    low, high = before.freedom.box(tuple(before.free))
    least, most = target.curve.box()
    within = (now + low >= least - _SAME) & (now + high <= most + _SAME)
    return bool(len(before.poses) == 1 and before.retract == 0.0 and within.all())


class LineChains:
    """Follows the lines of a program.

    Args:
        setting: arm, unit, limits, and options of lines.
        worlds: worlds and goals of the program.
        bends: whether lines bend around obstacles (`plan.cartesian.clear_line`); otherwise they are plain.
        paths: moves along its paths; default: planned anew.
    """

    def __init__(
        self,
        setting: Setting,
        worlds: AttachmentWorlds,
        bends: bool = False,
        paths: PathMoves | None = None,
    ) -> None:
        self.setting, self.worlds, self.bends = setting, worlds, bends
        self.paths = paths or PathMoves(setting, worlds)
        self.robot, self.targets = setting.robot, worlds.targets
        self.limits, self.options = setting.planned, setting.options

    @property
    def can_bend(self) -> bool:
        """Whether some line has a free rotation or a redundant joint."""
        lines = [t for t in self.targets if t.by == "line" or t.approach > 0.0 or t.retract > 0.0]
        return any(len(self.limits.lower) > 6 - len(_turns(t, "line") or "") for t in lines)

    def chain(self, group: range, q_first: Array, branch: str) -> LineChain:
        """Follow the chain of a group from a solution `q_first` (n,) at its first target.

        Raises:
            ImpossibleError: a line cannot be followed; data: target and those of `plan.cartesian.line.follow_line`.
        """
        items: list[LinearMove | TargetReached] = []
        q = q_first
        for index in group:
            target = self.targets[index]
            outwards: LinearMove | None = None
            if target.by == "path":
                outwards = self.paths.move(index, q)
                items.append(outwards)
                q = outwards.path.q[-1]
            elif index > group.start:
                lines = self.to(index, q)
                items += lines
                q = lines[-1].path.q[-1] if lines else q
            elif target.approach > 0.0:
                outwards = self.along_axis("approach", index, q, -target.approach)
                items.append(outwards.reversed())
            executed = self.setting.unit.positions(self.setting.unit.counts(q))
            items.append(TargetReached(index, frozen(executed), self.robot.T_base_tool(executed)))
            if target.back and outwards is not None:
                items.append(replace(outwards.reversed(), role="retract"))
                q = outwards.path.q[0]
            if target.retract > 0.0:
                changed = self.bends and (target.attach is not None or target.detach)
                if outwards is None or target.retract != target.approach or changed:
                    outwards = self.along_axis("retract", index, q, -target.retract)
                items.append(replace(outwards, role="retract"))
                q = outwards.path.q[-1]
        begin = items[0].path.q[0] if isinstance(items[0], LinearMove) else q_first
        return LineChain(tuple(items), branch, frozen(begin), frozen(q))

    def to(self, index: int, q: Array) -> list[LinearMove]:
        """Return the lines from q to a target that is reached by a line."""
        target = self.targets[index]
        goal = _nearest(self.robot.T_base_tool(q), target)
        turns = [name for name in target.free if name.startswith("r")]
        free_axis = turns[0][1:] if len(turns) == 1 else None
        if target.approach > 0.0 and free_axis != "z":
            free_axis = None  # another free axis could tilt the tool's own axis away from the approach
        before = np.array(goal)
        before[:3, 3] -= target.approach * goal[:3, 2]
        steps = []
        for role, end, axis in (("line", before, free_axis), ("approach", goal, None)):
            start = self.robot.T_base_tool(q)
            if role == "approach":
                if target.approach == 0.0:
                    break
                # a free rotation keeps the value that it has at the start of the approach
                end = np.array(start)
                end[:3, 3] = goal[:3, 3]
            step = self.follow(role, index, q, start, frozen(end), axis)
            if step is not None:
                steps.append(step)
                q = step.path.q[-1]
        return steps

    def along_axis(self, role: str, index: int, q: Array, length: float) -> LinearMove:
        """Return the line from q along the tool's own z axis."""
        start = self.robot.T_base_tool(q)
        end = np.array(start)
        end[:3, 3] += length * start[:3, 2]
        step = self.follow(role, index, q, start, frozen(end), None, self.options.clearance)
        if step is None:
            why = f"{role} of {abs(length):g} m: must be longer than {_NOWHERE:g} m, or 0 for none"
            raise ImpossibleError(why, length_m=abs(length))
        return step

    def follow(
        self,
        role: str,
        index: int,
        q: Array,
        start: Array,
        end: Array,
        axis: str | None,
        end_clearance: float = 0.0,
    ) -> LinearMove | None:
        target = self.targets[index]
        line = Line(frozen(start), end)
        if line.length < _NOWHERE and norm(line.turn) < _NOWHERE:
            return None
        options = LineOptions(
            tolerance=_TOLERANCE, slowest=self.options.slowest, solver=self.options.solver, free_axis=axis
        )
        try:
            if not self.bends:
                path = follow_line(self.robot, q, line.T_start, line.T_end, self.limits, options)
            else:
                world, clearance = (
                    self.world(role, index),
                    target.clearance_on_lines(self.options),
                )
                turns = _turns(target, role)
                clear = follow_clear_line(
                    world, clearance, q, line, self.limits, options, turns, end_clearance
                )
                path, axis = clear.path, clear.free_axis
        except ImpossibleError as error:
            data = {k: v for k, v in error.data.items() if k != "target"}
            raise ImpossibleError(
                f"{role} at {target.name!r}: {error}", target=target.name, **data
            ) from error
        speed = target.speed or self.setting.tool_speed
        return LinearMove(line, path, speed, axis, role=role, target=index)

    def world(self, role: str, index: int) -> World:
        """Return the world on a line."""
        state = self.worlds.nominal_state(index + (role == "retract"))
        return self.worlds.on_lines(state, self.targets[index])


def _turns(target: Target, role: str) -> str | None:
    """Return the free rotations of the tool on a line, one of `plan.kinematics.straight_line.TURNS`.

    On approach and retract, and on a line before an approach, the tool's z axis keeps its direction. On approach and
    retract with allowed collisions, no rotation is free.
    """
    free = "".join(name[1:] for name in target.free if name.startswith("r"))
    if role != "line" or target.approach > 0.0:
        free = "z" if "z" in free and (role == "line" or not target.pairs) else ""
    return free or None


def _nearest(T_now: Array, target: Target) -> Array:
    """Return the pose of a target in which the free directions keep their present values."""
    T = target.poses[0]
    if target.freedom:
        return target.freedom.nearest(T, T_now, tuple(target.free))
    R = T[:3, :3]
    shift = mul(R.T, T_now[:3, 3] - T[:3, 3])
    turn = rotation_vector(mul(R.T, T_now[:3, :3]))
    free = np.array([name in target.free for name in FREE])
    goal = np.eye(4)
    if free[3:].sum() == 1:
        # the rotation about the free axis that is nearest to the present one, however the axis itself is tilted
        k = int(np.flatnonzero(free[3:])[0])
        M = mul(R.T, T_now[:3, :3])
        i, j = (k + 1) % 3, (k + 2) % 3
        turn = np.zeros(3)
        turn[k] = arctan2(M[j, i] - M[i, j], M[i, i] + M[j, j])
    elif free[3:].any():
        turn = np.where(free[3:], turn, 0.0)
    else:
        turn = np.zeros(3)
    goal[:3, :3] = mul(R, rotation(turn))
    goal[:3, 3] = T[:3, 3] + mul(R, np.where(free[:3], shift, 0.0))
    return frozen(goal)
