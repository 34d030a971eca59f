"""The cell: what a user knows about it, as the cell file has it (`cell.config.cell_file`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.board import Board
from arm.calibration_file import ArmCalibration
from arm.controller.unit import Limits, Unit
from arm.errors import InputError
from arm.robot.dh import A465
from arm.robot.gripper import HAND, Gripper
from arm.robot.link_errors import with_link_errors
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.robot.tool import padded
from arm.se3 import Array
from cell.config.camera_keys import CellCamera
from cell.config.inputs import Inputs
from vision.boards.checks import BoardLimits
from vision.camera.model import Camera


@dataclass(frozen=True)
class Cell:
    """A work cell.

    Attributes:
        file: where it was read.
        unit, camera: of the cell, calibrated if it is.
        nominal_unit, nominal_camera: as their own files say.
        calibration: of camera and arm, which makes the difference; None without one.
        camera_file: where the camera's calibration was read.
        gripper: its measures.
        arm_padding: taken off every distance of the arm's links, whose shape is assumed; not of the gripper's, m.
        arm_compared: who compared the arm's bodies with the real arm, and when; empty if nobody did.
        grip_height, settle_s, cube_size: of gripping and of the cubes, m and s.
        grip_tolerance: by how much the jaws may stand wider or narrower on a cube than it is, m.
        cube_tolerance: by how much a cube's edge may differ from its size, m.
        boards: that may stand in the cell.
        dictionary: of the boards' markers.
        tilts: at which the stands hold boards, rad, ascending; none if they are not known.
        board_limits: how certain a board's pose must be.
        stand_size: footprint (2,) m.
        zone: where boards may stand, as a body.
        fixed: table, walls and posts.
        table_z: height of the table's top, m.
        q_start: from which looks are taken, (6,) rad.
        photographs: frames a look.
        basler: the camera that takes them on the real cell, if the file names one, and its settings.
        moved, turned: how far any point of a board may move (m), and how far it may turn (rad), before the rest is
            planned anew.
        offset, clearance, least_clearance, approach_speed: m, m, m, m/s at speed 1.
        speed: default factor of velocities.
        velocity_fraction, acceleration_fraction: of the limits at a speed that motion is planned for.
        speed_registers, acceleration_registers: of the controller while it works.
        jerk_time: s in which an acceleration builds up; 0: acceleration may step.
        inputs: what the file says, key by key; see `cell.config.inputs`.
        digest: SHA-256 of that.
    """

    file: Path
    unit: Unit
    camera: Camera
    nominal_unit: Unit
    nominal_camera: Camera
    calibration: ArmCalibration | None
    camera_file: Path
    gripper: Gripper
    arm_padding: float
    arm_compared: str
    grip_height: float
    settle_s: float
    grip_tolerance: float
    cube_size: float
    cube_tolerance: float
    boards: tuple[Board, ...]
    dictionary: str
    tilts: tuple[float, ...]
    board_limits: BoardLimits
    stand_size: tuple[float, float]
    zone: Body
    fixed: tuple[Body, ...]
    table_z: float
    q_start: Array
    photographs: int
    basler: CellCamera
    moved: float
    turned: float
    offset: float
    clearance: float
    least_clearance: float
    approach_speed: float
    speed: float
    velocity_fraction: float
    acceleration_fraction: float
    speed_registers: tuple[int, ...]
    acceleration_registers: tuple[int, ...]
    jerk_time: float
    inputs: Inputs
    digest: str

    def robot(self, jaw_opening: float | None = None) -> Robot:
        """The arm with its gripper, jaws open unless said otherwise."""
        robot = self.nominal_robot(jaw_opening)
        if self.calibration is not None:
            robot = with_link_errors(robot, A465, self.calibration.links)
        return padded(robot, self.arm_padding, but=HAND)

    def nominal_robot(self, jaw_opening: float | None = None) -> Robot:
        """The arm as its maker says, its links not padded."""
        return self.gripper.robot(self.jaw_opening if jaw_opening is None else jaw_opening)

    @property
    def tool_length(self) -> float:
        """From the flange to the finger tips, m."""
        return self.gripper.length

    @property
    def jaw_opening(self) -> float:
        """Between the open fingers, m."""
        return self.gripper.opening

    def noted(self) -> dict[str, Any]:
        """What a log must know to tell positions from counts."""
        if self.calibration is None:
            return {"unit": self.unit.name}
        return {
            "unit": self.unit.name,
            "calibration": self.calibration.id,
            "joint_offsets_rad": self.calibration.joint_offsets.tolist(),
        }

    @property
    def limits(self) -> Limits:
        """Under the registers of this cell, at speed 1."""
        return self.unit.limits(self.speed_registers, self.acceleration_registers)

    def board(self, marker_ids: tuple[int, int]) -> Board:
        """The board with these markers.

        Raises:
            InputError: no board file has them.
        """
        for board in self.boards:
            if set(board.marker_ids) == set(marker_ids):
                return board
        known = ", ".join(f"{b.marker_ids[0]},{b.marker_ids[1]}" for b in self.boards)
        raise InputError(
            f"no board file of {self.file} has the markers {marker_ids[0]},{marker_ids[1]}; it lists boards {known}",
            marker_ids=list(marker_ids),
        )

    def fraction_closed(self, jaw_opening: float) -> float:
        """How far the jaws are closed at an opening in m: 0 open, 1 shut. Linear in the stroke."""
        return self.gripper.fraction_closed(jaw_opening)
