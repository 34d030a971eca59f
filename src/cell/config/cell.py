"""The cell as its cell file describes it (`cell.config.cell_file`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, Board
from arm.calibration_file import ArmCalibration
from arm.controller.unit import Limits, Unit, unit_note
from arm.errors import InputError
from arm.robot.dh import A465
from arm.robot.gripper import HAND, Gripper
from arm.robot.link_errors import with_link_errors
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.robot.tool import FixedTool, padded
from arm.se3 import Array
from cell.config.camera_keys import CellCamera
from cell.config.cell_values import CellValues, JawValues
from cell.config.inputs import Inputs
from plan.collision.world import distance_of
from vision.boards.checks import BoardLimits
from vision.camera.model import Camera

_THIN_STAND, _THIN = 0.025, 0.01  # m; below these, what is meant is rather in cm
_TALL = 0.1  # m; a wall that is lower may be sunk into the table
_IN_BASE = 0.02  # m by which the base may be in a wall, such as a pedestal
_BESIDE = 0.001  # m by which the zone for boards may reach beyond the table


class Cell(CellValues, JawValues):
    """A work cell: `CellValues`, `JawValues`, and what the rest of its file describes.

    Attributes:
        file: cell file.
        unit, camera: controller with arm, and camera; with the calibration applied if there is one.
        nominal_unit, nominal_camera: the same without the calibration.
        calibration: calibration of camera and arm, or None.
        camera_file: file of the camera's lens and nominal pose.
        background_file: file of the background that looks are compared with, or None.
        tool: the gripper, or a tool without jaws.
        boards: boards that may stand in the cell.
        tilts: tilts of the stands, rad, ascending; empty: unknown.
        board_limits: accuracy that a board's pose needs.
        stand_size: footprint of a stand, (2,), m.
        zone: region where boards may stand, as a body.
        fixed: table, walls and posts.
        live_camera: camera of the real cell, if any, and settings of cameras.
        speed_registers, acceleration_registers: values of the controller's registers during operation.
        inputs: values of the file by key; see `cell.config.inputs`.
        digest: SHA-256 of `inputs`.
    """

    file: Path
    unit: Unit
    camera: Camera
    nominal_unit: Unit
    nominal_camera: Camera
    calibration: ArmCalibration | None
    camera_file: Path
    background_file: Path | None
    tool: Gripper | FixedTool
    boards: tuple[Board, ...]
    tilts: tuple[float, ...]
    board_limits: BoardLimits
    stand_size: tuple[float, float]
    zone: Body
    fixed: tuple[Body, ...]
    live_camera: CellCamera
    speed_registers: tuple[int, ...]
    acceleration_registers: tuple[int, ...]
    inputs: Inputs
    digest: str

    @property
    def has_jaws(self) -> bool:
        """Whether the tool is a gripper."""
        return isinstance(self.tool, Gripper)

    @property
    def gripper(self) -> Gripper:
        """Dimensions of the gripper.

        Raises:
            InputError: the tool has no jaws.
        """
        if isinstance(self.tool, Gripper):
            return self.tool
        why = f"{self.file}: tool.bodies: the tool of this cell has no jaws; cubes need a cell with a gripper"
        raise InputError(why, file=str(self.file), name="tool.bodies")

    @property
    def jaw_opening(self) -> float:
        """Distance of the open fingers' inner faces, m; 0 for a tool without jaws."""
        return self.tool.opening if isinstance(self.tool, Gripper) else 0.0

    def robot(self, jaw_opening: float | None = None) -> Robot:
        """Return the calibrated arm with its tool and padded links; jaws are open by default."""
        robot = self.nominal_robot(jaw_opening)
        if self.calibration is not None:
            robot = with_link_errors(robot, A465, self.calibration.links)
        return padded(robot, self.arm_padding, but=tool_bodies(self.tool))

    def robot_holding(self) -> Robot:
        """Return `robot` with a cube between its jaws; the same arm if it has none."""
        return self.robot(self.cube_size)

    def nominal_robot(self, jaw_opening: float | None = None) -> Robot:
        """Return the arm with nominal kinematics and unpadded links."""
        if isinstance(self.tool, FixedTool):
            return self.tool.robot()
        return self.tool.robot(self.tool.opening if jaw_opening is None else jaw_opening)

    def noted(self) -> dict[str, Any]:
        """Return what a log needs to convert counts to joint angles."""
        noted: dict[str, Any] = {**unit_note(self.nominal_unit)}
        if (made := self.calibration) is not None:
            noted |= {"calibration": made.id, "joint_offsets_rad": made.joint_offsets.tolist()}
        return noted

    def arm_shape(self) -> str:
        """Say in one line who compared the arm's assumed bodies with the arm, and the padding of its links."""
        tool = "gripper" if self.has_jaws else "tool"
        padded = f"its links are padded by {1e3 * self.arm_padding:g} mm, the {tool} is not"
        if self.arm_compared.strip():
            return f"the arm's bodies were compared with the arm ({self.arm_compared.strip()}); {padded}"
        return f"the arm's bodies are assumed, nobody has compared them with the arm; {padded}"

    def doubts(self) -> tuple[str, ...]:
        """Say which values may be in another unit.

        These are q_start_deg in rad, stands and gripper in cm, and a table that does not carry the zone for boards.
        """
        doubt = doubt_of_deg(self.q_start, self.unit)
        found = [f"q_start_deg = {doubt}"] if doubt else []
        found.extend(self._half_below().values())
        small = self._small()
        if isinstance(self.tool, Gripper) and self.tool.urdf is None and "tool.finger_mm" not in small:
            room = self.grip_height + self.tool.finger[2] - (self.cube_size - CUBE_SEAT_DEPTH)
            if room < 0.0:
                found.append(
                    f"tool.finger_mm = {[round(1e3 * v, 6) for v in self.tool.finger]}: with tool.grip_height_mm = "
                    f"{1e3 * self.grip_height:g} the palm is {-1e3 * room:.0f} mm inside a gripped cube: is the third "
                    "of them the length from palm to tip?"
                )
        if (beyond := self._zone_beyond_table()) > _BESIDE:
            found.append(
                f"table.centre_mm and table.size_mm: the zone for boards reaches {1e3 * beyond:.0f} mm beyond the "
                "table; are they in cm? The arm is not kept away from what is not in the file"
            )
        found.extend(self.enclosing().values())
        for name, sizes in small.items():
            stated, meant = (", ".join(f"{unit * v:.6g}" for v in sizes) for unit in (1e3, 1e4))
            found.append(
                f"{name} = [{stated}]: is it in cm? Then it must be [{meant}] in mm; as it is, clearances are those of "
                "a body that is this small"
            )
        return tuple(f"{self.file.name}: {words}" for words in found)

    def _small(self) -> dict[str, tuple[float, ...]]:
        """Return the sizes that are smaller than those of any stand or gripper, m, by key."""
        small: dict[str, tuple[float, ...]] = {}
        if max(self.stand_size) < _THIN_STAND:
            small["boards.stand_size_mm"] = self.stand_size
        if isinstance(self.tool, Gripper) and self.tool.urdf is None:
            if self.tool.finger[2] < _THIN or self.tool.finger[0] < _THIN / 5.0:
                small["tool.finger_mm"] = self.tool.finger
            if self.tool.palm[1] < self.tool.opening / 2.0:
                small["tool.palm_mm"] = self.tool.palm
            if self.tool.body_radius < _THIN:
                small["tool.body_radius_mm"] = (self.tool.body_radius,)
        return small

    def enclosing(self) -> dict[str, str]:
        """Say by its name which wall the arm's base is in."""
        found = {}
        for number, wall in enumerate(self.walls):
            if (depth := self._depth_of_base(wall)) > _IN_BASE:
                found[wall.name] = (
                    f"walls[{number}] ({wall.name}): the arm's base is {1e3 * depth:.0f} mm inside it: is its place or "
                    "size in another unit? A body is solid: a cage is a wall for each of its sides"
                )
        return found

    @property
    def walls(self) -> tuple[Body, ...]:
        """The bodies of ``[[walls]]``, in order."""
        return self.fixed[1:]

    def _half_below(self) -> dict[str, str]:
        """Say by its name which wall over the table has its middle in the table's top, as one whose foot was given."""
        found = {}
        table = self.fixed[0]
        for number, wall in enumerate(self.walls):
            if (
                not isinstance(wall.shape, Box)
                or not isinstance(table.shape, Box)
                or wall.shape.size[2] < _TALL
            ):
                continue
            (x, y), z = wall.T_base_body[:2, 3] - table.T_base_body[:2, 3], float(wall.T_base_body[2, 3])
            over = abs(x) < table.shape.size[0] / 2.0 and abs(y) < table.shape.size[1] / 2.0
            if over and abs(z - self.table_z) < _TALL / 10.0:
                found[wall.name] = (
                    f"walls[{number}] ({wall.name}): its lower half is below the table's top: is centre_mm that of its "
                    f"foot? Its middle is {500.0 * wall.shape.size[2]:g} mm above it"
                )
        return found

    def _depth_of_base(self, wall: Body) -> float:
        """How deep the arm's base, which stands still, is in a wall, m; negative: how far from it."""
        robot = self.nominal_robot()
        base = [
            Body(body.name, body.shape, body.T_joint_body, "robot")
            for body in robot.bodies
            if body.joint == 0
        ]
        return max((-distance_of(body, wall).value for body in base), default=-np.inf)

    def _zone_beyond_table(self) -> float:
        """How far the zone for boards reaches beyond the edge of the table, m; negative: it does not."""
        table, zone = next((body for body in self.fixed if body.kind == "table"), None), self.zone
        if table is None or not isinstance(table.shape, Box) or not isinstance(zone.shape, Box):
            return -np.inf
        apart = np.abs(zone.T_base_body[:2, 3] - table.T_base_body[:2, 3])
        half_zone, half_table = (np.array(box.size[:2]) / 2.0 for box in (zone.shape, table.shape))
        return float((apart + half_zone - half_table).max())

    @property
    def limits(self) -> Limits:
        """Joint limits with the registers of this cell, at speed 1."""
        return self.unit.limits(self.speed_registers, self.acceleration_registers)


def doubt_of_deg(q: Array, unit: Unit) -> str:
    """Say that a configuration given in deg, now q (6,) rad, may be in rad; "" if not. See `Cell.doubts`."""
    stated = np.degrees(q)
    whole = np.allclose(stated, np.rint(stated), atol=1e-9)
    if whole or np.abs(stated).max() > np.pi + 0.01 or unit.beyond_limits(stated):
        return ""
    given, meant = (", ".join(f"{v:.6g}" for v in angles) for angles in (stated, np.degrees(stated)))
    return (
        f"[{given}]: is it in rad? Then it must be [{meant}] in deg; as it is, the arm is within 3.2 deg of zero in "
        "all joints"
    )


def tool_bodies(tool: Gripper | FixedTool) -> tuple[str, ...]:
    """Return the names of a tool's bodies, whose shapes are measured: unlike the arm's, they are not padded."""
    return HAND if isinstance(tool, Gripper) else tuple(body.name for body in tool.bodies)
