"""Keys of the cell file whose values are used unchanged, in SI units."""

from __future__ import annotations

from arm.io.keys import Keys, key
from arm.io.rules import integer, number, numbers, port, rule_of, text
from arm.se3 import Array
from cell.config.board_keys import DICTIONARY
from plan.options import LEAST_CLEARANCE, SOLVERS, TIMINGS, PlanOptions

ARM_PADDING_MM = 10.0  # default; of links whose bodies were not compared with the real arm
SECOND_LOOKS = ("asked", "each", "never")
_FRACTION = number("", 0.01, 1.0)


class JawValues(Keys):
    """Values of a cell about its jaws, in m and s; a cell whose tool has none has the defaults of `Cell`."""

    grip_height: float = key("tool.grip_height_mm", number("mm", 0, 32))
    settle_s: float = key("tool.settle_s", number("s", 0, 30))
    grip_tolerance: float = key("tool.grip_tolerance_mm", number("mm", 0.1, 20), 3)


class CellValues(Keys):
    """Values of a cell, in m, s and rad; `cell/texts/keys.toml` explains each key."""

    port: str | None = key("port", port(), None)
    q_start: Array = key("q_start_deg", numbers(6, "deg", -360, 360))
    arm_padding: float = key("arm_padding_mm", number("mm", 0, 100), ARM_PADDING_MM)
    arm_compared: str = key(
        "arm_compared", rule_of("a string", lambda v: isinstance(v, str), str.strip), default=""
    )
    tool_sideways: float = key("tool.least_certain_mm", number("mm", 0.01, 20), 1.0)
    tool_height: float = key("tool.least_certain_height_mm", number("mm", 0.01, 20), 1.5)
    cube_size: float = key("cube.size_mm", number("mm", 5, 80))
    cube_tolerance: float = key("cube.size_tolerance_mm", number("mm", 0.01, 2), 0.1)
    dictionary: str = key("boards.dictionary", DICTIONARY)
    table_z: float = key("table.top_z_mm", number("mm", -2000, 2000))
    photographs: int = key("look.photographs", integer(1, 100))
    moved: float = key("look.moved_mm", number("mm", 0.01, 100))
    turned: float = key("look.moved_deg", number("deg", 0.01, 90))
    camera_moved: float = key("look.camera_moved_mm", number("mm", 0.05, 20), 2)
    second_look: str = key("look.second", text(*SECOND_LOOKS), "asked")
    second_look_height: float = key("look.second_mm", number("mm", 2, 25), 10)
    offset: float = key("motion.offset_mm", number("mm", 45, 300))
    clearance: float = key("motion.clearance_mm", number("mm", 0, 100))
    least_clearance: float = key(
        "motion.least_clearance_mm", number("mm", 0, 1e3 * LEAST_CLEARANCE), default=1e3 * LEAST_CLEARANCE
    )
    approach_speed: float = key("motion.approach_mm_s", number("mm/s", 1, 250))
    speed: float = key("motion.speed", number("", 0.01, 1.0))
    velocity_fraction: float = key(
        "motion.velocity_fraction", _FRACTION, default=PlanOptions.velocity_fraction
    )
    acceleration_fraction: float = key(
        "motion.acceleration_fraction", _FRACTION, default=PlanOptions.acceleration_fraction
    )
    jerk_time: float = key("motion.jerk_time_s", number("s", 0, 2), PlanOptions.jerk_time)
    timing: str = key("motion.timing", text(*TIMINGS), PlanOptions.timing)
    solver: str = key("solver.lines", text(*SOLVERS), PlanOptions.solver)
    least_insertion: float = key("accuracy.least_insertion", number("", 0, 1), 0.997)
    tool_tolerance: float = key("accuracy.tool_within_mm", number("mm", 0, 10), 0.2)
    pocket_tolerance: float = key("accuracy.pocket_within_mm", number("mm", 0, 10), 0.1)
    following_error: float = key("accuracy.following_deg", number("deg", 0, 1), 0)
    sigmas: float = key("accuracy.sigmas", number("", 0, 10), 3)
    erring_clearance: float = key("accuracy.least_clearance_mm", number("mm", 0, 100), 0)
    recovery_attempts: int = key("recovery.attempts", integer(0, 10), 3)
