"""Read the cell file (TOML). Every value is checked; messages name file and key."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.board import Board, read_board_csv
from arm.calibration_file import ArmCalibration, read_arm_calibration
from arm.controller.unit import MOST_REST_TOLERANCE, UNITS, Unit, load_unit
from arm.errors import FileInputError, InputError
from arm.io.storage import canonical_json, sha256
from arm.io.toml_reader import TomlTable
from arm.robot.dh import A465
from arm.robot.shapes import Body, Box
from arm.se3 import frozen, transform
from cell.config.board_keys import DICTIONARIES, read_board_limits, read_pocket, read_tilts
from cell.config.bodies import read_body
from cell.config.camera_keys import read_cell_camera
from cell.config.cell import Cell
from cell.config.inputs import LEFT_OUT, config_inputs
from cell.config.key_notes import CELL, known_keys
from cell.config.tool_keys import read_gripper, with_force
from plan.options import LEAST_CLEARANCE, PlanOptions
from vision.camera.model import Camera, read_camera

FRACTIONS = (0.01, 1.0)
ARM_PADDING_MM = 10.0  # for links whose bodies were not compared with the real arm
MADE_WITHIN_MM = 0.1  # default manufacturing tolerance of boards


def read_cell(path: Path, on_uncalibrated: Callable[[InputError], None] | None = None) -> Cell:
    """Read a cell file.

    Args:
        path: the file.
        on_uncalibrated: called with the reason why the calibration file cannot be used; the cell is then read without
            it. None: raise.

    Raises:
        InputError: a value is wrong; names file, key, value, unit and rule.
    """
    root = TomlTable.read(path)
    root.knows(known_keys(CELL))
    unit_name = root.text("unit", choices=UNITS)
    camera_file = root.path("camera")
    tool = root.table("tool")
    boards_table = root.table("boards")
    look = root.table("look")
    motion = root.table("motion")
    cube = root.table("cube")

    nominal_unit, nominal_camera = with_force(load_unit(unit_name), tool), read_camera(camera_file)
    rest = motion.integer(
        "rest_tolerance_counts", 1, MOST_REST_TOLERANCE, default=nominal_unit.rest_tolerance
    )
    nominal_unit = replace(nominal_unit, rest_tolerance=rest)
    cube_size = cube.number("size_mm", "mm", 5, 80) / 1e3
    calibration = None
    try:
        calibration = _calibration(root, nominal_unit, nominal_camera)
    except InputError as error:
        if on_uncalibrated is None:
            raise
        on_uncalibrated(error)
    unit, camera = nominal_unit, nominal_camera
    if calibration is not None:
        unit = unit.calibrated(calibration.joint_offsets)
        camera = camera.at(calibration.T_base_camera)
    q_start = frozen(np.radians(root.numbers("q_start_deg", 6, "deg", -360, 360)))
    for joint, (q, low, high) in enumerate(zip(q_start, unit.lower, unit.upper, strict=True), start=1):
        if not low <= q <= high:
            raise root.error(
                "q_start_deg",
                f"J{joint} must be from {np.degrees(low):.1f} to {np.degrees(high):.1f} deg on {unit.name}",
            )
    speed_registers = _registers(motion, "speed_registers", unit.speed_registers, unit.speed_register_cap())
    acceleration_registers = _registers(
        motion, "acceleration_registers", unit.acceleration_registers, unit.acceleration_register_cap()
    )
    clearance, least_clearance = _clearance(motion)
    table_z = root.table("table").number("top_z_mm", "mm", -2000, 2000) / 1e3
    cell = Cell(
        file=path,
        unit=unit,
        camera=camera,
        nominal_unit=nominal_unit,
        nominal_camera=nominal_camera,
        calibration=calibration,
        camera_file=camera_file,
        gripper=read_gripper(tool, cube_size),
        arm_padding=_arm_padding(root),
        arm_compared=_arm_compared(root),
        grip_height=tool.number("grip_height_mm", "mm", 0, 32) / 1e3,
        settle_s=tool.number("settle_s", "s", 0, 30),
        grip_tolerance=tool.number("grip_tolerance_mm", "mm", 0.1, 20, default=3.0) / 1e3,
        cube_size=cube_size,
        cube_tolerance=cube.number("size_tolerance_mm", "mm", 0.01, 2, default=0.1) / 1e3,
        boards=_boards(boards_table, read_pocket(boards_table, cube, cube_size)),
        dictionary=boards_table.text("dictionary", choices=DICTIONARIES),
        tilts=read_tilts(boards_table),
        board_limits=read_board_limits(look),
        stand_size=_pair_m(boards_table, "stand_size_mm", 10, 240),
        zone=_zone(boards_table),
        fixed=_fixed_bodies(root),
        table_z=table_z,
        q_start=q_start,
        photographs=look.integer("photographs", 1, 100),
        basler=read_cell_camera(look),
        moved=look.number("moved_mm", "mm", 0.01, 100) / 1e3,
        turned=float(np.radians(look.number("moved_deg", "deg", 0.01, 90))),
        offset=motion.number("offset_mm", "mm", 45, 300) / 1e3,
        clearance=clearance,
        least_clearance=least_clearance,
        approach_speed=motion.number("approach_mm_s", "mm/s", 1, 250) / 1e3,
        speed=motion.number("speed", "", 0.01, 1.0),
        velocity_fraction=motion.number(
            "velocity_fraction", "", *FRACTIONS, default=PlanOptions.velocity_fraction
        ),
        acceleration_fraction=motion.number(
            "acceleration_fraction", "", *FRACTIONS, default=PlanOptions.acceleration_fraction
        ),
        speed_registers=speed_registers,
        acceleration_registers=acceleration_registers,
        jerk_time=motion.number("jerk_time_s", "s", 0, 2, default=PlanOptions.jerk_time),
        inputs={},
        digest="",
    )
    cell.robot()  # raises if length, fingers and palm of the gripper are inconsistent
    room = (cell.jaw_opening - cell.cube_size) / 2.0 - PlanOptions.line_clearance
    if cell.moved > room + 1e-9:
        raise look.error(
            "moved_mm",
            f"must be at most {max(room, 0.0) * 1e3:g} mm: a cube shifted that far must fit between the open jaws "
            f"with {PlanOptions.line_clearance * 1e3:g} mm of clearance "
            f"(tool.jaw_opening_mm {cell.jaw_opening * 1e3:g}, cube.size_mm {cell.cube_size * 1e3:g})",
        )
    for table in (tool, boards_table, look, motion, cube, root):
        table.finish()
    inputs = config_inputs(root.value_dict(), LEFT_OUT, cell.boards)
    return replace(cell, inputs=inputs, digest=sha256(canonical_json(inputs)))


def _arm_padding(root: TomlTable) -> float:
    """Return ``arm_padding_mm`` in m; less than the default requires ``arm_compared``."""
    padding = root.number("arm_padding_mm", "mm", 0, 100, default=ARM_PADDING_MM)
    if padding < ARM_PADDING_MM and not root.text("arm_compared", default="").strip():
        raise root.error(
            "arm_padding_mm",
            f"must be at least {ARM_PADDING_MM:g} mm until the arm's assumed bodies are compared with the real arm",
            'compare them (docs/real-cell.md), and add arm_compared = "who and when"',
        )
    return padding / 1e3


def _arm_compared(root: TomlTable) -> str:
    """Return ``arm_compared``: empty, or a date and a name. The shipped placeholder text is refused."""
    text = root.text("arm_compared", default="").strip()
    if text and not (any(c.isdigit() for c in text) and any(c.isalpha() for c in text)):
        raise root.error(
            "arm_compared", "must be the date and the name of who compared the arm's bodies with the arm"
        )
    return text


def _clearance(motion: TomlTable) -> tuple[float, float]:
    """Return the clearance of transits and the smallest value allowed for it, m."""
    usual = LEAST_CLEARANCE * 1e3
    least = motion.number("least_clearance_mm", "mm", 0, usual, default=usual)
    try:
        return motion.number("clearance_mm", "mm", least, 100) / 1e3, least / 1e3
    except FileInputError as error:
        if error.data["value"] is None or least < usual:
            raise
        help = "to allow less, set motion.least_clearance_mm"
        raise motion.error("clearance_mm", str(error.data["rule"]), help) from error


def _calibration(root: TomlTable, unit: Unit, camera: Camera) -> ArmCalibration | None:
    """Read the calibration file of the cell, if any. It must be of this unit, arm and lens."""
    if "calibration" not in root:
        return None
    path = root.path("calibration")
    calibration = read_arm_calibration(path)
    if calibration.unit != unit.name:
        of = f"is of {calibration.unit}" if calibration.unit else "names no unit"
        raise root.error("calibration", f"{of}, but unit is {unit.name}; calibrate this arm")
    if calibration.dh not in ("", A465.digest):
        raise root.error(
            "calibration", "is of an arm with other dimensions (dh of its recording) than the cell's"
        )
    if calibration.lens not in ("", camera.lens_digest):
        raise root.error(
            "calibration",
            "was made with another lens than that of the camera file; calibrate again with this lens",
        )
    return calibration


def _registers(
    motion: TomlTable, key: str, default: tuple[int, ...], caps: tuple[int, ...]
) -> tuple[int, ...]:
    if key not in motion:
        return default
    values = motion.integers(key, 6, 1, 32767)
    for axis, value, cap in zip("ABCDEF", values, caps, strict=True):
        if value > cap:
            raise motion.error(
                key,
                f"axis {axis} must be at most {cap}: twice the unit's default, within the data sheet",
            )
    return values


def _boards(table: TomlTable, pocket: tuple[float, float]) -> tuple[Board, ...]:
    marker_size = table.number("marker_size_mm", "mm", 5, 200) / 1e3
    tolerance = table.number("made_within_mm", "mm", 0, 2, default=MADE_WITHIN_MM) / 1e3
    names = table.value("files", "a list of board CSV files")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise table.error("files", "must be a list of board CSV files")
    boards: list[Board] = []
    for name in names:
        path = table.file.parent / name
        if not path.is_file():
            raise table.error("files", f"names a file that is not there: {path}")
        board = replace(read_board_csv(path, marker_size, tolerance), pocket=pocket)
        taken = {i for b in boards for i in b.marker_ids} & set(board.marker_ids)
        if taken:
            raise table.error("files", f"two boards have the marker {min(taken)}; ids must differ", str(path))
        boards.append(board)
    return tuple(boards)


def _fixed_bodies(root: TomlTable) -> tuple[Body, ...]:
    table = root.table("table")
    x, y = table.numbers("centre_mm", 2, "mm", -5000, 5000) / 1e3
    width, depth = table.numbers("size_mm", 2, "mm", 10, 10000) / 1e3
    thickness = table.number("thickness_mm", "mm", 1, 1000) / 1e3
    top = table.number("top_z_mm", "mm", -2000, 2000) / 1e3
    table.finish()
    bodies = [
        Body(
            "table",
            Box((float(width), float(depth), thickness)),
            transform(t=(x, y, top - thickness / 2.0)),
            "table",
        )
    ]
    for wall in root.tables("walls"):
        body = read_body(wall, "wall")
        if any(body.name == b.name for b in bodies):
            raise wall.error("name", "is used twice; names of bodies must differ")
        bodies.append(body)
    return tuple(bodies)


def _zone(table: TomlTable) -> Body:
    centre = table.numbers("zone_centre_mm", 3, "mm", -5000, 5000) / 1e3
    x, y, z = (float(v) for v in table.numbers("zone_size_mm", 3, "mm", 1, 10000) / 1e3)
    return Body("zone", Box((x, y, z)), transform(t=centre), "zone")


def _pair_m(table: TomlTable, key: str, low: float, high: float) -> tuple[float, float]:
    x, y = table.numbers(key, 2, "mm", low, high) / 1e3
    return float(x), float(y)
