"""Read the cell file (TOML). Every value is checked; messages name file and key."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.calibration_file import ArmCalibration, read_arm_calibration
from arm.controller.unit import Unit, unit_rule
from arm.controller.unit_keys import MOST_REST_TOLERANCE
from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.node import Node
from arm.io.rules import integer, integers, number, numbers, path, standing, tables
from arm.io.storage import canonical_json, sha256
from arm.robot.dh import A465
from arm.robot.gripper import HAND, LINKS, Gripper
from arm.robot.shapes import Body, Box
from arm.robot.tool import FixedTool
from arm.se3 import Array, frozen, transform
from cell.config.board_keys import BoardKeys, boards_of
from cell.config.bodies import BodyKeys, read_body, require_names_differ
from cell.config.camera_keys import CAMERA_FILE, CameraKeys, camera_of
from cell.config.cell import Cell
from cell.config.cell_values import ARM_PADDING_MM, CellValues, JawValues
from cell.config.fixed_tool import read_fixed_tool, with_tool_stated
from cell.config.inputs import LEFT_OUT, config_inputs
from cell.config.tool_keys import (
    BodiesKeys,
    GripperKeys,
    gripper_of,
    is_without_jaws,
    with_force,
    without_gripper,
)
from plan.options import LEAST_CLEARANCE, PlanOptions
from vision.boards.checks import BoardLimits
from vision.camera.model import Camera, read_camera

_REGISTERS = integers(6, 1, 32767)


class _DeviceKeys(Keys):
    unit: Unit = key("unit", unit_rule())
    camera: Path = key("camera", CAMERA_FILE)
    calibration: Path | None = key("calibration", path(exists=False), None)  # a run may begin without it
    background: Path | None = key("background", path(exists=False), None)  # as may a cell without it


class _FixedKeys(Keys):
    centre: Array = key("table.centre_mm", standing(2, -5000, 5000))
    size: Array = key("table.size_mm", numbers(2, "mm", 10, 10000))
    thickness: float = key("table.thickness_mm", number("mm", 1, 1000))
    walls: tuple[Body, ...] = key("walls", tables(lambda node: read_body(node, "wall"), BodyKeys), default=[])


class _CommonKeys(CameraKeys, _FixedKeys, BoardKeys, CellValues, _DeviceKeys):
    """Keys of all cell files."""

    rest_tolerance: int | None = key(
        "motion.rest_tolerance_counts", integer(1, MOST_REST_TOLERANCE), default=None
    )
    speed_registers: tuple[int, ...] | None = key("motion.speed_registers", _REGISTERS, None)
    acceleration_registers: tuple[int, ...] | None = key(
        "motion.acceleration_registers", _REGISTERS, default=None
    )


class CellKeys(_CommonKeys, GripperKeys, JawValues, file="a cell file"):
    """Keys of the file of a cell with a gripper."""


class FixedToolCellKeys(_CommonKeys, BodiesKeys):
    """Keys of the file of a cell whose tool has no jaws: cubes may stand in its boards, but stay there."""

    cube_size: float = key("cube.size_mm", number("mm", 5, 80), 40)
    offset: float = key("motion.offset_mm", number("mm", 45, 300), 1e3 * PlanOptions.offset)


_NO_JAWS = JawValues(grip_height=0.0, settle_s=0.0, grip_tolerance=0.0)


@dataclass(frozen=True, eq=False)
class _Flange:
    """What the arm carries, the values of its jaws, its unit, and the content of cell and tool file together."""

    tool: Gripper | FixedTool
    jaws: JawValues
    unit: Unit
    inputs: Mapping[str, Any]


def _flange(keys: CellKeys | FixedToolCellKeys, root: Node) -> _Flange:
    unit = keys.unit
    if isinstance(keys, CellKeys):
        gripper = gripper_of(keys, root, keys.cube_size)
        return _Flange(gripper, keys, with_force(unit, keys.force_v), root.value)
    file = Node.of_toml(root["tool"]["bodies"].read(path()), "tool")
    tool, inputs = read_fixed_tool(file), with_tool_stated(root.value, file.value)
    if keys.walls:
        require_names_differ(root["walls"], keys.walls, tool.bodies)
    return _Flange(tool, _NO_JAWS, without_gripper(unit), inputs)


def read_cell(path: Path, on_uncalibrated: Callable[[InputError], None] | None = None) -> Cell:
    """Read a cell file.

    Args:
        path: the file.
        on_uncalibrated: called with the reason why the calibration file cannot be used; the cell is then read without
            it. None: raise.

    Raises:
        InputError: a value is wrong; names file, key, value, unit and rule.
    """
    root = Node.of_toml(path, "cell")
    keys = FixedToolCellKeys.read(root) if is_without_jaws(root) else CellKeys.read(root)
    flange = _flange(keys, root)
    nominal_unit, nominal_camera = flange.unit, read_camera(keys.camera)
    if "look" in root and "camera_moved_mm" in root["look"] and keys.background is None:
        help = "give the file of a background: a465 calibrate background makes it"
        raise root.error_at("look.camera_moved_mm", "needs background, with which images are compared", help)
    if keys.rest_tolerance is not None:
        nominal_unit = replace(nominal_unit, rest_tolerance=keys.rest_tolerance)
    calibration = None
    try:
        calibration = _calibration(keys, root, nominal_unit, nominal_camera)
    except InputError as error:
        if on_uncalibrated is None:
            raise
        on_uncalibrated(error)
    unit, camera = nominal_unit, nominal_camera
    if calibration is not None:
        unit = unit.calibrated(calibration.joint_offsets)
        camera = _calibrated(camera, calibration)
    if rule := unit.beyond_limits(keys.q_start):
        raise root.error_at("q_start_deg", rule)
    _check_padding(keys, root)
    _check_motion(keys, root)
    boards = boards_of(keys, root, keys.cube_size)
    if boards:
        _check_zone(keys, root)
    inputs = config_inputs(flange.inputs, LEFT_OUT, boards)
    cell = Cell(
        **keys.values_of(CellValues),
        **flange.jaws.values_of(JawValues),
        file=path,
        unit=unit,
        camera=camera,
        nominal_unit=nominal_unit,
        nominal_camera=nominal_camera,
        calibration=calibration,
        camera_file=keys.camera,
        background_file=keys.background,
        tool=flange.tool,
        boards=boards,
        tilts=tuple(float(np.radians(v)) for v in sorted(keys.tilts_deg)),
        board_limits=BoardLimits(sideways_m=keys.sideways, height_m=keys.height, turn_rad=keys.turn),
        stand_size=(float(keys.stand_size[0]), float(keys.stand_size[1])),
        zone=Body("zone", Box(keys.zone_size), transform(t=keys.zone_centre), "zone"),
        fixed=_fixed_bodies(keys, root),
        live_camera=camera_of(keys, root, nominal_camera),
        speed_registers=_registers(root, "speed", keys.speed_registers, unit),
        acceleration_registers=_registers(root, "acceleration", keys.acceleration_registers, unit),
        inputs=inputs,
        digest=sha256(canonical_json(inputs)),
    )
    cell.robot()  # raises if parts of the tool are inconsistent, or have names of the arm's
    if not cell.has_jaws:
        return cell
    room = (cell.gripper.opening - cell.cube_size) / 2.0 - PlanOptions.line_clearance
    if cell.moved > room + 1e-9:
        raise root.error_at(
            "look.moved_mm",
            f"must be at most {max(room, 0.0) * 1e3:g} mm: a cube shifted that far must fit between the open jaws "
            f"with {PlanOptions.line_clearance * 1e3:g} mm of clearance "
            f"(tool.jaw_opening_mm {cell.gripper.opening * 1e3:g}, cube.size_mm {cell.cube_size * 1e3:g})",
        )
    return cell


def _check_padding(keys: _CommonKeys, root: Node) -> None:
    """Check that ``arm_compared`` is a date and a name, and is there if the padding is less than the default."""
    compared = keys.arm_compared
    if keys.arm_padding < ARM_PADDING_MM / 1e3 and not compared:
        rule = f"must be at least {ARM_PADDING_MM:g} mm until the arm's assumed bodies are compared with the real arm"
        help = 'compare them (docs/real-cell.md), and add arm_compared = "who and when"'
        raise root.error_at("arm_padding_mm", rule, help)
    if compared and not (any(c.isdigit() for c in compared) and any(c.isalpha() for c in compared)):
        rule = "must be the date and the name of who compared the arm's bodies with the arm"
        raise root.error_at("arm_compared", rule)


def _check_motion(keys: _CommonKeys, root: Node) -> None:
    """Check the clearance of transits against the smallest value allowed for it, and the timing against jerk limits."""
    if keys.timing == "toppra" and keys.jerk_time > 0.0:
        raise root.error_at("motion.timing", "must be own with a jerk limit (motion.jerk_time_s)")
    if keys.clearance < keys.least_clearance:
        unit = f"the unit is mm: 10 mm is 10, and this is {1e3 * keys.clearance:g} mm"
        exception = "less is a deliberate exception: motion.least_clearance_mm"
        help = f"{unit}; {exception}" if keys.least_clearance == LEAST_CLEARANCE else unit
        rule = f"must be a number in mm from {1e3 * keys.least_clearance:g} to 100"
        raise root.error_at("motion.clearance_mm", rule, help)


def _check_zone(keys: _CommonKeys, root: Node) -> None:
    """Check that the box in which boards may stand is not wholly below the table's top, which carries them."""
    top = float(keys.zone_centre[2]) + keys.zone_size[2] / 2.0
    if top >= keys.table_z:
        return
    zone = root["boards"]
    rule = (
        f"must not be above the zone for boards, which ends at z = {1e3 * top:g} mm by boards.zone_centre_mm = "
        f"{zone['zone_centre_mm'].value} and boards.zone_size_mm = {zone['zone_size_mm'].value}"
    )
    help = "heights are z in the base frame, 0 in the arm's mounting plane, not above the floor"
    raise root.error_at("table.top_z_mm", rule, help)


