"""Keys of the cell file about the gripper: ``[tool]``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.io.toml_reader import TomlTable
from arm.robot.gripper import Gripper, Size

SHIPPED = Gripper()
VOLTS_A_REGISTER = 7.5 / 10_000  # volts per step of REGME of the gripper's axis
MOST_VOLTS = 11.25  # three quarters of 15 V; above, the maker allows the motor only 15 s


def read_gripper(tool: TomlTable, cube_size: float) -> Gripper:
    """Read the gripper of ``[tool]``, given by its dimensions or by a URDF.

    Args:
        tool: the table.
        cube_size: edge of the cubes that it grips, m.

    Raises:
        InputError: a value is wrong, a dimension is missing, or the parts are longer than the gripper.
    """
    length = tool.number("length_mm", "mm", 1, 1000) / 1e3
    opening = tool.number("jaw_opening_mm", "mm", 1, 300) / 1e3
    shut = tool.number("jaw_shut_mm", "mm", 0, 300, default=0.0) / 1e3
    usual = 1e3 * (shut + 0.1 * (opening - shut))
    close_to = tool.number("close_to_mm", "mm", 0, 300, default=usual) / 1e3
    if cube_size >= opening:
        raise tool.error("jaw_opening_mm", f"must be more than the cube's {cube_size * 1e3:g} mm")
    if shut >= cube_size:
        raise tool.error("jaw_shut_mm", f"must be less than the cube's {cube_size * 1e3:g} mm")
    if not shut <= close_to < cube_size:
        raise tool.error(
            "close_to_mm",
            f"must be from {shut * 1e3:g} mm (jaw_shut_mm) to less than the cube's {cube_size * 1e3:g} mm, so that "
            "the jaws close on a cube",
        )
    own = tool.path("urdf") if "urdf" in tool else None
    jaws = Gripper(opening=opening, shut=shut, close_to=close_to)
    given = [key for key in ("finger_mm", "palm_mm", "body_radius_mm") if key in tool]
    if own is not None:
        if given:
            raise tool.error(given[0], "cannot be combined with urdf, which describes the whole gripper")
        return replace(jaws, length=length, urdf=own)
    if given:
        finger, palm = _size(tool, "finger_mm"), _size(tool, "palm_mm")
        radius = tool.number("body_radius_mm", "mm", 1, 300) / 1e3
        if length < finger[2] + palm[2]:
            raise tool.error(
                "length_mm", f"must be at least that of fingers and palm, {1e3 * (finger[2] + palm[2]):g} mm"
            )
        return replace(jaws, length=length, finger=finger, palm=palm, body_radius=radius)
    if abs(length - SHIPPED.length) > 1e-6:
        raise tool.error(
            "length_mm",
            f"must be {SHIPPED.length * 1e3:g} mm, that of the shipped gripper, which is the default",
            "for another gripper give finger_mm, palm_mm and body_radius_mm, or its urdf",
        )
    return replace(jaws, length=length)


def _size(tool: TomlTable, key: str) -> Size:
    x, y, z = (float(v) / 1e3 for v in tool.numbers(key, 3, "mm", 1, 500))
    return x, y, z


def with_force(unit: Unit, tool: TomlTable) -> Unit:
    """Return the unit with the gripper's motor voltage set to ``force_v`` of ``[tool]``, if given.

    Raises:
        InputError: ``force_v`` is out of range.
    """
    if "force_v" not in tool:
        return unit
    volts = tool.number("force_v", "V", 0.75, MOST_VOLTS)
    registers = {**unit.gripper.registers, "REGME": round(volts / VOLTS_A_REGISTER)}
    return replace(unit, gripper=replace(unit.gripper, registers=registers))


def gripper_of_inputs(inputs: Any) -> Gripper | None:
    """Return the gripper of a plan's cell, or None if it has its own URDF or cannot be derived.

    Args:
        inputs: dotted key to value (`cell.config.inputs`).
    """
    if not isinstance(inputs, Mapping) or "tool.urdf" in inputs:
        return None
    try:
        measures = {
            name: _metres(inputs[key])
            for name, key in (
                ("length", "tool.length_mm"),
                ("opening", "tool.jaw_opening_mm"),
                ("shut", "tool.jaw_shut_mm"),
                ("finger", "tool.finger_mm"),
                ("palm", "tool.palm_mm"),
                ("body_radius", "tool.body_radius_mm"),
            )
            if key in inputs or name in ("length", "opening")
        }
        return replace(SHIPPED, **{"close_to": measures.get("shut", 0.0), **measures})
    except (KeyError, TypeError, ValueError, InputError):
        return None


def _metres(value: Any) -> Any:
    return tuple(float(v) / 1e3 for v in value) if isinstance(value, list) else float(value) / 1e3
