"""How wide cubes are, kept beside a plan: a cube that is in the jaws at a stop cannot be measured by who goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from arm.errors import ExecutionStopped, FileInputError
from arm.io.storage import read_json, write_atomic
from vision.occupancy.seated import CubeWidth

FILE = "widths.json"  # in a run's folder, beside its plans
MOST_OFF = 3.0  # tolerances, of a width from the nominal one


def write_widths(folder: Path, widths: Mapping[str, CubeWidth]) -> None:
    """Write the widths of cubes by name, replacing those of before.

    Raises:
        InputError: the file cannot be written.
    """
    told = {name: {"width_mm": 1e3 * w.value, "std_mm": 1e3 * w.std} for name, w in sorted(widths.items())}
    write_atomic(folder / FILE, json.dumps(told, indent=2, allow_nan=False) + "\n")


@contextmanager
def width_kept(folder: Path, cube: str, width: Callable[[], CubeWidth | None]) -> Iterator[None]:
    """Where a stop leaves the cube in the jaws, write how wide it is."""
    try:
        yield
    except ExecutionStopped as error:
        if error.data.get("holding") == cube:
            known = width()
            if known is not None:
                write_widths(folder, {cube: known})
        raise


def read_widths(folder: Path, nominal: CubeWidth) -> dict[str, CubeWidth]:
    """The widths of cubes by name; none where there is no such file.

    Args:
        folder: of a plan.
        nominal: width of the cell's cubes.

    Raises:
        FileInputError: it is not what `write_widths` writes, or of other cubes.
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
            file, "", None, f"is not a file of cubes' widths: {type(error).__name__} {error}", "remove it"
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
