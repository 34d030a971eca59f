"""Collision worlds of a task: the positions of the cubes at each moment, and the cube in the jaws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul, norm
from arm.robot.shapes import Body
from arm.se3 import Array, frozen, inverse
from plan.collision.world import World
from plan.scene import Scene, Station, Transfer

# Largest distance of a cube's centre from the tool frame at a grasp, m.
_GRASP_REACH = 0.05


@dataclass(frozen=True, order=True)
class CubePlacement:
    """A cube at rest: at its source (number of the transfer), or, if `placed`, at a place (number of the place)."""

    placed: bool
    number: int


class TaskWorlds:
    """Worlds of a task, each built at its first use. A yaw is the index of a station's tool pose.

    Args:
        scene: scene at the start of the task.
        transfers: the transfers.
        places: places that cubes may go to, in order of their numbers.

    Raises:
        InputError: a cube is unknown, or is not where the tool would grip it.
    """

    def __init__(self, scene: Scene, transfers: Sequence[Transfer], places: Sequence[Station]) -> None:
        self.scene, self.transfers, self.places = scene, tuple(transfers), tuple(places)
        self.cubes = tuple(scene.cube(t.cube) for t in transfers)
        moved = {cube.name for cube in self.cubes}
        self.still = (*scene.bodies, *(c for c in scene.cubes if c.name not in moved))
        self._worlds: dict[tuple[object, ...], World] = {}
        self._placed: dict[int, Body] = {}
        for transfer, cube in zip(self.transfers, self.cubes, strict=True):
            away = float(norm(T_tool_held(transfer, cube, 0)[:3, 3]))
            if away > _GRASP_REACH:
                raise InputError(
                    f"cube {cube.name!r} stands {away * 1e3:.0f} mm from the tool at {transfer.pick.name}; "
                    f"it must be within {_GRASP_REACH * 1e3:g} mm to be picked there",
                    cube=cube.name,
                    station=transfer.pick.name,
                    distance_m=away,
                )

    @property
    def alike(self) -> bool:
        """Whether all cubes have the same shape and grasp, so that any cube may go to any place."""
        first = T_tool_held(self.transfers[0], self.cubes[0], 0)
        return all(
            cube.shape == self.cubes[0].shape and np.abs(T_tool_held(transfer, cube, 0) - first).max() < 1e-6
            for transfer, cube in zip(self.transfers, self.cubes, strict=True)
        )

    def body(self, standing: CubePlacement) -> Body:
        """Return the cube at a placement."""
        if not standing.placed:
            return self.cubes[standing.number]
        if standing.number not in self._placed:
            place = self.places[standing.number]
            # if the cubes are alike, any of them; otherwise the cube of this place
            i = min(standing.number, len(self.cubes) - 1)
            T = mul(place.T_base_tool[0], T_tool_held(self.transfers[i], self.cubes[i], 0))
            self._placed[standing.number] = replace(
                self.cubes[i], name=f"{self.cubes[i].name} at {place.name}", T_base_body=frozen(T)
            )
        return self._placed[standing.number]

    def empty(self, standing: frozenset[CubePlacement]) -> World:
        """Return the world with empty, open jaws."""
        key = ("empty", standing)
        if key not in self._worlds:
            self._worlds[key] = World(self.scene.robot_open, self._bodies(standing))
        return self._worlds[key]

    def holding(
        self, pick: int, standing: frozenset[CubePlacement], touches: frozenset[str] = frozenset()
    ) -> World:
        """Return the world with the cube of a transfer in the jaws, which may touch the bodies `touches`."""
        key = ("holding", pick, standing, touches)
        if key not in self._worlds:
            cube = self.cubes[pick]
            # the search may use any yaw, because a cube rotated by 90 degrees has the same shape
            held = T_tool_held(self.transfers[pick], cube, 0)
            allowed = [frozenset((cube.name, name)) for name in touches]
            self._worlds[key] = World(self.scene.robot_holding, self._bodies(standing), cube, held, allowed)
        return self._worlds[key]

    def _bodies(self, standing: Iterable[CubePlacement]) -> tuple[Body, ...]:
        return (*self.still, *(self.body(s) for s in sorted(standing)))


def T_tool_held(transfer: Transfer, cube: Body, yaw: int) -> Array:
    """Return the pose of the cube in the tool frame at the grasp with this yaw."""
    return frozen(mul(inverse(transfer.pick.T_base_tool[yaw]), cube.T_base_body))