def _calibrated(camera: Camera, calibration: ArmCalibration) -> Camera:
    """Return the camera with the pose, and with the lens as far as the calibration refined it."""
    camera = camera.at(calibration.T_base_camera)
    if calibration.intrinsics is None:
        return camera
    (fx, fy, cx, cy), distortion = calibration.intrinsics[:4], calibration.intrinsics[4:]
    K = frozen(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]))
    covariance = calibration.covariance
    left = camera.lens_covariance if covariance is None else covariance[-len(calibration.intrinsics) :, -9:]
    return replace(camera, K=K, distortion=frozen(distortion), lens_covariance=left)


def _calibration(keys: _CommonKeys, root: Node, unit: Unit, camera: Camera) -> ArmCalibration | None:
    """Read the calibration file of the cell, if any. It must be of this unit, arm and lens."""
    if keys.calibration is None:
        return None
    calibration = read_arm_calibration(root["calibration"].read(path()))
    if calibration.unit != unit.name:
        of = f"is of {calibration.unit}" if calibration.unit else "names no unit"
        raise root.error_at("calibration", f"{of}, but unit is {unit.name}; calibrate this arm")
    if calibration.dh not in ("", A465.digest):
        rule = "is of an arm with other dimensions (dh of its recording) than the cell's"
        raise root.error_at("calibration", rule)
    if calibration.lens not in ("", camera.lens_digest):
        rule = "was made with another lens than that of the camera file; calibrate again with this lens"
        raise root.error_at("calibration", rule)
    return calibration


