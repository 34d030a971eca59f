"""Keys of a unit's file, such as ``urdf/a465/crs93.toml``."""

from __future__ import annotations

import re
from typing import Any

from arm.io.keys import Keys, key
from arm.io.rules import integer, integers, number, numbers, rule_of, text, turns
from arm.se3 import Array

MOST_REST_TOLERANCE = 500  # counts, 0.45 to 0.9 deg
REST_TOLERANCE = 25  # counts, static error of real units after a move (0.023 to 0.045 deg)


def _is_letters(value: object, count: int | None = None) -> bool:
    """Whether a value is a list or string of axis letters."""
    return (
        isinstance(value, list | str)
        and all(isinstance(a, str) and len(a) == 1 and "A" <= a <= "H" for a in value)
        and count in (None, len(value))
    )


NO_UNIT = "none"  # in plans: of an arm without a controller
_NAME = rule_of(
    f"up to 40 letters, digits, - and _, and not {NO_UNIT}",
    lambda v: isinstance(v, str) and re.fullmatch(r"[A-Za-z0-9][\w-]{0,39}", v, re.ASCII) and v != NO_UNIT,
    str,
)
_FIRMWARE = rule_of(
    "a string",
    lambda v: isinstance(v, str) and v.strip(),
    str,
    lambda v: "an empty one fits every controller" * (v == ""),
)
_GROUPS = rule_of("groups of axis letters", lambda v: isinstance(v, list) and all(map(_is_letters, v)), list)
_SIX_COUNTS = integers(6, -(2**23), 2**23 - 1)
_SIX_REGISTERS = integers(6, 0, 32767)
_SIX_SPEEDS = integers(6, 1, 32767)
_REGISTER, _ADC, _CHANNEL = integer(0, 32767), integer(0, 4095), integer(0, 64)


class UnitValues(Keys):
    """Keys whose values `arm.controller.unit.Unit` takes unchanged.

    Attributes:
        name: ``crs93`` or ``crs97``, or another one of a user's own unit.
        firmware: beginning of the answer to VER.
        axes: controller axis letter of each joint.
        velocity_cap: velocity limits of the data sheet, (6,) rad/s.
        rest_tolerance: largest position error of an axis at rest, counts.
        speed_registers, acceleration_registers: the unit's defaults, (6,) int.
        idle_release_s: idle time after which the controller releases the arm (IDLEREL), s.
        soft_home: configuration after homing, (6,) rad.
    """

    name: str = key("name", _NAME)
    firmware: str = key("firmware", _FIRMWARE)
    axes: tuple[str, ...] = key(
        "axes", rule_of("six letters from A to H", lambda v: _is_letters(v, 6), tuple)
    )
    velocity_cap: Array = key("limits.data_sheet_deg_s", numbers(6, "deg/s", 1, 1000))
    rest_tolerance: int = key(
        "limits.rest_tolerance_counts", integer(1, MOST_REST_TOLERANCE), default=REST_TOLERANCE
    )
    speed_registers: tuple[int, ...] = key("registers.speed", _SIX_SPEEDS)
    acceleration_registers: tuple[int, ...] = key("registers.acceleration", _SIX_SPEEDS)
    idle_release_s: int = key("registers.idle_release_s", integer(0, 86400))
    soft_home: Array = key("homing.soft_home_deg", turns(6))


class GripperValues(Keys):
    """Keys whose values `arm.controller.unit.GripperAxis` takes unchanged; positions are ADC counts."""

    axis: str = key("gripper.axis", text("G", "H"))
    open_adc: int = key("gripper.open_adc", _ADC)
    closed_adc: int = key("gripper.closed_adc", _ADC)
    adc_channel: int = key("gripper.adc_channel", _CHANNEL)
    current_channel: int = key("gripper.current_channel", _CHANNEL)


class UnitKeys(UnitValues, GripperValues, file="a unit file"):
    """Keys of a unit file."""

    model: str = key("model", text())
    per_turn: Array = key("encoder.counts_per_turn", numbers(6, "lines", 1, 1e6))
    gear: Array = key("encoder.gear", numbers(6, "", 1, 1e4))
    direction: Array = key("encoder.direction", numbers(6, "", -1, 1))
    at_zero: tuple[int, ...] = key("encoder.counts_at_zero", _SIX_COUNTS)
    lower: tuple[int, ...] = key("limits.lower_counts", _SIX_COUNTS)
    upper: tuple[int, ...] = key("limits.upper_counts", _SIX_COUNTS)
    sheet: Array = key("limits.data_sheet_deg", numbers(6, "deg", 1, 360))
    margin: float = key("limits.margin_deg", number("deg", 0, 30))
    REGME: tuple[int, ...] = key("registers.energy", _SIX_REGISTERS)
    REGCFG: tuple[int, ...] = key("registers.configuration", _SIX_REGISTERS)
    REGP: tuple[int, ...] = key("registers.p", _SIX_REGISTERS)
    REGI: tuple[int, ...] = key("registers.i", _SIX_REGISTERS)
    REGD: tuple[int, ...] = key("registers.d", _SIX_REGISTERS)
    homing: list[Any] = key("homing.sequence", _GROUPS)
    gripper_REGS2: int = key("gripper.feedback", _REGISTER)
    gripper_REGME: int = key("gripper.energy", integer(0, 20000))
    gripper_REGMS: int = key("gripper.speed", integer(1, 32767))
    gripper_REGCFG: int = key("gripper.configuration", _REGISTER)
    gripper_REGP: int = key("gripper.p", _REGISTER)
    gripper_REGI: int = key("gripper.i", _REGISTER)
    gripper_REGD: int = key("gripper.d", _REGISTER)
