"""The cell as its cell file describes it (`cell.config.cell_file`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.board import Board
from arm.calibration_file import ArmCalibration
from arm.controller.unit import Limits, Unit, unit_note
from arm.errors import InputError
from arm.robot.dh import A465
from arm.robot.gripper import HAND, Gripper
from arm.robot.link_errors import with_link_errors
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.robot.tool import FixedTool, padded
from cell.config.camera_keys import CellCamera
from cell.config.cell_values import CellValues, JawValues
from cell.config.inputs import Inputs
from vision.boards.checks import BoardLimits
from vision.camera.model import Camera


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
    def marker_size(self) -> float:
        """Edge of the black squares of markers, m, of boards whose own file states none."""
        return float(self.inputs["boards.marker_size_mm"]) / 1e3

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

    @property
    def walls(self) -> tuple[Body, ...]:
        """The bodies of ``[[walls]]``, in order."""
        return self.fixed[1:]

    @property
    def limits(self) -> Limits:
        """Joint limits with the registers of this cell, at speed 1."""
        return self.unit.limits(self.speed_registers, self.acceleration_registers)


def tool_bodies(tool: Gripper | FixedTool) -> tuple[str, ...]:
    """Return the names of a tool's bodies, whose shapes are measured: unlike the arm's, they are not padded."""
    return HAND if isinstance(tool, Gripper) else tuple(body.name for body in tool.bodies)
