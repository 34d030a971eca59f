"""Measured widths of cubes, stored beside a plan: after a stop, a cube in the jaws can no longer be measured."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from arm.errors import ExecutionStopped, FileInputError
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
    value = read_json(file)
    try:
        widths = {
            str(name): CubeWidth(float(entry["width_mm"]) / 1e3, float(entry["std_mm"]) / 1e3)
            for name, entry in value.items()
        }
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileInputError(
            file, "", None, f"is not a file of cube widths: {type(error).__name__} {error}", "remove it"
        ) from error
    for name, width in widths.items():
        fits = abs(width.value - nominal.value) <= MOST_OFF * 2.0 * nominal.std and width.std > 0.0
        if not (fits and np.isfinite(width.std)):
            raise FileInputError(
                file,
                name,
                1e3 * width.value,
                f"must be a width of this cell's cubes, {1e3 * nominal.value:g} mm",
                "remove the file",
            )
    return widths
