"""Collision worlds of a task: cubes at rest in some arrangement, and the cube in the jaws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul, norm
from arm.robot.shapes import Body
from arm.se3 import Array, frozen, inverse
from plan.collision.world import World
from plan.program.assignment.legs import Arrangement, Site
from plan.scene import Scene, Station, Transfer

# Largest distance of a cube's centre from the tool frame at a grasp, m.
_GRASP_REACH = 0.05


class TaskWorlds:
    """Worlds of a task, each built at its first use. A yaw is the index of a station's tool pose.

    Args:
        scene: scene at the start of the task.
        transfers: the transfers.
        places: places that cubes may go to, in order of their numbers.

    Attributes:
        start: the arrangement at the start of the task.
        everywhere: all sites. A motion that is clear in it is clear in every arrangement.

    Raises:
        InputError: a cube is unknown, or is not where the tool would grip it.
    """

    def __init__(self, scene: Scene, transfers: Sequence[Transfer], places: Sequence[Station]) -> None:
        self.scene, self.transfers, self.places = scene, tuple(transfers), tuple(places)
        self.cubes = tuple(scene.cube(t.cube) for t in transfers)
        self.start: Arrangement = frozenset(Site(False, i) for i in range(len(self.cubes)))
        self.everywhere: Arrangement = self.start | {Site(True, j) for j in range(len(self.places))}
        moved = {cube.name for cube in self.cubes}
        self._still = (*scene.bodies, *(c for c in scene.cubes if c.name not in moved))
        self._worlds: dict[tuple[object, ...], World] = {}
        self._placed: dict[int, Body] = {}
        for number, (transfer, cube) in enumerate(zip(self.transfers, self.cubes, strict=True)):
            away = float(norm(self.T_tool_held(number)[:3, 3]))
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
        first = self.T_tool_held(0)
        return all(
            cube.shape == self.cubes[0].shape and np.abs(self.T_tool_held(number) - first).max() < 1e-6
            for number, cube in enumerate(self.cubes)
        )

    def T_tool_held(self, number: int) -> Array:
        """Return the pose of a transfer's cube in the tool frame at the grasp with the first yaw.

        The search may use any yaw, because a cube rotated by 90 degrees has the same shape.
        """
        pick = self.transfers[number].pick.T_base_tool[0]
        return frozen(mul(inverse(pick), self.cubes[number].T_base_body))

    def station(self, site: Site) -> Station:
        """Return the station of a site."""
        return self.places[site.number] if site.placed else self.transfers[site.number].pick

    def body(self, site: Site) -> Body:
        """Return the cube that rests at a site."""
        if not site.placed:
            return self.cubes[site.number]
        if site.number not in self._placed:
            place = self.places[site.number]
            # if the cubes are alike, any of them; otherwise the cube of this place
            i = min(site.number, len(self.cubes) - 1)
            T = mul(place.T_base_tool[0], self.T_tool_held(i))
            self._placed[site.number] = replace(
                self.cubes[i], name=f"{self.cubes[i].name} at {place.name}", T_base_body=frozen(T)
            )
        return self._placed[site.number]

    def empty(self, arrangement: Arrangement) -> World:
        """Return the world with empty, open jaws."""
        if (arrangement,) not in self._worlds:
            self._worlds[arrangement,] = World(self.scene.robot_open, self._bodies(arrangement))
        return self._worlds[arrangement,]

    def holding(self, pick: int, arrangement: Arrangement, touches: frozenset[str] = frozenset()) -> World:
        """Return the world with the cube of a transfer in the jaws, which may touch the bodies `touches`."""
        key = (arrangement, pick, touches)
        if key not in self._worlds:
            cube, bodies = self.cubes[pick], self._bodies(arrangement)
            allowed = [frozenset((cube.name, name)) for name in touches]
            held = self.T_tool_held(pick)
            self._worlds[key] = World(self.scene.robot_holding, bodies, cube, held, allowed)
        return self._worlds[key]

    def _bodies(self, arrangement: Arrangement) -> tuple[Body, ...]:
        return (*self._still, *(self.body(site) for site in sorted(arrangement)))
