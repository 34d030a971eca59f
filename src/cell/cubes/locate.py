"""Find a cube that is not where it should be, beside a hole or a place of the task."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arm.numerics.products import mul, norm
from arm.se3 import Array, frozen
from cell.cubes.confirm_placed import T_base_of, nominal_width
from cell.files.task import Task
from cell.scene.bodies import T_hole_cube
from cell.scene.displaced import DisplacedCube
from vision.loose.locate import LooseCube, locate_cube
from vision.observation import Observation
from vision.occupancy.cube_top import EmptyPlace
from vision.occupancy.seated import CubeWidth

WITHIN = 0.060  # m from the place


def locate_displaced(
    task: Task,
    observation: Observation,
    name: str,
    places: Iterable[str],
    width: CubeWidth | None = None,
    others: Iterable[DisplacedCube] = (),
    empty: Observation | None = None,
) -> DisplacedCube | str:
    """Look for a cube near some places, the first of which is the likeliest.

    Args:
        task: of the cube.
        observation: with images.
        name: of the cube, such as ``cube 01-02/4``.
        places: names of holes or places.
        width: of the cube, if it was measured; None: the cell file's.
        others: cubes that were located before.
        empty: an earlier look, at which the first place was empty; None: there is none.

    Returns:
        The cube where it is, or why it was not found.
    """
    if not observation.images:
        return "there are no images to find it in"
    cell, reasons = task.cell, []
    known = [*_seated(task, observation, places := tuple(places)), *(c.T_base_cube for c in others)]
    for place in places:
        T_base_place = T_base_of(task, observation, place)
        if T_base_place is None:
            reasons.append(f"board {place.rpartition('/')[0]} was not seen")
            continue
        before = None
        if empty is not None and place == places[0]:
            T_before = T_base_of(task, empty, place)
            before = None if T_before is None else EmptyPlace(empty.images, cell.camera, T_before)
        found = locate_cube(
            observation.images,
            cell.camera,
            T_base_place,
            width or nominal_width(cell),
            WITHIN,
            None if place.startswith("table/") else cell.boards[0].pocket,
            [T for T in known if norm(T[:3, 3] - T_base_place[:3, 3]) < 2.0 * WITHIN],
            before,
        )
        if isinstance(found, LooseCube):
            height_std = float(np.sqrt(found.covariance[2, 2]))
            return DisplacedCube(name, place, frozen(found.T_base_cube), height_std)
        reasons.append(f"near {place}: {found.reason}")
    return "; ".join(reasons)


def _seated(task: Task, observation: Observation, places: tuple[str, ...]) -> list[Array]:
    """Poses of the cubes in holes, but for those of `places`."""
    size = task.cell.cube_size
    return [
        mul(hole.T_base_hole, T_hole_cube(size))
        for board in observation.boards
        for hole in board.holes("cube")
        if hole.name not in places
    ]
