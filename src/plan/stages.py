"""The collision worlds that one transfer goes through: cube standing, cube in the jaws, cube let go."""

from __future__ import annotations

import numpy as np

from arm.bodies import Body
from arm.errors import InputError
from arm.se3 import Array, frozen, inverse
from plan.scene import Scene, Transfer
from plan.world import World

# A cube whose centre is further than this from the tool frame is not between the fingers, m.
_GRASP_REACH = 0.05


class Stages:
    """Worlds of one transfer, built when first asked for.

    Grips are named by their yaw: the index into the station's tool poses.

    Args:
        scene: as it stands when the transfer begins.
        transfer: what is asked for.

    Raises:
        InputError: the cube is unknown, or does not stand where the tool would grip it.
    """

    def __init__(self, scene: Scene, transfer: Transfer) -> None:
        self.scene, self.transfer = scene, transfer
        self.cube = scene.cube(transfer.cube)
        self.still = (*scene.bodies, *(c for c in scene.cubes if c.name != self.cube.name))
        self._worlds: dict[tuple[object, ...], World] = {}
        away = float(np.linalg.norm(self.T_tool_held(0)[:3, 3]))
        if away > _GRASP_REACH:
            raise InputError(
                f"cube {self.cube.name!r} stands {away * 1e3:.0f} mm from the tool at {transfer.pick.name}; "
                f"it must be within {_GRASP_REACH * 1e3:g} mm to be picked there",
                cube=self.cube.name,
                station=transfer.pick.name,
                distance_m=away,
            )

    def T_tool_held(self, pick_yaw: int) -> Array:
        """The cube in the tool frame, as it stands when gripped."""
        return frozen(inverse(self.transfer.pick.T_base_tool[pick_yaw]) @ self.cube.T_base_body)

    def placed(self, pick_yaw: int, place_yaw: int) -> Body:
        """The cube where it is let go."""
        return self.cube.at(self.transfer.place.T_base_tool[place_yaw] @ self.T_tool_held(pick_yaw))

    def before(self) -> World:
        """Jaws open, the cube where it stands."""
        key = ("before",)
        if key not in self._worlds:
            self._worlds[key] = World(self.scene.robot_open, (*self.still, self.cube))
        return self._worlds[key]

    def holding(self, pick_yaw: int, touches: frozenset[str] = frozenset()) -> World:
        """Jaws on the cube, which may touch the bodies named in `touches`."""
        key = ("holding", pick_yaw, touches)
        if key not in self._worlds:
            allowed = [frozenset((self.cube.name, name)) for name in touches]
            held = self.T_tool_held(pick_yaw)
            self._worlds[key] = World(self.scene.robot_holding, self.still, self.cube, held, allowed)
        return self._worlds[key]

    def after(self, pick_yaw: int, place_yaw: int) -> World:
        """Jaws open, the cube where it was let go."""
        key = ("after", pick_yaw, place_yaw)
        if key not in self._worlds:
            placed = self.placed(pick_yaw, place_yaw)
            self._worlds[key] = World(self.scene.robot_open, (*self.still, placed))
        return self._worlds[key]
