"""Measured widths of cubes, stored beside a plan: after a stop, a cube in the jaws can no longer be measured."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from arm.errors import ExecutionStopped
from arm.io.keys import Keys, key
from arm.io.node import Node
from arm.io.rules import number, table
from arm.io.storage import read_json, write_atomic
from vision.occupancy.seated import CubeWidth

FILE = "widths.json"  # in the run folder, beside the plans
MOST_OFF = 3.0  # largest deviation of a width from the nominal one, in tolerances


def write_widths(folder: Path, widths: Mapping[str, CubeWidth]) -> None:
    """Write the widths of cubes by name, replacing an existing file.

    Raises:
        InputError: the file cannot be written.
    """
    value = {name: {"width_mm": 1e3 * w.value, "std_mm": 1e3 * w.std} for name, w in sorted(widths.items())}
    write_atomic(folder / FILE, json.dumps(value, indent=2, allow_nan=False) + "\n")


@contextmanager
def width_kept(folder: Path, cube: str, width: Callable[[], CubeWidth | None]) -> Iterator[None]:
    """Write the width of the cube if a stop leaves it in the jaws."""
    try:
        yield
    except ExecutionStopped as error:
        if error.data.get("holding") == cube:
            known = width()
            if known is not None:
                write_widths(folder, {cube: known})
        raise


class _WidthKeys(Keys):
    width: float = key("width_mm", number("mm"))
    std: float = key("std_mm", number("mm"))


def read_widths(folder: Path, nominal: CubeWidth) -> dict[str, CubeWidth]:
    """Read the widths of cubes by name; empty without a file.

    Args:
        folder: folder of a plan.
        nominal: nominal width of the cell's cubes.

    Raises:
        FileInputError: the file was not written by `write_widths`, or is of other cubes.
    """
    file = folder / FILE
    if not file.is_file():
        return {}
    root = Node(file, "", read_json(file), "remove the file")
    widths: dict[str, CubeWidth] = {}
    for name in root.read(table()):
        keys = _WidthKeys.read(root[name])
        if not (abs(keys.width - nominal.value) <= MOST_OFF * 2.0 * nominal.std and keys.std > 0.0):
            raise root[name].error(f"must be a width of this cell's cubes, {1e3 * nominal.value:g} mm")
        widths[name] = CubeWidth(keys.width, keys.std)
    return widths
