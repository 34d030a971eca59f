"""Collision barriers for lines: constraints that keep pairs of bodies apart, from witness points.

This is an option (`LineOptions.barrier`) that the planners do not use: they certify lines instead.

Let n be the unit vector from the second body's witness point to the first's, and J_1, J_2 the Jacobians of the witness
points as points of their bodies. The distance d changes by n . (J_1 - J_2) dq (F. Kanehiro et al., "A local collision
avoidance method for non-strictly convex polyhedra", RSS 2008). So

    -n . (J_1 - J_2) dq <= d - clearance

keeps the clearance to first order. Witness points of flat faces jump, so steps are repeated until the true distance
keeps the clearance too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from arm.errors import InputError
from arm.numerics.products import mul, norm
from arm.se3 import Array
from plan.cartesian.differential_ik import Barrier
from plan.collision.world import DISTANCE_ERROR, Distance, World

_DIFFERENCE = 1e-5  # rad or m, step of central differences for bodies that touch


def collision_barrier(world: World, clearance: float, near: float) -> Callable[[Array], Barrier]:
    """Return constraints that keep every pair of `world` at least `clearance` apart, for `LineOptions.barrier`.

    If bodies overlap, the witness points are the deepest ones and n points from the first to the second. If they touch
    (within `plan.collision.world.DISTANCE_ERROR`), n is undefined and the row comes from central differences of the
    distance. Neither is exact for a deep overlap, so a line must begin with the clearance.

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
    model, data = world.robot.model, world.robot.model.createData()

    def rows(q: Array) -> Barrier:
        found = world.distances_below(q, near)
        values = np.array([d.value for d in found])
        G = np.zeros((len(found), model.nv))
        if found:
            J = pin.computeJointJacobians(model, data, np.asarray(q, dtype=float)).reshape(6, -1)
            for row, distance in zip(G, found, strict=True):
                row[:] = -_gradient(world, distance, q, J)
        names = tuple(" / ".join(d.pair) for d in found)
        return Barrier(G, values - clearance, names, values)

    return rows


def _gradient(world: World, distance: Distance, q: Array, J: Array) -> Array:
    """Return the gradient (n,) of a pair's distance, m/rad; J (6, n) is in base axes at the base origin."""
    first, second = distance.points
    apart = first - second
    signed = distance.value + world.padding_of(distance.pair)
    if not np.isfinite(apart).all() or min(abs(signed), float(norm(apart))) <= DISTANCE_ERROR:
        return _differences(world, distance.pair, q)
    normal = apart / norm(apart) * np.sign(signed)
    # joints that move both bodies cause no relative motion
    outer, inner = (world.joint_of(name) for name in distance.pair)
    moving = slice(min(outer, inner), max(outer, inner))
    point, sign = (first, 1.0) if outer >= inner else (second, -1.0)
    gradient = np.zeros(len(q))
    gradient[moving] = sign * (mul(normal, J[:3, moving]) + mul(np.cross(point, normal), J[3:, moving]))
    return gradient


def _differences(world: World, pair: tuple[str, str], q: Array) -> Array:
    index = np.array([i for i in range(len(world.pairs)) if world.pair_names(i) == pair], dtype=np.intp)
    gradient = np.zeros(len(q))
    for k, step in enumerate(_DIFFERENCE * np.eye(len(q))):
        ahead, behind = world.pair_distances(q + step, index), world.pair_distances(q - step, index)
        gradient[k] = (ahead[0] - behind[0]) / (2 * _DIFFERENCE)
    return gradient
