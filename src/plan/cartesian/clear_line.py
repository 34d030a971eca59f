"""Lines that keep a clearance: free rotations of the tool and redundant joints bend the joint path around obstacles.

The plain line comes first. If it cannot be followed, or its certificate refuses it, the line is followed again with
collision barriers (`plan.cartesian.collision_barrier`). Each way-point is searched near a chain of clear samples
(`plan.cartesian.line_samples`); if there is no chain, near the previous way-point. The result is certified too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.cartesian.collision_barrier import collision_barrier
from plan.cartesian.line import JointPath, Line, LineOptions, follow_line
from plan.cartesian.line_samples import LineSamples
from plan.collision.bezier import curve_of_path
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.search_margin import LINE_MARGIN, searched_clearance
from plan.collision.world import World

_NEAR = 0.05  # m beyond the clearance: pairs further apart do not constrain a step
# Margins beyond the clearance, m, of way-points (the path between them may come nearer) and of samples; tried in order.
_MARGINS = ((1e-3, 1e-3), (3e-4, 0.0))
_ROOM = 1e-3  # rad (m for a prismatic joint), distance of way-points from limits, as the path between may come nearer


@dataclass(frozen=True, eq=False)
class ClearLine:
    """A line as it was followed.

    Attributes:
        path: the joint path.
        free_axis: free rotations of the tool; see `plan.cartesian.differential_ik.LineOptions`.
        check: certificate of the path; see `ClearanceCertificate.proved`.
    """

    path: JointPath
    free_axis: str | None
    check: ClearanceCertificate


def follow_clear_line(
    world: World,
    clearance: float,
    q_start: Array,
    line: Line,
    limits: Limits,
    options: LineOptions,
    free_axis: str | None = None,
    end_clearance: float = 0.0,
) -> ClearLine:
    """Follow a line so that all pairs of bodies keep a clearance, if possible.

    Args:
        world: the arm and all bodies.
        clearance: required clearance, m.
        q_start: (n,) rad, with the tool at the start of the line.
        line: the line.
        limits: limits of position and velocity.
        options: options of the plain line.
        free_axis: free rotations of bent lines, one of `plan.kinematics.straight_line.TURNS`.
        end_clearance: required clearance at the end of the line, if it is larger, m.

    Returns:
        The first line, plain or bent, that is certified and ends with the clearance for its end; else the first that is
        certified; else the plain line.

    Raises:
        ImpossibleError: the line cannot be followed, plain or bent; data: those of the plain line, see
            `plan.cartesian.line.follow_line`.
    """

    def barred(margin: float) -> LineOptions:
        kept = searched_clearance(world, [q_start], clearance, margin)
        barrier = collision_barrier(world, kept, kept + _NEAR)
        return replace(options, barrier=barrier, free_axis=free_axis, room=_ROOM)

    def attempts() -> Iterator[LineOptions]:
        yield options
        if 6 - len(free_axis or "") >= len(q_start):
            return  # no free rotation and no redundant joint
        samples = LineSamples(world.robot, q_start, line, limits, free_axis)
        for margin, way_margin in _MARGINS:
            kept = searched_clearance(world, [q_start], clearance, way_margin)
            way = samples.way(world, kept, max(kept, end_clearance)) or samples.way(world, kept, kept)
            if way is not None:
                yield replace(barred(margin), way=way)
        yield barred(_MARGINS[0][0])

    refusal: ImpossibleError | None = None  # of the plain line
    best: ClearLine | None = None
    for attempt in attempts():
        try:
            path = follow_line(world.robot, q_start, line.T_start, line.T_end, limits, attempt)
        except ImpossibleError as error:
            if attempt is options:
                refusal = error
            continue
        wanted = searched_clearance(world, (path.q[0], path.q[-1]), clearance, LINE_MARGIN)
        check = certify_curve(world, curve_of_path(path.spline), wanted)
        followed = ClearLine(path, attempt.free_axis, check)
        if check.proved and not world.in_collision(path.q[-1], end_clearance):
            return followed
        if best is None or (check.proved and not best.check.proved):
            best = followed
    if refusal is not None and (best is None or not best.check.proved):
        raise refusal
    if best is None:
        raise ImpossibleError("no line was tried", length_m=line.length)
    return best
