"""Keys of the cell file about the tool, a gripper or one without jaws: ``[tool]``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.node import Node
from arm.io.rules import number, path, triple
from arm.robot.gripper import Gripper, Size
from cell.config.cell_values import JawValues

SHIPPED = Gripper()
VOLTS_A_REGISTER = 7.5 / 10_000  # volts per unit of the register REGME of the gripper's axis
MOST_VOLTS = 11.25  # three quarters of 15 V; the manufacturer allows more for only 15 s
SIZES = ("finger", "palm", "body_radius")  # fields of a gripper that its dimensions describe
_BOX = triple("mm", 1, 500)


class GripperKeys(Keys):
    """Keys of the gripper, which its dimensions or a URDF describe."""

    length: float = key("tool.length_mm", number("mm", 1, 1000))
    opening: float = key("tool.jaw_opening_mm", number("mm", 1, 300))
    shut: float = key("tool.jaw_shut_mm", number("mm", 0, 300), 0)
    close_to: float | None = key("tool.close_to_mm", number("mm", 0, 300), None)
    force_v: float | None = key("tool.force_v", number("V", 0.75, MOST_VOLTS), None)
    finger: Size | None = key("tool.finger_mm", _BOX, None)
    palm: Size | None = key("tool.palm_mm", _BOX, None)
    body_radius: float | None = key("tool.body_radius_mm", number("mm", 1, 300), None)
    urdf: Path | None = key("tool.urdf", path(), None)


class BodiesKeys(Keys):
    """The key of a tool without jaws."""

    tool_file: Path | None = key("tool.bodies", path(), None)


def is_without_jaws(root: Node) -> bool:
    """Whether a cell file has a tool without jaws.

    Raises:
        InputError: it also has a key of a gripper.
    """
    if not ("tool" in root and "bodies" in root["tool"]):
        return False
    of_jaws = [one.name for kind in (GripperKeys, JawValues) for one in kind.declared().values()]
    for name in (name.removeprefix("tool.") for name in of_jaws):
        if name in root["tool"]:
            rule = "belongs to a gripper, and cannot be combined with tool.bodies"
            raise root.error_at(f"tool.{name}", rule)
    return True


def gripper_of(keys: GripperKeys, root: Node, cube_size: float) -> Gripper:
    """Return the gripper.

    Args:
        keys: its keys.
        root: the cell file, for messages.
        cube_size: edge of the cubes that it grips, m.

    Raises:
        InputError: a dimension is missing, does not fit the cube, or the parts are longer than the gripper.
    """
    edge = f"the cube's {cube_size * 1e3:g} mm"
    close_to = keys.shut + 0.1 * (keys.opening - keys.shut) if keys.close_to is None else keys.close_to
    if cube_size >= keys.opening:
        raise root.error_at("tool.jaw_opening_mm", f"must be more than {edge}")
    if keys.shut >= cube_size:
        raise root.error_at("tool.jaw_shut_mm", f"must be less than {edge}")
    if not keys.shut <= close_to < cube_size:
        raise root.error_at(
            "tool.close_to_mm",
            f"must be from {keys.shut * 1e3:g} mm (jaw_shut_mm) to less than {edge}, so that the jaws close on a cube",
        )
    declared = GripperKeys.declared()
    given = [name for name in SIZES if getattr(keys, name) is not None]
    jaws = Gripper(opening=keys.opening, shut=keys.shut, close_to=close_to)
    if keys.urdf is not None:
        for name in given:
            rule = "cannot be combined with urdf, which describes the whole gripper"
            raise root.error_at(declared[name].name, rule)
        return replace(jaws, length=keys.length, urdf=keys.urdf)
    if given:
        whole = {name: root.get(declared[name].name, declared[name].rule) for name in SIZES}
        parts = 1e3 * (whole["finger"][2] + whole["palm"][2])
        if 1e3 * keys.length < parts:
            raise root.error_at("tool.length_mm", f"must be at least that of fingers and palm, {parts:g} mm")
        return replace(jaws, length=keys.length, **whole)
    if abs(keys.length - SHIPPED.length) > 1e-6:
        rule = f"must be {SHIPPED.length * 1e3:g} mm, that of the shipped gripper, which is the default"
        help = "for another gripper give finger_mm, palm_mm and body_radius_mm, or its urdf"
        raise root.error_at("tool.length_mm", rule, help)
    return replace(jaws, length=keys.length)


def with_force(unit: Unit, volts: float | None) -> Unit:
    """Return the unit with the voltage of the gripper's motor, V, if given."""
    if volts is None:
        return unit
    registers = {**unit.gripper.registers, "REGME": round(volts / VOLTS_A_REGISTER)}
    return replace(unit, gripper=replace(unit.gripper, registers=registers))


def without_gripper(unit: Unit) -> Unit:
    """Return the unit with nothing on its gripper's axis."""
    return replace(unit, gripper=replace(unit.gripper, fitted=False))


def gripper_of_inputs(inputs: Any) -> Gripper | None:
    """Return the gripper of a plan's cell; None if it has none, has its own URDF, or cannot be derived.

    Args:
        inputs: dotted key to value (`cell.config.inputs`).
    """
    if not isinstance(inputs, Mapping) or "tool.urdf" in inputs:
        return None
    try:
        measures = {
            name: _metres(inputs[one.name])
            for name, one in GripperKeys.declared().items()
            if name in ("length", "opening") or (name in ("shut", *SIZES) and one.name in inputs)
        }
        return replace(SHIPPED, **{"close_to": measures.get("shut", 0.0), **measures})
    except (KeyError, TypeError, ValueError, InputError):
        return None


def _metres(value: Any) -> Any:
    return tuple(float(v) / 1e3 for v in value) if isinstance(value, list) else float(value) / 1e3