def _registers(root: Node, name: str, given: tuple[int, ...] | None, unit: Unit) -> tuple[int, ...]:
    """Return the registers of this name, or the unit's, after a check against their caps."""
    caps = unit.speed_register_cap() if name == "speed" else unit.acceleration_register_cap()
    if given is None:
        return unit.speed_registers if name == "speed" else unit.acceleration_registers
    for axis, value, cap in zip(unit.axes, given, caps, strict=True):
        if value > cap:
            rule = f"axis {axis} must be at most {cap}: twice the unit's default, within the data sheet"
            raise root.error_at(f"motion.{name}_registers", rule)
    return given


def _fixed_bodies(keys: _CommonKeys, root: Node) -> tuple[Body, ...]:
    (x, y), (width, depth), z = keys.centre.tolist(), keys.size.tolist(), keys.table_z - keys.thickness / 2.0
    top = Body("table", Box((width, depth, keys.thickness)), transform(t=(x, y, z)), "table")
    if keys.walls:
        require_names_differ(root["walls"], keys.walls, (top,))
        for node, wall in zip(root["walls"].items(), keys.walls, strict=True):
            if wall.name in (*LINKS, *HAND):
                raise node.error_at("name", "is that of a body of the arm; names of bodies must differ")
    return top, *keys.walls
