"""The course report's recipe for 270 poses, for comparison (docs/sources.md, "The course report", section 2.3.3).

In the first pose the target faces the camera in the middle of the image. J4, J5 and J6 rotate together until the camera
no longer sees the target. Then J1 advances, and the wrist starts again. Every fifth pose varies distance and tilt
slightly. After 100 poses the sequence is repeated 0.1 m higher. The most informative poses
(`calib.hand_eye.next_poses`) are better: docs/hand-eye.md compares both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array, frozen
from cell.collect.pose_pool import DISTANCES, HandView
from cell.sim.target_photos import target_pose

POSES = 270
AT_A_HEIGHT = 100  # poses
RISE = 0.1  # between heights, m
J1_TURN, J1_TURNS = np.radians(1.5), 25  # between rows, and rows to each side
WRIST_STEP = np.radians([2.5, 0.875, 2.5])  # of J4, J5 and J6, between poses of a row
LONGEST_ROW = 60  # poses to each side
OTHER_EVERY = 5  # poses
SHIFT, LEAN = np.radians((3.0, 10.0))  # largest change of J2 and J3, and of J4 to J6, in every fifth pose
_YAWS = 24  # tried for the first target
# Positions of the first target, as fractions of the image.
_PLACES = tuple(np.array(p) for p in [(0.5, 0.5), (0.3, 0.5), (0.7, 0.5), (0.5, 0.3), (0.5, 0.7)])
_LEANS = tuple(
    np.radians(d) * np.array(a) for d in (0, 15, 30, 45) for a in [(1, 0), (-1, 0), (0, 1), (0, -1)]
)


def recipe_poses(
    view: HandView, wanted: int, seed: int, progress: Callable[[float], None] = lambda part: None
) -> Array:
    """Return the configurations (n, 6), rad, of the recipe, in its order.

    Args:
        view: visibility of the target.
        wanted: number of poses.
        seed: seed of the variation in every fifth pose.
        progress: called with the fraction found.

    Raises:
        ImpossibleError: the recipe has fewer feasible poses.
    """
    rng = np.random.default_rng(seed)
    found: list[Array] = []
    for distance in np.arange(DISTANCES[1], DISTANCES[0], -RISE):
        first = _facing(view, float(distance))
        if first is None:
            continue
        here = list(_around(view, first, rng))
        found += _spread(here, min(AT_A_HEIGHT, wanted - len(found)))
        progress(len(found) / wanted)
        if len(found) == wanted:
            return frozen(np.array(found))
    why = f"the recipe has only {len(found)} feasible poses, of {wanted}: request fewer (--poses), or omit --recipe"
    raise ImpossibleError(why, found=len(found), wanted=wanted)


def _facing(view: HandView, distance: float) -> Array | None:
    """Return the configuration whose target faces the camera most directly and nearest the middle of the image.

    Among its yaws, take the feasible one whose wrist is farthest from its limits.
    """
    yaws = 2.0 * np.pi * np.arange(_YAWS) / _YAWS
    size = np.array(view.camera.size)
    for lean, place in product(_LEANS, _PLACES):
        T = np.array(
            [target_pose(view.camera, view.hand.target, place * size, distance, lean, yaw) for yaw in yaws]
        )
        q = view.ik_solutions(view.camera.T_base_camera @ T).q
        room = np.minimum(q - view.lower, view.upper - q)[:, 3:].min(axis=1)
        for i in np.argsort(-room):
            if view.shows(q[i]):
                return frozen(q[i])
    return None


def _around(view: HandView, first: Array, rng: np.random.Generator) -> Iterator[Array]:
    """Yield the feasible poses of all rows at one height. J1 advances to one side, then to the other."""
    number = 0
    for turn in [*range(J1_TURNS + 1), *range(-1, -J1_TURNS - 1, -1)]:
        for step in [*range(LONGEST_ROW), *range(-1, -LONGEST_ROW, -1)]:
            q = first.copy()
            q[0] += turn * J1_TURN
            q[3:] += step * WRIST_STEP
            number += 1
            if number % OTHER_EVERY == 0:
                q[1:3] += rng.uniform(-SHIFT, SHIFT, 2)
                q[3:] += rng.uniform(-LEAN, LEAN, 3)
            if view.shows(q):
                yield q


def _spread(poses: list[Array], wanted: int) -> list[Array]:
    """Return `wanted` of the poses, evenly spread."""
    at = np.linspace(0, len(poses) - 1, min(wanted, len(poses))).round().astype(int)
    return [poses[i] for i in at]
