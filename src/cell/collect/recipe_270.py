"""The first report's way to take 270 poses, for those who want to compare with it.

From a target that faces the camera in the middle of the image, J4, J5 and J6 turn together until the camera no longer
sees it; then J1 goes on and they begin again. Every fifth pose the target comes nearer or goes away and leans a
little. After 100 poses, all again 0.1 m higher (report, section 2.3.3). Poses that are chosen for what they tell
(`calib.hand_eye.next_poses`) are worth more: docs/hand-eye.md has both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array, frozen
from cell.collect.pose_pool import DISTANCES, HandView
from cell.sim.target_photos import held

POSES = 270
AT_A_HEIGHT = 100
RISE = 0.1  # m
J1_TURN, J1_TURNS = np.radians(1.5), 25  # between two rows, and rows to each side
WRIST_STEP = np.radians([2.5, 0.875, 2.5])  # of J4, J5 and J6, between two poses of a row
LONGEST_ROW = 60
OTHER_EVERY = 5
SHIFT, LEAN = np.radians(3.0), np.radians(10.0)  # of J2 and J3, and of J4 to J6, most, in every fifth pose
_YAWS = 24  # of the first target that are tried
_PLACES = tuple(
    np.array(p) for p in [(0.5, 0.5), (0.3, 0.5), (0.7, 0.5), (0.5, 0.3), (0.5, 0.7)]
)  # of the image
_LEANS = tuple(
    np.radians(d) * np.array(a) for d in (0, 15, 30, 45) for a in [(1, 0), (-1, 0), (0, 1), (0, -1)]
)


def recipe_poses(
    view: HandView, wanted: int, seed: int, progress: Callable[[float], None] = lambda part: None
) -> Array:
    """Configurations (n, 6) rad of the recipe, in its order.

    Args:
        view: of the target in the hand.
        wanted: how many.
        seed: of how the target leans in every fifth.
        progress: told what part is there.

    Raises:
        ImpossibleError: there are not so many.
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
    raise ImpossibleError(
        f"the recipe has {len(found)} poses that can be used, of {wanted}: ask for fewer (--poses), or leave out "
        "--recipe",
        found=len(found),
        wanted=wanted,
    )


def _facing(view: HandView, distance: float) -> Array | None:
    """A configuration that holds the target square to the camera's axis in the image's middle, or as nearly as can
    be, its wrist as far from limits as can be."""
    yaws = 2.0 * np.pi * np.arange(_YAWS) / _YAWS
    size = np.array(view.camera.size)
    for lean, place in product(_LEANS, _PLACES):
        T = np.array([held(view.camera, view.hand.target, place * size, distance, lean, yaw) for yaw in yaws])
        q = view.ways(view.camera.T_base_camera @ T).q
        room = np.minimum(q - view.lower, view.upper - q)[:, 3:].min(axis=1)
        for i in np.argsort(-room):
            if view.shows(q[i]):
                return frozen(q[i])
    return None


def _around(view: HandView, first: Array, rng: np.random.Generator) -> Iterator[Array]:
    """All rows of a height, J1 turning to one side and then to the other."""
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
    """So many of them, evenly over all."""
    at = np.linspace(0, len(poses) - 1, min(wanted, len(poses))).round().astype(int)
    return [poses[i] for i in at]
