"""The tool file (TOML): a tool without jaws on the flange, as the cell file's ``tool.bodies`` names it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.node import Node
from arm.io.rules import tables
from arm.robot.shapes import Body
from arm.robot.tool import FixedTool
from arm.se3 import Array
from cell.config.bodies import ON_FLANGE, TURN, pose_of, read_body, require_names_differ
from cell.config.inputs import Inputs

KIND = "tool"  # of the bodies
_KEY = re.compile(r"tool\.(?:bodies\[(.*)\]\.)?(\w+)", re.S)  # of `config_inputs`


class FixedToolKeys(Keys, file="a tool file"):
    """Keys of a tool file."""

    origin: Array = key("origin_mm", ON_FLANGE, [0, 0, 0])
    rpy: Array = key("rpy_deg", TURN, [0, 0, 0])
    bodies: tuple[Body, ...] = key("bodies", tables(lambda node: read_body(node, KIND)))


def read_fixed_tool(root: Node) -> FixedTool:
    """Read a tool file.

    Raises:
        InputError: a value is wrong, or two bodies have one name; names file, key, value and rule.
    """
    keys = FixedToolKeys.read(root)
    require_names_differ(root["bodies"], keys.bodies)
    return FixedTool(pose_of(keys.origin, keys.rpy), keys.bodies)


def with_tool_stated(cell: Mapping[str, Any], tool: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a cell file with that of its tool file in place of its name."""
    return {**cell, "tool": {**cell["tool"], **tool}}


def fixed_tool_of_inputs(inputs: Inputs) -> FixedTool | None:
    """Return the tool without jaws of a plan's cell; None if it is no such tool, or has a mesh, which is in a file.

    Args:
        inputs: dotted key to value, of a cell file `with_tool_stated`.
    """
    stated: dict[str, Any] = {}
    bodies: dict[str, dict[str, Any]] = {}
    for dotted, value in inputs.items():
        if (found := _KEY.fullmatch(dotted)) is None:
            continue
        name, key = found.groups()
        (stated if name is None else bodies.setdefault(name, {}))[key] = value
    if not bodies:
        return None
    wanted = {one.name for one in FixedToolKeys.declared().values()}
    content = {key: value for key, value in stated.items() if key in wanted}
    try:
        return read_fixed_tool(Node(Path(), "", {**content, "bodies": list(bodies.values())}))
    except InputError:
        return None
