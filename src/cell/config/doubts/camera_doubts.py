"""What of a cell's camera is rather meant in another unit: its exposure and latency, its lens, and where it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm.robot.shapes import Box
from cell.config.cell import Cell

_BRIEF = 1e-4  # s; no light of a room is bright enough for a shorter exposure
_LATE = 10.0  # s; no stream is as late
_SQUARE = 0.03  # relative; pixels are as square as this in all but a few cameras
_SKEWED = 1e-3  # of fx; the rows and columns of a sensor are square to each other


def camera_doubts(cell: Cell) -> Iterator[str]:
    """Say which values of the cell's camera, or of its camera file, are doubtful, each with its key."""
    yield from _settings(cell)
    yield from _lens(cell)
    yield from _place(cell)


def _settings(cell: Cell) -> Iterator[str]:
    basler, video = cell.live_camera.basler, cell.live_camera.video
    if basler.exposure is not None and basler.exposure < _BRIEF:
        stated = 1e6 * basler.exposure
        yield (
            f"look.basler.exposure_us = {stated:g}: is it in ms? Then it must be {1e3 * stated:g} in us; as it is, "
            "images are dark in the light of a room"
        )
    if video.latency is not None and (video.latency > _LATE or video.latency == 0.0):
        late = f"as it is, each look waits {video.latency:g} s for a frame"
        none = "every camera is late: as it is, frames from before the request count"
        yield (
            f"look.video.latency_s = {video.latency:g}: {'is it in ms?' if video.latency else 'was it measured?'} "
            f"{late if video.latency else none}"
        )


def _lens(cell: Cell) -> Iterator[str]:
    (fx, skew), fy = cell.nominal_camera.K[0, :2].tolist(), float(cell.nominal_camera.K[1, 1])
    key = f"{cell.camera_file.name}: intrinsics.K_px"
    if abs(fx / fy - 1.0) > _SQUARE:
        yield f"{key}: fx {fx:g} and fy {fy:g} px are those of pixels that are not square: is one of them mistyped?"
    if abs(skew) > _SKEWED * fx:
        yield f"{key}: the second number of its first row, the skew, is {skew:g} px, and 0 in nearly all cameras"


def _place(cell: Cell) -> Iterator[str]:
    """Doubt the camera's place if it is no higher than boards may be, or does not see where they may stand."""
    zone, where = cell.zone, cell.camera.T_base_camera[:3, 3]
    if not isinstance(zone.shape, Box):
        return
    source = cell.camera_file if cell.calibration is None else cell.file
    x, y, z = (f"{1e3 * v:.0f}" for v in where)
    top = float(zone.T_base_body[2, 3]) + zone.shape.size[2] / 2.0
    if where[2] < top:
        yield (
            f"{source.name}: the camera is at {x}, {y}, {z} mm, lower than the zone for boards, which ends at z = "
            f"{1e3 * top:.0f} mm: is its position in another unit?"
        )
        return
    u, v = cell.camera.project_base(zone.T_base_body[:3, 3]).tolist()
    width, height = cell.camera.size
    if not (0.0 <= u < width and 0.0 <= v < height):  # NaN behind it
        at = f"at {u:.0f}, {v:.0f} px" if np.isfinite(u) else "behind it"
        yield (
            f"{source.name}: the camera at {x}, {y}, {z} mm does not have the middle of the zone for boards "
            f"(boards.zone_centre_mm) in its image of {width} x {height} px, but {at}: is the pose T_camera_base, in "
            "another unit, or with exchanged axes?"
        )
