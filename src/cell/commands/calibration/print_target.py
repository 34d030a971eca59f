"""``a465 calibrate target``: a calibration target to print at true size, with a ruler to check the print."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from arm.errors import InputError
from arm.io.node import Node
from arm.io.outputs import keep_apart
from arm.io.storage import write_atomic
from cell.console import Console
from cell.files.hand_target import read_hand_target
from cell.report.html import render
from vision.markers.dictionaries import predefined
from vision.targets.target import Target, read_target

MARGIN_MM, SCALE_MM = 10.0, 100.0  # of white around the target; longest ruler


def target_print_step(target_file: Path | None, output: Path, console: Console) -> dict[str, Any]:
    """Write an SVG of the target of a file, or of the default one of `a465 calibrate camera`.

    Raises:
        InputError: the target file or the name of the output is wrong.
    """
    keep_apart(output, target_file)
    if output.suffix.lower() != ".svg":
        why = f"{output}: the name must end in .svg, a format that keeps its size in print"
        raise InputError(why, file=str(output))
    target = Target() if target_file is None else _read(target_file)
    write_atomic(output, target_svg(target))
    width, height = (1e3 * size for size in target.size)
    if doubt := target.doubt():
        console.say(f"NOTE: {doubt}")
    console.say(f"{output}: {target.label()}; the chessboard is {width:g} x {height:g} mm")
    console.say(
        "print it at 100 %, not fitted to the page; then measure the ruler below it and ten squares in a row"
    )
    return {"file": str(output), "width_mm": width, "height_mm": height, "square_mm": 1e3 * target.square}


def _read(path: Path) -> Target:
    return read_hand_target(path).target if "hand" in Node.of_toml(path) else read_target(path)


def target_svg(target: Target) -> str:
    """Return the SVG: black rectangles on white, coordinates in mm from the chessboard's top left corner."""
    width, height = (1e3 * size for size in target.size)
    return render(
        "report/templates/target.svg.j2",
        width=width,
        height=height,
        margin=MARGIN_MM,
        ruler=min(SCALE_MM, width),
        dark=_dark(target),
        label=target.label(),
    )


def _dark(target: Target) -> Iterator[tuple[float, float, float]]:
    """Yield the dark squares: left, top and side, mm."""
    square, marker = 1e3 * target.square, 1e3 * target.marker
    for j, i in product(range(target.rows), range(target.columns)):
        if (i + j + target.white_first) % 2 == 0:
            yield i * square, j * square, square
    if target.kind != "charuco":
        return
    dictionary = predefined(target.dictionary)
    cells = dictionary.markerSize + 2  # with the border
    off, bit = (square - marker) / 2.0, marker / cells
    for number, (i, j) in enumerate(target.marker_squares()):
        image = cv2.aruco.generateImageMarker(dictionary, number, cells)
        for row, column in np.argwhere(image == 0).tolist():
            yield i * square + off + column * bit, j * square + off + row * bit, bit
