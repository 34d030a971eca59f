"""What a program file must have so that a ring on its tool can be proved to stay threaded on a line."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from arm.io.node import Node
from arm.numerics.products import mul, norm
from arm.robot.model import LinkBody, Robot
from arm.robot.shapes import Body, Box, Sphere, Torus, body_to_json
from arm.robot.thread import ray_names
from arm.se3 import Array, apply, frozen, inverse, transform
from cell.program.path_step import PathStep, ThreadedLine
from plan.collision.world import distance_of

LINE_STEP = 2e-3  # m between the places of a line that must lie in its bodies: no ring is as thin
LINE_SLACK = 1e-4  # m, by which such a place may be outside
_PATH_STEP = 5e-3  # m between the places of a path that are asked for a body around them


def require_threads_provable(
    steps: Iterable[tuple[Node, PathStep]],
    robot: Robot,
    on_work: tuple[Body, ...],
    around: tuple[Body, ...],
    known: set[str],
) -> None:
    """Check what the proof of a threaded ring needs: a ring, a wire that it is clear of, one line of each name.

    Args:
        steps: paths of the program with their tables.
        robot: with the tool.
        on_work: bodies of the workpiece.
        around: those that are known to stand around it, with poses in its frame.
        known: names of all bodies.

    Raises:
        InputError: names file, key, value and rule.
    """
    rings = {body.name: body for body in robot.bodies if isinstance(body.shape, Torus)}
    jsons = [body_to_json(body) for body in on_work]
    lines: dict[str, ThreadedLine] = {}
    for node, step in steps:
        thread = step.threaded
        if thread is None:
            continue
        if thread.ring not in rings:
            shown = ", ".join(sorted(rings)) or "it has none"
            raise node.error_at("threaded", f"must be a body of the tool whose shape is a torus: {shown}")
        _require_ring_at_tool(node, step, rings[thread.ring], robot)
        if not thread.bodies or any(body_to_json(body) not in jsons for body in thread.bodies):
            rule = "must be a wire file with bodies that is also a file of [[bodies]]: the ring is proved clear of them"
            raise node.error_at("line_of", rule)
        bare = _first_outside(thread)
        if bare is not None:
            at = ", ".join(f"{1e3 * value:.1f}" for value in bare)
            rule = f"has bodies that do not contain its line_mm, at ({at}) mm: a ring clear of them may leave the line"
            raise node.error_at("line_of", rule)
        for body in thread.bodies:
            if frozenset((thread.ring, body.name)) in step.touch:
                rule = f"lets {thread.ring!r} touch {body.name!r}, the wire on which it is threaded"
                raise node.error_at("touch", rule)
        for name in known.intersection(ray_names(thread.name)):
            raise node.error_at(
                "threaded", f"cannot be proved with a body named {name!r}, as what prolongs the line is"
            )
        if thread.name not in lines:
            _require_free_end(node, step, thread, robot, (*on_work, *around))
        first = lines.setdefault(thread.name, thread)
        if first.ring != thread.ring or not np.array_equal(first.points, thread.points):
            rule = (
                f"is of another ring or line than in a step before, whose line is named {thread.name!r} too"
            )
            raise node.error_at("threaded", rule)


def _require_ring_at_tool(node: Node, step: PathStep, ring: LinkBody, robot: Robot) -> None:
    """Refuse a ring whose axis passes the tool frame's origin, which is on the line, further off than its radius."""
    if not isinstance(ring.shape, Torus):
        return
    T_tool_ring = _in_tool(ring, robot)
    axis, offset = T_tool_ring[:3, 2], T_tool_ring[:3, 3]
    off, radius = float(norm(offset - mul(offset, axis) * axis)), ring.shape.radius
    if off - _off_line(step) > radius:
        mm = f"its axis passes it by {1e3 * off:.1f} mm, its radius is {1e3 * radius:g} mm"
        rule = f"must be about the origin of the tool frame, which follows the line: {mm}"
        raise node.error_at("threaded", rule, "is origin_mm of the tool's file right, and in mm?")


def _in_tool(body: LinkBody, robot: Robot) -> Array:
    """Return the pose of a body of the tool in the tool frame."""
    return mul(inverse(mul(robot.T_joint_end, robot.T_end_tool)), body.T_joint_body)


def _off_line(step: PathStep) -> float:
    """Return how far the tool frame's origin may be off the line by the step's ranges, m."""
    return float(norm([max(map(abs, step.ranges.get(axis, (0.0,)))) for axis in "xyz"]))


def _first_outside(thread: ThreadedLine) -> Array | None:
    """Return the first place of a line (3,) that is in none of its bodies; None if there is none."""
    for a, b in pairwise(thread.points):
        for part in np.linspace(0.0, 1.0, 2 + int(norm(b - a) / LINE_STEP)):
            place = Body("place", Sphere(LINE_SLACK), transform(t=a + part * (b - a)), "wire")
            if all(distance_of(place, body).value > 0.0 for body in thread.bodies):
                return frozen(a + part * (b - a))
    return None


def _require_free_end(
    node: Node, step: PathStep, thread: ThreadedLine, robot: Robot, bodies: tuple[Body, ...]
) -> None:
    """Refuse the first path on a line whose first half leads the ring through a body, as one from the foot does.

    A plane through the centre of a ring meets its circle in two places that are its radius away. So a ring whose centre
    is in a box, and at least its radius from the sides across one of its axes, meets that box however it is turned.
    """
    radius, ring = next(
        (body.shape.radius, body)
        for body in robot.bodies
        if body.name == thread.ring and isinstance(body.shape, Torus)
    )
    # m, by which the ring's centre may be off the path
    slack = float(norm(_in_tool(ring, robot)[:3, 3])) + _off_line(step)
    length = step.outline.length
    along = np.linspace(0.0, length / 2.0, 2 + int(length / 2.0 / _PATH_STEP))
    places = step.outline.at(along)
    for body in bodies:
        if not isinstance(body.shape, Box) or frozenset((ring.name, body.name)) in step.touch:
            continue
        inside = np.array(body.shape.size) / 2.0 - np.abs(apply(inverse(body.T_base_body), places))
        inside -= slack
        for axis in range(3):
            across = np.delete(inside, axis, axis=1).min(axis=1)
            for k in np.flatnonzero((inside[:, axis] > 0.0) & (across > radius))[:1].tolist():
                at = ", ".join(f"{1e3 * value:.0f}" for value in places[k])
                where = f"{1e3 * along[k]:.0f} mm from its start, at ({at}) mm, it is in {body.name!r}"
                turned = "reverse line_mm of its file, which is from the foot to the free end"
                given = turned if node.value.get("backwards") else f"give backwards = true, or {turned}"
                rule = f"cannot be on its path: {where}"
                raise node.error_at("threaded", rule, f"a path with threaded begins at the free end: {given}")
