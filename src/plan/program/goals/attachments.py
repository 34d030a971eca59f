"""Collision worlds along a program: the attached body, the poses of moved bodies, and the allowed collisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul
from arm.robot.jaws import after_closing
from arm.robot.model import Robot
from arm.robot.shapes import Body, Sphere
from arm.se3 import Array, frozen, inverse
from plan.collision.covers import hull
from plan.collision.world import Distance, World, distance_of
from plan.program.goals.target import Target
from plan.scene import Scene

Pairs = frozenset[frozenset[str]]

_POINT = 1e-6  # m, radius of the sphere that represents a point
_ALIKE = 2e-4  # m; rounding of the joints to counts causes some 0.03 mm


@dataclass(frozen=True, eq=False)
class AttachmentState:
    """The body that is attached to the tool, and the poses of bodies that were moved before.

    Attributes:
        held: name of the attached body, or None.
        T_tool_held: its pose in the tool frame, or None.
        moved: name and pose T_base_body of each moved body.
        closed: whether a goal that moves no cube has closed the jaws, so that their opening is unknown.
        key: equal for states that agree to 1 nm.
        put_down: names of the bodies that were moved.
    """

    held: str | None
    T_tool_held: Array | None
    moved: tuple[tuple[str, Array], ...]
    closed: bool = False

    @cached_property
    def key(self) -> tuple[object, ...]:
        return (
            self.held,
            None if self.T_tool_held is None else _rounded(self.T_tool_held),
            tuple((name, _rounded(T)) for name, T in self.moved),
            self.closed,
        )

    @property
    def put_down(self) -> frozenset[str]:
        return frozenset(name for name, _ in self.moved)


def _rounded(T: Array) -> tuple[float, ...]:
    return tuple((np.round(T[:3], 9) + 0.0).ravel().tolist())


class AttachmentWorlds:
    """Worlds of one program, each built at its first use.

    Args:
        scene: the arm without and with an attached body, bodies and cubes at their poses at the start.
        targets: goals of the program.
        start: state at the start; default: nothing is attached.
        padding: subtracted from every distance, m.

    Raises:
        InputError: `start` holds an unknown body; a target names an unknown body, attaches one that is not there, or
            while a body is attached, or detaches while none is.
    """

    def __init__(
        self,
        scene: Scene,
        targets: Sequence[Target],
        start: AttachmentState | None = None,
        padding: float = 0.0,
    ) -> None:
        self.robot, self.holding = scene.robot_open, scene.robot_holding
        self.targets, self.padding = targets, padding
        self.start = start or AttachmentState(None, None, ())
        self.bodies = {b.name: b for b in (*scene.bodies, *scene.cubes)}
        names = {b.name for b in self.robot.bodies} | set(self.bodies)
        held, put_down = self.start.held, self.start.put_down
        supplied = {name for supply in scene.supplies for name in supply}
        bodies = ", ".join(sorted(self.bodies)) or "no body"
        if held is not None and held not in self.bodies:
            raise InputError(f"state: held = {held!r}: must be one of {bodies}", name=held)
        for target in targets:
            unknown = sorted({name for pair in target.pairs for name in pair} - names)
            if unknown:
                rule = f"must be one of {', '.join(sorted(names))}"
                raise target.error("allowed_collisions", unknown[0], rule)
            unknown = sorted(set(target.clearance_of) - names)
            if unknown:
                raise target.error("clearance_of", unknown[0], f"must be one of {', '.join(sorted(names))}")
            if target.attach is not None and target.attach not in self.bodies:
                raise target.error("attach", target.attach, f"must be one of {bodies}")
            if target.attach is not None and held is not None:
                raise target.error("attach", target.attach, f"{held} is attached already; detach it first")
            if target.attach in scene.absent(put_down):
                rule = "is not there before the one in front of it is put down"
                raise target.error("attach", target.attach, rule)
            if target.attach in put_down & supplied:
                raise target.error("attach", target.attach, "was put down, and comes from its supply once")
            if target.detach and held is None:
                raise target.error("detach", True, "no body is attached there")
            put_down |= {held} if target.detach and held is not None else set()
            held = target.attach or (None if target.detach else held)
        self.movable = {name for name in (self.start.held, *(t.attach for t in targets)) if name is not None}
        self._worlds: dict[tuple[object, ...], World] = {}
        self.scene = scene
        self._supplied = supplied
        self._nominal = [self.start]

    def on_lines(self, state: AttachmentState, target: Target) -> World:
        """Return the world of a state on the lines of a target: with its allowed collisions, and its thread if any."""
        return self.world(state, target.pairs, target.threaded)

    def world(
        self, state: AttachmentState, allowed_collisions: Pairs = frozenset(), threaded: str | None = None
    ) -> World:
        """Return the world of a state with these allowed collisions; pairs of fixed bodies are ignored.

        With `threaded`, the name of a thread, it has the rays of that thread as well.
        """
        moving = {*(body.name for body in self.robot.bodies), state.held or ""}
        allowed_collisions = frozenset(pair for pair in allowed_collisions if pair & moving)
        key = (state.key, allowed_collisions, threaded)
        if key not in self._worlds:
            moved = dict(state.moved)
            bodies = [b.at(moved.get(b.name, b.T_base_body)) for b in self.bodies.values()]
            gone = {state.held, *self.scene.absent(state.put_down)}
            still = [b for b in bodies if b.name not in gone]
            held = None if state.held is None else self.bodies[state.held]
            robot = self._closed if state.closed else self.robot
            if held is not None and held.name not in self._supplied:
                robot = self.holding
            if threaded is not None:
                thread = self.scene.thread(threaded)
                arm = [*(b.name for b in robot.bodies), *(() if held is None else (held.name,))]
                allowed_collisions |= thread.exempt(arm)
                still = [*still, *thread.rays]
            self._worlds[key] = World(robot, still, held, state.T_tool_held, allowed_collisions, self.padding)
        return self._worlds[key]

    @cached_property
    def _closed(self) -> Robot:
        """The arm with the fingers of jaws at any opening, as in `plan.verify`."""
        return after_closing(self.robot)

    def at_least(self, allowed_collisions: Pairs = frozenset()) -> World:
        """Return the world without movable bodies: a collision in it is one in every state."""
        if not self.movable:
            return self.world(self.start, allowed_collisions)
        key = ("least", allowed_collisions)
        if key not in self._worlds:
            still = [b for b in self.bodies.values() if b.name not in self.movable]
            self._worlds[key] = World(self.robot, still, None, None, allowed_collisions, self.padding)
        return self._worlds[key]

    def gap(self, state: AttachmentState, target: Target, T_base_tool: Array) -> Distance:
        """Return the distance from the body that a target attaches to the hand or the tool frame, whichever is nearer.

        The hand is all bodies on the last joint; `T_base_tool` alone determines its pose.
        """
        body = self.bodies[target.attach or ""]
        body = body.at(dict(state.moved).get(body.name, body.T_base_body))
        T_base_joint = mul(T_base_tool, inverse(mul(self.robot.T_joint_end, self.robot.T_end_tool)))
        hand = [
            Body(b.name, b.shape, frozen(mul(T_base_joint, b.T_joint_body)), "robot")
            for b in self.robot.bodies
            if b.joint == self.robot.end_joint
        ]
        tool = Body("the tool frame", Sphere(_POINT), T_base_tool, "robot")
        return min((distance_of(part, body) for part in (*hand, tool)), key=lambda d: d.value)

    def nominal_state(self, count: int) -> AttachmentState:
        """Return the state after the first `count` targets, at their nominal poses despite free directions."""
        for target in self.targets[len(self._nominal) - 1 : count]:
            T_base_tool = target.poses[0] if target.q is None else self.robot.T_base_tool(target.q)
            self._nominal.append(self.after(self._nominal[-1], target, T_base_tool))
        return self._nominal[count]

    def searched(self, state: AttachmentState, index: int, T_base_tool: Array) -> AttachmentState:
        """Return the state after the actions at target `index`, as a search takes it.

        Supplied bodies that are where the nominal state has them, within `_ALIKE` and up to a rotation that maps them
        to themselves, count as being there: otherwise each grasp of each of them would need worlds of its own.
        """
        exact, nominal = self.after(state, self.targets[index], T_base_tool), self.nominal_state(index + 1)
        if not self._supplied or state is not self.nominal_state(index) or exact is state:
            return exact
        name = exact.held or state.held or ""
        places = [of.T_tool_held if exact.held else dict(of.moved).get(name) for of in (exact, nominal)]
        alike = name in self._supplied and self._alike(self.bodies[name], *places)
        return nominal if alike else exact

    @staticmethod
    def _alike(body: Body, T: Array | None, other: Array | None) -> bool:
        """Whether a body is in the same place at two poses, within `_ALIKE`."""
        if T is None or other is None:
            return False
        points, _ = hull(body.shape)
        a, b = (mul(points, pose[:3, :3].T) + pose[:3, 3] for pose in (T, other))
        square = ((a[:, None] - b) ** 2).sum(axis=2)
        return bool(max(square.min(axis=0).max(), square.min(axis=1).max()) <= _ALIKE**2)

    def after(self, state: AttachmentState, target: Target, T_base_tool: Array) -> AttachmentState:
        """Return the state after the actions at a target."""
        moved = dict(state.moved)
        closed = state.closed or (target.cube is None and bool(target.jaws))
        held, T_tool_held = state.held, state.T_tool_held
        if target.attach is not None:
            T_base_body = moved.pop(target.attach, self.bodies[target.attach].T_base_body)
            held, T_tool_held = target.attach, frozen(mul(inverse(T_base_tool), T_base_body))
        elif target.detach and held is not None and T_tool_held is not None:
            moved[held] = frozen(mul(T_base_tool, T_tool_held))
            held = T_tool_held = None
        elif closed == state.closed:
            return state
        rest = tuple(sorted(moved.items(), key=lambda item: item[0]))
        return AttachmentState(held, T_tool_held, rest, closed)
