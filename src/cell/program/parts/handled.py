"""Parts that a program takes and puts down: bodies, the order in which they come, and what they may touch.

Where the jaws take a part, it stands; of several that are taken at one place, the next one is there once the one before
it has been put down. A part and the fingers may touch on the lines to and from where it is taken and put down, and so
may the part and what it stands on there. Everything else keeps its clearance from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm.errors import ImpossibleError
from arm.numerics.products import mul, norm
from arm.robot.jaws import FINGERS
from arm.robot.shapes import Body, Box, Shape, body_to_json
from arm.se3 import Array, frozen, inverse, rot_z, transform
from cell.program.path_step import Pairs
from cell.program.points import WORK
from cell.program.steps import PUT, TAKE, PoseStep, Step, name_of
from plan.collision.covers import hull
from plan.collision.world import distance_of

CONTACT = 1e-3  # m; a part stands on what is nearer below it, or that it is pressed into by less
_LIFTED = 2e-3  # m, by which a part is lifted to see what is below it


@dataclass(frozen=True)
class Part:
    """The parts of a program: boxes, all alike.

    Attributes:
        name: of the first one with `` 1`` behind it, and so on.
        size: edges along x, y and z of the tool frame, m.
        at: middle of the box in the tool frame, while it is gripped, m.
    """

    name: str
    size: tuple[float, float, float]
    at: Array

    @property
    def T_tool_part(self) -> Array:
        """Pose of a gripped part in the tool frame."""
        return transform(t=self.at)

    def turns(self) -> Array:
        """Rotations about its own z axis that map it to itself, (k, 4, 4): quarter turns, or half turns."""
        count = 4 if abs(self.size[0] - self.size[1]) < 1e-9 else 2
        return frozen([transform(rot_z(2.0 * np.pi * k / count)) for k in range(count)])


@dataclass(frozen=True, eq=False)
class Handled:
    """One part that is taken or put down.

    Attributes:
        target: name of the target of the plan.
        key: of its step, such as ``steps[2]``.
        part: its name.
        put: whether it is put down.
        T_base_tool: poses of the tool at which that is done, (k, 4, 4); the first one as the step has it.
        T_base_part: pose of the part then.
        touch: pairs that may touch on the lines to and from there.
    """

    target: str
    key: str
    part: str
    put: bool
    T_base_tool: Array
    T_base_part: Array
    touch: Pairs = frozenset()


@dataclass(frozen=True, eq=False)
class Parts:
    """What a program takes and puts down.

    Attributes:
        handled: in order.
        bodies: the parts, each where it is taken.
        supplies: names of those that are taken at one place, in order; see `plan.scene.Scene`.
    """

    handled: tuple[Handled, ...] = ()
    bodies: tuple[Body, ...] = ()
    supplies: tuple[tuple[str, ...], ...] = ()

    def at(self, target: str) -> Handled | None:
        """Return what is taken or put down at a target."""
        return self._by_target.get(target)

    @cached_property
    def _by_target(self) -> dict[str, Handled]:
        return {one.target: one for one in self.handled}

    @property
    def touch(self) -> Pairs:
        """All pairs that may touch."""
        return frozenset[frozenset[str]]().union(*(one.touch for one in self.handled))


def parts_of(
    part: Part | None, steps: Sequence[Step], repeat: int, T_base_work: Array, padding: float = 0.0
) -> Parts:
    """Return the parts of a program; what they may touch is `standing_on`.

    Args:
        part: what they are; None: there are none.
        steps, repeat: of the program.
        T_base_work: pose of the workpiece.
        padding: of the parts, m.
    """
    if part is None:
        return Parts()
    handled = tuple(_handled(part, steps, repeat, T_base_work))
    taken = [one for one in handled if not one.put]
    bodies = tuple(Body(one.part, Box(part.size), one.T_base_part, WORK, padding) for one in taken)
    supplies: dict[tuple[float, ...], list[str]] = {}
    for one in taken:
        place = tuple((np.round(one.T_base_part[:3], 6) + 0.0).ravel().tolist())
        supplies.setdefault(place, []).append(one.part)
    return Parts(handled, bodies, tuple(map(tuple, supplies.values())))


def _handled(part: Part, steps: Sequence[Step], repeat: int, T_base_work: Array) -> Iterator[Handled]:
    number = 0
    for count in range(repeat):
        for step in steps:
            if not isinstance(step, PoseStep) or step.part is None:
                continue
            number += step.part == TAKE
            T_base_tool = mul(T_base_work, step.T_work_tool[count % len(step.T_work_tool)])
            T_base_part = mul(T_base_tool, part.T_tool_part)
            turns = part.turns() if step.free else part.turns()[:1]
            poses = frozen([mul(mul(T_base_part, turn), inverse(part.T_tool_part)) for turn in turns])
            yield Handled(
                name_of(step, count),
                step.key,
                f"{part.name} {number}",
                step.part == PUT,
                poses,
                frozen(T_base_part),
            )


def standing_on(parts: Parts, bodies: Sequence[Body], clearance: float) -> Parts:
    """Return the parts with what they may touch: the fingers, and what they stand on where they are taken and put.

    Args:
        parts: without.
        bodies: that stand still.
        clearance: that a part must have from all else where it is put down, m.

    Raises:
        ImpossibleError: a part would stand in the air, in a body or too near to one; data: target, part, pair, bodies.
    """
    body_of = {body.name: body for body in parts.bodies}
    queues = [list(supply) for supply in parts.supplies]
    placed: dict[str, Body] = {}
    found = []
    for one in parts.handled:
        part = body_of[one.part].at(one.T_base_part)
        if one.put:
            for queue in queues:
                queue[:] = [name for name in queue if name != one.part]
        there = [body_of[queue[0]] for queue in queues if queue and queue[0] != one.part]
        near = list(_near(part, [*bodies, *placed.values(), *there], -one.T_base_tool[0, :3, 2], clearance))
        _require_room(one, part, near, clearance)
        if one.put:
            placed[one.part] = part
        names = (*FINGERS, *(other.body.name for other in near if other.below))
        found.append(replace(one, touch=frozenset(frozenset((one.part, name)) for name in names)))
    return replace(parts, handled=tuple(found))


@dataclass(frozen=True, eq=False)
class _Near:
    """A body near a part, its distance, m, and whether it is below it: whether the part leaves it when it is lifted."""

    body: Body
    distance: float
    below: bool


def _near(part: Body, bodies: Iterable[Body], up: Array, clearance: float) -> Iterator[_Near]:
    lifted = part.at(mul(transform(t=_LIFTED * up), part.T_base_body))
    for body in bodies:
        required = clearance + part.padding + body.padding
        apart = norm(body.T_base_body[:3, 3] - part.T_base_body[:3, 3])
        if apart > _radius(part.shape) + _radius(body.shape) + required:
            continue
        distance = distance_of(part, body).value
        below = distance <= CONTACT and distance_of(lifted, body).value - distance >= _LIFTED / 2.0
        if below or distance < required:
            yield _Near(body, distance, below)


def _radius(shape: Shape) -> float:
    """Radius of a ball about the origin of a shape that contains it, m."""
    points, radius = hull(shape)
    return radius + max(norm(point) for point in points)


def _require_room(one: Handled, part: Body, near: Sequence[_Near], clearance: float) -> None:
    verb = "put down" if one.put else "taken"
    head = f"{one.target!r}: where {one.part} is {verb}, it"
    data = {"target": one.target, "part": one.part, "clearance_m": clearance, "bodies": [body_to_json(part)]}
    for other in near:
        name, distance = other.body.name, 1e3 * other.distance
        bodies = [body_to_json(body) for body in (part, other.body)]
        pair = {"pair": [one.part, name], "distance_m": other.distance, "bodies": bodies}
        if other.below and other.distance < -CONTACT:
            why = f"is {-distance:.1f} mm inside {name}; raise the step, or correct part.box_mm, "
            why += "part.at_mm or grid.step_mm"
            raise ImpossibleError(f"{head} {why}", **{**data, **pair})
        if one.put and not other.below:
            what = f"{distance:.1f} mm from" if distance > 0.0 else f"{-distance:.1f} mm inside"
            why = f"is {what} {name} (required: {1e3 * clearance:g} mm)"
            beside = "move the places apart, or lower the step so that it stands there"
            raise ImpossibleError(f"{head} {why}; {beside}", **{**data, **pair})
    if one.put and not any(other.below for other in near):
        why = f"stands on nothing within {1e3 * CONTACT:g} mm; lower the step, correct part.box_mm or part.at_mm, or "
        why += "add what is below it to [[bodies]]"
        raise ImpossibleError(f"{head} {why}", **data)
