"""Lines of a list of poses as the arm follows them: from one solution for the first pose, all that hangs on it.

A chain begins with a target that is reached by a transit and goes on while targets are reached by lines. Where lines
lead is decided by the configuration at its first target, so a chain has one candidate for each solution there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, norm
from arm.robot.model import Robot
from arm.se3 import Array, frozen, rotation, rotation_vector
from plan.cartesian.clear_line import follow_clear_line
from plan.cartesian.line import JointPath, Line, LineOptions, follow_line
from plan.collision.world import World
from plan.kinematics.numeric_ik import FREE
from plan.motion.phase import LinearPath
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.target import Target
from plan.transit.near_ends import NearEnd

_TOLERANCE = 5e-6  # of the tool on lines, m
_NOWHERE = 1e-9  # m or rad: a line of this length is none


@dataclass(frozen=True, eq=False)
class LinearMove:
    """A line of a chain.

    Attributes:
        role: approach, line or retract.
        target: index of the target that it leads to, or out of.
        linear: the line, its path and its speed.
    """

    role: str
    target: int
    linear: LinearPath

    @property
    def line(self) -> Line:
        """Where the tool goes."""
        return self.linear.line

    @property
    def path(self) -> JointPath:
        """The path of the joints."""
        return self.linear.path

    @property
    def speed(self) -> float:
        """Cap on the tool's speed, m/s (rad/s for a turn on the spot)."""
        return self.linear.speed


@dataclass(frozen=True, eq=False)
class TargetReached:
    """The arm at a target: its index, q (n,) rad and the pose of the tool (4, 4), both as whole counts give them."""

    target: int
    q: Array
    T_base_tool: Array


@dataclass(frozen=True, eq=False)
class LineChain:
    """One candidate: lines and targets in order.

    Attributes:
        items: in order of time.
        branch: of its first target, "" where the arm has none.
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
        chain: what is done there.
        waypoints: (m, n) rad of the transit to it.
        index: of the chain among the candidates for its goal.
        near: ends of the transit that have less than the asked clearance; its first or last line leaves them, or comes
            to them.
    """

    chain: LineChain
    waypoints: Array
    index: int = 0
    near: tuple[NearEnd, ...] = ()


def groups(targets: Sequence[Target]) -> list[range]:
    """Indices of targets, chain by chain."""
    starts = [i for i, target in enumerate(targets) if target.by == "transit" or i == 0]
    return [range(a, b) for a, b in zip(starts, [*starts[1:], len(targets)], strict=True)]


