"""What a program file states that may be in another unit, or is without effect."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from typing import Any
from xml.etree import ElementTree

import numpy as np

from arm.io.toml_reader import read_toml
from arm.numerics.products import mul, norm
from arm.se3 import apply
from cell.config.doubts.angles import doubt_of_small
from cell.program.path_step import PathStep, ThreadedLine
from cell.program.program_file import ProgramTask
from plan.collision.covers import hull

_AT_BOARD = 2.0  # mm from a board's origin; a place in m, read as mm, is nearer
_AT_CENTRE = 1.0  # mm from the workpiece's origin; the same for the middle of a body
_PAST_END, _ABOUT_RAY = 0.01, 0.02  # m, of bodies of a wire beyond its end, and beside the ray there
_SHORT_MM = 2.0  # of a path; one in m, read as mm, is shorter
_MOST_ROUNDED = 0.1  # of a path's size, by which its corners are rounded; more leaves little of its shape
_SAME_SIZE = 0.01  # of a drawing's width, by which another one may differ
_FAST_MM_S = 250.0  # on a path in contact; more is rather in mm/min
_PER_UNIT = {"mm": 1.0, "cm": 10.0, "in": 25.4}  # mm
_TURNS = ("tilt_deg", "turn_deg", "rpy_deg")


def stated_doubts(task: ProgramTask) -> Iterator[str]:
    """Say of each value that is doubtful what it may be meant as, with its key."""
    root = read_toml(task.file)
    for line in task.threads:
        if (beyond := _beyond_end(line)) > _PAST_END:
            yield (
                f"{line.name}.toml: line_mm: its bodies reach {1e3 * beyond:.0f} mm beyond its free end, on which the "
                "ring is threaded: is the line in cm, or does it end too early?"
            )
    for key, words in (*_angles(root), *_origin(task, root), *_bodies(root), *_steps(task, root)):
        yield f"{task.file.name}: {key}{words}"


def _angles(root: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield angles in deg that may be in rad."""
    found = {"work.rpy_deg": root.get("work", {}).get("rpy_deg")}
    for table in ("bodies", "steps"):
        for number, one in enumerate(root.get(table, ())):
            found |= {f"{table}[{number}].{name}": one.get(name) for name in _TURNS}
            ranges = one.get("ranges", {})
            found |= {f"{table}[{number}].ranges.{name}": ranges[name] for name in ranges if "deg" in name}
    for key, value in found.items():
        if value is not None and (doubt := doubt_of_small(value)):
            yield key, f" = {doubt}"


def _origin(task: ProgramTask, root: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the origin of a workpiece on a board that may be in metres."""
    origin = root.get("work", {}).get("origin_mm")
    if task.board is not None and origin and 0.0 < max(map(abs, origin)) < _AT_BOARD:
        yield "work.origin_mm", f" = {origin}: is it in metres? In mm it must be {_in_mm(origin)}"


def _bodies(root: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield bodies whose centre may be in metres: in mm it would be in the workpiece's origin, but for its digits."""
    for number, one in enumerate(root.get("bodies", ())):
        centre = one.get("centre_mm")
        if centre and any(centre[:2]) and max(map(abs, centre)) < _AT_CENTRE:
            yield (
                f"bodies[{number}].centre_mm",
                f" = {centre}: is it in metres? In mm it must be {_in_mm(centre)}",
            )


def _in_mm(metres: list[float]) -> str:
    return f"[{', '.join(f'{1e3 * v:g}' for v in metres)}]"


def _steps(task: ProgramTask, root: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for number, one in enumerate(root["steps"]):
        for name, words in (*_of_path(task, f"steps[{number}]", one), *_of_speed(one)):
            yield f"steps[{number}].{name}", words


def _of_path(task: ProgramTask, key: str, one: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield sizes of a path that may be wrong."""
    width = _width_mm(task, one["svg"]) if "svg" in one else None
    if width and abs(one["width_mm"] / width - 1.0) > _SAME_SIZE:
        scale = one["width_mm"] / width
        own = f"{one['svg']} states a width of {width:g} mm, so it is drawn {scale:.3g} times as large"
        yield "width_mm", f" = {one['width_mm']}: {own}"
    if "meander_mm" in one and one["pitch_mm"] > one["meander_mm"][1]:
        yield "pitch_mm", f" = {one['pitch_mm']}: is more than meander_mm[1], so there are two lines only"
    rounded = one.get("deviation_mm", 0.0)
    size = _size_mm(task, key) if rounded or "points_mm" in one else 0.0
    if "points_mm" in one and size < _SHORT_MM:
        yield "points_mm", f": the path is {size:.3g} mm large: are the points in metres?"
    if rounded > _MOST_ROUNDED * size:
        yield (
            "deviation_mm",
            f" = {rounded}: corners of a path that is {size:.0f} mm large may be rounded so far",
        )


def _of_speed(one: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a speed without effect, and one that may be in mm/min."""
    speed, has_lines = one.get("speed_mm_s", 0.0), one.get("approach_mm") or one.get("retract_mm")
    if speed and "at_mm" in one and one.get("by", "transit") == "transit" and not has_lines:
        yield "speed_mm_s", ': has no effect without lines: give by = "line", approach_mm or retract_mm'
    if speed > _FAST_MM_S and one.get("touch"):
        yield "speed_mm_s", f" = {speed}: is it in mm/min? Then it must be {speed / 60:.4g} in mm/s"


def _beyond_end(line: ThreadedLine) -> float:
    """Return how far the bodies of a wire reach beyond its free end, about the ray that prolongs it there, m."""
    along = (line.points[-1] - line.points[-2]) / norm(line.points[-1] - line.points[-2])
    beyond = 0.0
    for body in line.bodies:
        points, radius = hull(body.shape)
        away = apply(body.T_base_body, points) - line.points[-1]
        ahead = mul(away, along)
        beside = np.sqrt(((away - ahead[:, None] * along) ** 2).sum(axis=1))
        beyond = max([beyond, *(ahead[beside < _ABOUT_RAY] + radius).tolist()])
    return beyond


def _width_mm(task: ProgramTask, svg: str) -> float | None:
    """Return the width of a drawing by its own statement, mm; None without one in mm, cm or inches."""
    with suppress(ElementTree.ParseError, OSError):
        root = ElementTree.parse(task.file.parent / svg).getroot()  # read and checked before
        width = root.get("width", "")
        if found := re.fullmatch(r"\s*([\d.]+)\s*(mm|cm|in)\s*", width):
            return float(found[1]) * _PER_UNIT[found[2]]
    return None


def _size_mm(task: ProgramTask, key: str) -> float:
    """Return the largest extent of the paths of a step, mm."""
    paths = [
        one.poses.T_work_tool[:, :3, 3] for one in task.steps if isinstance(one, PathStep) and one.key == key
    ]
    return 1e3 * float(np.ptp(np.concatenate(paths), axis=0).max())
