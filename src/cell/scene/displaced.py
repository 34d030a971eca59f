"""A cube that is not in its seat, and how the jaws grip it where it is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from arm.board import plate_name
from arm.numerics.products import mul, norm
from arm.poses import HolePose
from arm.se3 import Array, apply, frozen, inverse, rotation, transform
from cell.config.cell import Cell
from cell.scene.bodies import T_hole_cube
from cell.scene.build import grips_over, padded_cube
from plan.scene import Scene, Station
from vision.occupancy.classify import FAINT, LIGHT, NO_MARKER, OUT, POSE, Occupancy

BESIDE = "beside "  # begins the name of the place where a displaced cube is
QUARTER = np.pi / 2.0
RAISED = 2.0  # standard deviations of a cube's height
LEANS = np.sin(np.radians(4.0))  # least slope of a cube that leans
MOST_OFFSET = 6e-3  # m; an upright cube further from its pocket was pushed or fell: its release is unknown
MOST_TURN = np.radians(6.0)  # the same for one that is rotated further
HIDES = 0.075  # m between the middles of a displaced cube and of a hole that it may hide in part
# m between the middles of a displaced cube, at any yaw, and of a hole beside which the jaws need its room: half a cube,
# half its diagonal, and the 8 mm of clearance and paddings
NEEDS_ROOM = 0.056

# Reasons for which a hole may be unsure although its cube is seated. Files of other versions may lack a reason.
_MAY_BE_SEATED = ("", LIGHT, NO_MARKER, OUT, POSE, FAINT)


@dataclass(frozen=True, eq=False)
class DisplacedCube:
    """A cube that a look located beside its seat, or leaning in it.

    Attributes:
        name: such as ``cube 01-02/4``, by the hole that it came from.
        near: the hole or place that it is nearest to, such as ``03-04/1``.
        T_base_cube: pose of its centre, z the outward normal of its top.
        height_std: standard deviation of its height along that normal, m.
    """

    name: str
    near: str
    T_base_cube: Array
    height_std: float = 0.0

    @property
    def place(self) -> str:
        """Name of the place where it is: ``beside 03-04/1``."""
        return BESIDE + self.near

    def carried(self, T_before: Array, T_after: Array) -> DisplacedCube:
        """The cube after what it stands on moved from one pose to another, 4x4 each."""
        return replace(self, T_base_cube=frozen(mul(mul(T_after, inverse(T_before)), self.T_base_cube)))

    def station(self, cell: Cell) -> Station:
        """The place as a station: the jaws grip the cube as deep below its top as a seated one."""
        T_base_seat = mul(self.T_base_cube, inverse(T_hole_cube(cell.cube_size)))
        grips = grips_over(T_base_seat, cell.grip_height)
        return Station(self.place, grips, frozenset((support_of(self.near),)))

    def goal(self, station: Station) -> Station:
        """The station for its release, higher by `RAISED`: it may be lower in the jaws than it seems."""
        raised = transform(t=(0.0, 0.0, -RAISED * self.height_std))
        return replace(station, T_base_tool=tuple(frozen(mul(T, raised)) for T in station.T_base_tool))

    def tilted_grips(self, cell: Cell, T_base_place: Array, share: float) -> list[tuple[Station, Array]]:
        """Grips of a leaning cube by jaws that lean less than it does.

        Where the jaws close along the axis about which the cube leans, they hold it at any angle about that axis. So
        the tool may stay nearer to the plate's normal. It grips higher, so that the palm clears the raised side.

        Args:
            cell: the cell.
            T_base_place: pose of the place that the cube is nearest to.
            share: of the leaning that the tool leaves out, 0 to 1.

        Returns:
            For each grip the station, and the rotation T_tool_leaning from a tool pose for a cube that is held straight
            to the tool pose for the cube that is held so.
        """
        normal = T_base_place[:3, 2] @ self.T_base_cube[:3, :3]
        axis = np.cross((0.0, 0.0, 1.0), normal)  # from the cube's normal to the place's, in the cube's frame
        lean = float(np.arcsin(np.clip(norm(axis), 0.0, 1.0)))
        if lean < np.arcsin(LEANS):
            return []
        turn = rotation(axis / norm(axis) * share * lean)
        raised = transform(t=(0.0, 0.0, np.sin(share * lean) * cell.cube_size / 2.0))
        turned = mul(mul(self.T_base_cube, transform(turn)), mul(raised, inverse(self.T_base_cube)))
        found = []
        for T_base_tool in self.station(cell).T_base_tool:
            closing = self.T_base_cube[:3, :3].T @ T_base_tool[:3, 1]
            if abs(float(closing @ axis)) > 0.9 * norm(axis):
                T = frozen(mul(turned, T_base_tool))
                station = Station(self.place, (T,), frozenset((support_of(self.near),)))
                found.append((station, frozen(mul(inverse(T_base_tool), T))))
        return found

    def offset(self, cell: Cell, T_base_place: Array) -> Array:
        """Offset (2,) m of the middle of its bottom from a place's axis, in the place's plane."""
        bottom = apply(self.T_base_cube, (0.0, 0.0, -cell.cube_size / 2.0))
        return frozen(apply(inverse(T_base_place), bottom)[:2])

    def release_offset(self, cell: Cell, T_base_place: Array) -> Array | None:
        """Offset (2,) m, in the place's plane, at which a cube was released that did not seat; None if unknown.

        A cube that was released further off than its pocket captures comes down on the rim there. It tips until its
        opposite lower edge wedges between the two other walls, and slides down by some mm, however far off it was. So
        the direction of its leaning is that of the offset. The size is taken to be 1.5 captures, which is right to
        within one capture for cubes that were 0.5 to 2.5 captures off. A cube that leans about an edge in its seat
        was released there. An upright one stands where it was released, unless it was pushed away or rotated.
        """
        offset = self.offset(cell, T_base_place)
        capture = (cell.boards[0].pocket[0] - cell.cube_size) / 2.0
        leaning = -np.asarray(inverse(T_base_place)[:2, :3] @ self.T_base_cube[:3, 2])
        axis = int(np.argmax(np.abs(leaning)))
        if abs(leaning[axis]) > LEANS and offset[axis] * leaning[axis] > 0.0 and abs(offset[axis]) > capture:
            return frozen(1.5 * capture * np.sign(offset[axis]) * (np.arange(2) == axis))
        if self.turn(T_base_place) > MOST_TURN or float(np.hypot(*offset)) > MOST_OFFSET:
            return None
        return offset

    def turn(self, T_base_place: Array) -> float:
        """Smallest rotation, rad, about a place's axis between the cube's sides and the place's axes."""
        T_place_cube = mul(inverse(T_base_place), self.T_base_cube)
        yaw = float(np.arctan2(T_place_cube[1, 0], T_place_cube[0, 0]))
        return abs((yaw + QUARTER / 2.0) % QUARTER - QUARTER / 2.0)

    def describe(self, cell: Cell, T_base_place: Array) -> str:
        """Where it is, in words: ``25.1 mm from 03-04/1, rotated by 12 deg, tilted by 0.3 deg``."""
        away = 1e3 * float(np.hypot(*self.offset(cell, T_base_place)))
        turn = np.degrees(self.turn(T_base_place))
        upright = float(T_base_place[:3, 2] @ self.T_base_cube[:3, 2])
        tilt = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
        return f"{away:.1f} mm from {self.near}, rotated by {turn:.0f} deg, tilted by {tilt:.1f} deg"


