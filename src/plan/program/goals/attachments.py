"""Collision worlds along a program: what moves with the tool, where moved bodies stand, what may touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul
from arm.robot.jaws import FINGERS, with_any_jaws
from arm.robot.model import Robot
from arm.robot.shapes import Body, Sphere
from arm.se3 import Array, frozen, inverse
from plan.collision.world import Distance, World, distance_of
from plan.program.goals.target import Target

Pairs = frozenset[frozenset[str]]

_POINT = 1e-6  # m, radius of a ball that stands for a point


@dataclass(frozen=True, eq=False)
class AttachmentState:
    """What moves with the tool, and where bodies stand that were moved.

    Attributes:
        held: name of the body that moves with the tool, or None.
        T_tool_held: its pose in the tool frame, or None.
        moved: poses T_base_body of bodies that were brought somewhere, by name.
        closed: whether the jaws were closed by a goal that serves no cube: their opening is unknown from then on.
        key: equal for situations that are the same to 1 nm.
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


def _rounded(T: Array) -> tuple[float, ...]:
    return tuple((np.round(T[:3], 9) + 0.0).ravel().tolist())


class AttachmentWorlds:
    """Worlds of one program, built when first asked for.

    Args:
        robot: the arm.
        bodies: as they stand at the start.
        targets: its goals.
        padding: taken off every distance, m.
        holding: the arm while something moves with the tool, such as with its jaws on it; default: `robot`.
        start: what moves with the tool at the start; default: nothing.

    Raises:
        InputError: two bodies of one name; `start` holds what is not there; a target attaches or lets touch what is not
            there, attaches while something is attached, or detaches while nothing is.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Sequence[Body],
        targets: Sequence[Target],
        padding: float = 0.0,
        holding: Robot | None = None,
        start: AttachmentState | None = None,
    ) -> None:
        self.robot, self.holding, self.padding = robot, holding or robot, padding
        self.start = start or AttachmentState(None, None, ())
        self.bodies = {b.name: b for b in bodies}
        own = {b.name for b in robot.bodies}
        names = own | set(self.bodies)
        if len(names) < len(robot.bodies) + len(bodies):
            every = [*(b.name for b in robot.bodies), *(b.name for b in bodies)]
            twice = next(name for name in every if every.count(name) > 1)
            raise InputError(f"bodies: two are named {twice!r}; names must differ", name=twice)
        held = self.start.held
        if held is not None and held not in self.bodies:
            why = f"state: held = {held!r}: must be one of {', '.join(sorted(self.bodies)) or 'no body'}"
            raise InputError(why, name=held)
        for target in targets:
            unknown = sorted({name for pair in target.pairs for name in pair} - names)
            if unknown:
                raise target.error(
                    "allowed_collisions", unknown[0], f"must be one of {', '.join(sorted(names))}"
                )
            if target.attach is not None:
                if target.attach not in self.bodies:
                    raise target.error(
                        "attach",
                        target.attach,
                        f"must be one of {', '.join(sorted(self.bodies)) or 'no body'}",
                    )
                if held is not None:
                    raise target.error("attach", target.attach, f"{held} moves with the tool already")
                held = target.attach
            if target.detach:
                if held is None:
                    raise target.error("detach", True, "nothing moves with the tool there")
                held = None
        self.movable = {name for name in (self.start.held, *(t.attach for t in targets)) if name is not None}
        self._worlds: dict[tuple[object, ...], World] = {}

    def world(self, situation: AttachmentState, allowed_collisions: Pairs = frozenset()) -> World:
        """The world of a situation, in which some pairs may touch; pairs that stand still do not count."""
        moving = {*(body.name for body in self.robot.bodies), situation.held or ""}
        allowed_collisions = frozenset(pair for pair in allowed_collisions if pair & moving)
        key = (situation.key, allowed_collisions)
        if key not in self._worlds:
            moved = dict(situation.moved)
            bodies = [b.at(moved.get(b.name, b.T_base_body)) for b in self.bodies.values()]
            still = [b for b in bodies if b.name != situation.held]
            held = None if situation.held is None else self.bodies[situation.held]
            robot = self.holding if held is not None else self._closed if situation.closed else self.robot
            self._worlds[key] = World(
                robot, still, held, situation.T_tool_held, allowed_collisions, self.padding
            )
        return self._worlds[key]

    @cached_property
    def _closed(self) -> Robot:
        """The arm with its fingers wherever closing jaws may leave them, as in `plan.verify`."""
        own = {body.name for body in self.robot.bodies}
        return with_any_jaws(self.robot) if own.issuperset(FINGERS) else self.robot

    def at_least(self, allowed_collisions: Pairs = frozenset()) -> World:
        """The world without anything that is ever moved: what hits something here does so in every situation."""
        if not self.movable:
            return self.world(self.start, allowed_collisions)
        key = ("least", allowed_collisions)
        if key not in self._worlds:
            still = [b for b in self.bodies.values() if b.name not in self.movable]
            self._worlds[key] = World(self.robot, still, None, None, allowed_collisions, self.padding)
        return self._worlds[key]

    def gap(self, situation: AttachmentState, target: Target, T_base_tool: Array) -> Distance:
        """How far the body that a target attaches is from the hand, or from the tool frame's origin if that is nearer.

        The hand is all that moves with the last joint. With the tool at `T_base_tool` it stands where the tool does,
        whatever the joints are.
        """
        body = self.bodies[target.attach or ""]
        body = body.at(dict(situation.moved).get(body.name, body.T_base_body))
        T_base_joint = mul(T_base_tool, inverse(mul(self.robot.T_joint_end, self.robot.T_end_tool)))
        hand = [
            Body(b.name, b.shape, frozen(mul(T_base_joint, b.T_joint_body)), "robot")
            for b in self.robot.bodies
            if b.joint == self.robot.end_joint
        ]
        tool = Body("the tool frame", Sphere(_POINT), T_base_tool, "robot")
        return min((distance_of(part, body) for part in (*hand, tool)), key=lambda d: d.value)

    def after(self, situation: AttachmentState, target: Target, T_base_tool: Array) -> AttachmentState:
        """The situation once the tool was at a target."""
        moved = dict(situation.moved)
        closed = situation.closed or (target.cube is None and bool(target.jaws))
        held, T_tool_held = situation.held, situation.T_tool_held
        if target.attach is not None:
            T_base_body = moved.pop(target.attach, self.bodies[target.attach].T_base_body)
            held, T_tool_held = target.attach, frozen(mul(inverse(T_base_tool), T_base_body))
        elif target.detach and held is not None and T_tool_held is not None:
            moved[held] = frozen(mul(T_base_tool, T_tool_held))
            held = T_tool_held = None
        elif closed == situation.closed:
            return situation
        rest = tuple(sorted(moved.items(), key=lambda item: item[0]))
        return AttachmentState(held, T_tool_held, rest, closed)