class LineChains:
    """Follows the lines of a list.

    Args:
        robot: the arm.
        unit: whose counts.
        targets: the list.
        limits: that lines keep.
        tool_speed: cap on lines of targets that have none, m/s.
        options: clearance, solver, and the least speed of lines.
        worlds: in which lines that come too near to something use what they leave free to go around it
            (`plan.cartesian.clear_line`); or None: lines are plain.
    """

    def __init__(
        self,
        robot: Robot,
        unit: Unit,
        targets: Sequence[Target],
        limits: Limits,
        tool_speed: float,
        options: PlanOptions,
        worlds: AttachmentWorlds | None = None,
    ) -> None:
        self.robot, self.unit, self.targets, self.limits = robot, unit, targets, limits
        self.tool_speed, self.options, self.worlds = tool_speed, options, worlds

    @property
    def can_bend(self) -> bool:
        """Whether some line leaves anything free."""
        lines = [t for t in self.targets if t.by == "line" or t.approach > 0.0 or t.retract > 0.0]
        return any(len(self.limits.lower) > 6 - len(_turns(t, "line") or "") for t in lines)

    def chain(self, group: range, q_first: Array, branch: str) -> LineChain:
        """The chain of a group from a solution `q_first` (n,) for its first target.

        Raises:
            ImpossibleError: a line cannot be followed; data: target and those of `plan.cartesian.line.follow_line`.
        """
        items: list[LinearMove | TargetReached] = []
        q = q_first
        for index in group:
            target = self.targets[index]
            outwards: LinearPath | None = None
            if index > group.start:
                items += self.to(index, q)
                q = items[-1].path.q[-1] if items and isinstance(items[-1], LinearMove) else q
            elif target.approach > 0.0:
                outwards = self.along_axis("approach", index, q, -target.approach)
                items.append(LinearMove("approach", index, outwards.reversed()))
            executed = self.unit.positions(self.unit.counts(q))
            items.append(TargetReached(index, frozen(executed), self.robot.T_base_tool(executed)))
            if target.retract > 0.0:
                changed = self.worlds is not None and (target.attach is not None or target.detach)
                if outwards is None or target.retract != target.approach or changed:
                    outwards = self.along_axis("retract", index, q, -target.retract)
                items.append(LinearMove("retract", index, outwards))
                q = outwards.path.q[-1]
        begin = items[0].path.q[0] if isinstance(items[0], LinearMove) else q_first
        return LineChain(tuple(items), branch, frozen(begin), frozen(q))

    def to(self, index: int, q: Array) -> list[LinearMove]:
        """The lines from q to a target that is reached by a line."""
        target = self.targets[index]
        goal = _nearest(self.robot.T_base_tool(q), target)
        turns = [name for name in target.free if name.startswith("r")]
        free_axis = turns[0][1:] if len(turns) == 1 else None
        if target.approach > 0.0 and free_axis != "z":
            free_axis = None  # else the tool's axis could turn away from the pose on the way
        before = np.array(goal)
        before[:3, 3] -= target.approach * goal[:3, 2]
        steps = []
        for role, end, axis in (("line", before, free_axis), ("approach", goal, None)):
            start = self.robot.T_base_tool(q)
            if role == "approach":
                if target.approach == 0.0:
                    break
                # the free turn is what it became
                end = np.array(start)
                end[:3, 3] = goal[:3, 3]
            step = self.follow(role, index, q, start, frozen(end), axis)
            if step is not None:
                steps.append(step)
                q = step.path.q[-1]
        return steps

    def along_axis(self, role: str, index: int, q: Array, length: float) -> LinearPath:
        """The line from q along the tool's own z axis."""
        start = self.robot.T_base_tool(q)
        end = np.array(start)
        end[:3, 3] += length * start[:3, 2]
        step = self.follow(role, index, q, start, frozen(end), None, self.options.clearance)
        if step is None:
            raise ImpossibleError(f"{role} of {abs(length):g} m is too short", length_m=abs(length))
        return step.linear

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
            if self.worlds is None:
                path = follow_line(self.robot, q, line.T_start, line.T_end, self.limits, options)
            else:
                world, clearance = (
                    self.world(self.worlds, role, index),
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
        linear = LinearPath(line, path, target.speed or self.tool_speed, axis)
        return LinearMove(role, index, linear)

    def world(self, worlds: AttachmentWorlds, role: str, index: int) -> World:
        """The world on a line if all poses before are met exactly, whatever is free there."""
        state = worlds.start
        for target in self.targets[: index + (role == "retract")]:
            T_base_tool = target.poses[0] if target.q is None else self.robot.T_base_tool(target.q)
            state = worlds.after(state, target, T_base_tool)
        return worlds.world(state, self.targets[index].pairs)


def _turns(target: Target, role: str) -> str | None:
    """What a line leaves free of the tool's rotation, one of `plan.kinematics.straight_line.TURNS`.

    The tool's z axis keeps its direction on approach and retract, and on a line before an approach. Where something may
    touch on approach and retract, nothing turns.
    """
    free = "".join(name[1:] for name in target.free if name.startswith("r"))
    if role != "line" or target.approach > 0.0:
        free = "z" if "z" in free and (role == "line" or not target.pairs) else ""
    return free or None


def _nearest(T_now: Array, target: Target) -> Array:
    """The pose that a target allows, with what is free as it is now."""
    T = target.poses[0]
    if target.freedom:
        return target.freedom.nearest(T, T_now, tuple(target.free))
    R = T[:3, :3]
    shift = mul(R.T, T_now[:3, 3] - T[:3, 3])
    turn = rotation_vector(mul(R.T, T_now[:3, :3]))
    free = np.array([name in target.free for name in FREE])
    goal = np.eye(4)
    if free[3:].sum() == 1:
        # the turn about one axis that comes nearest to the tool as it is, whatever the tilt of the axis itself
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