def is_displaced(occupancy: Occupancy) -> bool:
    """Whether a hole shows something other than a seated cube or an empty hole."""
    return occupancy.state == "unsure" and occupancy.reason not in _MAY_BE_SEATED


def is_hidden(hole: HolePose, occupancy: Occupancy, displaced: Iterable[DisplacedCube]) -> bool:
    """Whether a displaced cube may be what makes a hole unsure."""
    return occupancy.state == "unsure" and is_beside(hole, displaced)


def is_beside(hole: HolePose, displaced: Iterable[DisplacedCube]) -> bool:
    """Whether a displaced cube may hide a part of a hole or of what is around it."""
    return any(norm(cube.T_base_cube[:3, 3] - hole.T_base_hole[:3, 3]) < HIDES for cube in displaced)


def has_room(hole: HolePose, displaced: Iterable[DisplacedCube]) -> bool:
    """Whether no displaced cube is where a cube must pass that is put into a hole."""
    return all(norm(cube.T_base_cube[:3, 3] - hole.T_base_hole[:3, 3]) >= NEEDS_ROOM for cube in displaced)


def support_of(place: str) -> str:
    """The body that supports a cube at a place or beside it: a plate, or the table."""
    board = place.removeprefix(BESIDE).rpartition("/")[0]
    return "table" if board == "table" else plate_name(board)


def with_displaced(cell: Cell, scene: Scene, cubes: tuple[DisplacedCube, ...]) -> Scene:
    """Return the scene with displaced cubes; each may touch what it stands on."""
    bodies = tuple(padded_cube(cell, cube.name, cube.T_base_cube) for cube in cubes)
    touching = {frozenset((cube.name, support_of(cube.near))) for cube in cubes}
    return Scene(
        scene.robot_open,
        scene.robot_holding,
        scene.bodies,
        (*scene.cubes, *bodies),
        scene.allowed | touching,
    )


def shifted(T_base_tool: Array, T_base_place: Array, offset: Array) -> Array:
    """Return a tool pose moved by an offset (2,) m in the plane of a place."""
    moved = mul(T_base_place[:3, :3], np.array([*offset, 0.0]))
    return frozen(mul(transform(t=moved), T_base_tool))
