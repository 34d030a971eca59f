"""Collision barriers for lines: constraints that keep pairs of bodies apart, from coal's distances and normals.

Let n be the unit vector from one body's witness point to the other's, and J_1, J_2 the Jacobians of the witness points
as points of their bodies. The distance d changes by n . (J_1 - J_2) dq (F. Kanehiro et al., "A local collision
avoidance method for non-strictly convex polyhedra", RSS 2008). So

    -n . (J_1 - J_2) dq <= d - clearance

keeps the clearance to first order. Witness points of flat faces jump, so steps are repeated until the true distance
keeps the clearance too. `plan.cartesian.clear_line` follows lines with these constraints.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from arm.errors import InputError
from arm.se3 import Array
from plan.cartesian.differential_ik import Barrier
from plan.collision.world import World


def collision_barrier(world: World, clearance: float, near: float) -> Callable[[Array], Barrier]:
    """Return constraints that keep every pair of `world` at least `clearance` apart, for `LineOptions.barrier`.

    If bodies overlap, n points out of the overlap. It is not exact for a deep one, so a line must begin with the
    clearance.

    Args:
        world: the arm and all bodies.
        clearance: m.
        near: m, above `clearance`. Pairs further apart give no row, so steps must be shorter than `near - clearance`.

    Returns:
        A function from q (n,) to the rows of pairs nearer than `near`, the closest first, with names such as
        ``finger_l / plate 01-02``.

    Raises:
        InputError: `near` is not above `clearance`.
    """
    if not near > clearance:
        why = f"near = {near * 1e3:g} mm: must be above the clearance of {clearance * 1e3:g} mm"
        raise InputError(why, near=near)

    def rows(q: Array) -> Barrier:
        found = world.near(q[None], near)
        order = np.argsort(found.distance, kind="stable")
        names = tuple(" / ".join(world.pair_names(pair)) for pair in found.pair[order].tolist())
        distance = found.distance[order]
        return Barrier(-found.gradient[order], distance - clearance, names, distance)

    return rows
