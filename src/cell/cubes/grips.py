"""Grips of a displaced cube: straight, leaning, higher, and lifted from beside another cube.

The jaws are aligned with the cube. A tool that leans about their travel, and grips higher, needs less room on the side
from which it leans away: there its fingers end above the cube in the next hole.

A cube that stands closer to another than any clearance can still be lifted if the lift takes it no nearer. Where this
follows from their shapes alone, they may touch on the lift, and the plan says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, inverse, rotation, transform
from cell.config.cell import Cell
from cell.scene.displaced import DisplacedCube
from plan.scene import Station

SHARES = (0.5, 1.0)  # parts of a cube's tilt by which the tool tilts less than the cube
LEANS = (0.0, 10.0, -10.0, 20.0, -20.0, 30.0, -30.0)  # deg, of a tool that grips higher
# m, how much higher it grips: its palm clears the cube's top; its fingers hold 9 mm of a face, at 30 deg 3 to 15
HIGHER = 8e-3
# part of a lift that may lead towards a cube: the normals of faces are uncertain
TOWARDS = np.sin(np.radians(1.0))


@dataclass(frozen=True, eq=False)
class Grip:
    """A way to take a displaced cube.

    Attributes:
        pick: where it is, as a station.
        goals: where a cube that is held so may be brought, best first.
    """

    pick: Station
    goals: tuple[Station, ...]

    def lifting_from(self, cube: Body, others: Sequence[Body]) -> Grip | None:
        """The same grip, on whose lift the cube may touch others; None if every lift may take it nearer to one."""
        poses = tuple(
            T for T in self.pick.T_base_tool if all(is_taken_from(cube, other, -T[:3, 2]) for other in others)
        )
        if not poses:
            return None
        touches = self.pick.touches | {other.name for other in others}
        return replace(self, pick=Station(self.pick.name, poses, touches))


def recovery_grips(
    cell: Cell, cube: DisplacedCube, goals: Sequence[Station], T_base_place: Array | None
) -> Iterator[Grip]:
    """Yield the ways to take a displaced cube, best first.

    Args:
        cell: the cell.
        cube: which stands on its plate or in its pocket.
        goals: where a cube may be brought that is held straight.
        T_base_place: pose of the place that it is nearest to, if it was seen.
    """
    straight = cube.station(cell)
    yield Grip(straight, tuple(goals))
    if T_base_place is not None:
        for share in SHARES:
            for pick, T_tool_leaning in cube.tilted_grips(cell, T_base_place, share):
                yield Grip(pick, _moved(goals, T_tool_leaning))
    centre = float((inverse(straight.T_base_tool[0]) @ cube.T_base_cube)[2, 3])
    for lean in np.radians(LEANS):
        # about the cube's centre, so that it stays between the jaws
        about = mul(transform(t=(0.0, 0.0, centre)), transform(rotation(np.array([0.0, lean, 0.0]))))
        T_tool_leaning = frozen(mul(about, transform(t=(0.0, 0.0, -centre - HIGHER))))
        yield Grip(_moved([straight], T_tool_leaning)[0], _moved(goals, T_tool_leaning))


def _moved(stations: Sequence[Station], T_tool_leaning: Array) -> tuple[Station, ...]:
    """Stations for a tool that holds the cube in another way."""
    return tuple(
        replace(station, T_base_tool=tuple(frozen(mul(T, T_tool_leaning)) for T in station.T_base_tool))
        for station in stations
    )


def is_taken_from(cube: Body, other: Body, lift: Array) -> bool:
    """Whether a straight lift along a unit vector (3,) keeps a box apart from another, however near it is.

    It does if a plane parallel to a face of one of them separates them, and the lift does not lead towards that plane,
    but for `TOWARDS`.
    """
    faces = np.concatenate([body.T_base_body[:3, :3].T for body in (cube, other)])
    between = cube.T_base_body[:3, 3] - other.T_base_body[:3, 3]
    for axis in (*faces, *-faces):
        gap = float(mul(axis, between)) - _reach(cube, axis) - _reach(other, axis)
        if gap > 0.0 and float(mul(axis, lift)) >= -TOWARDS:
            return True
    return False


def _reach(body: Body, axis: Array) -> float:
    """Half the extent of a box along a unit vector (3,), m."""
    if not isinstance(body.shape, Box):
        raise InputError(f"{body.name!r} must be a box", name=body.name)
    return float(mul(np.abs(mul(axis, body.T_base_body[:3, :3])), np.array(body.shape.size) / 2.0))
