"""The report of a camera calibration as one HTML page: views, residuals, intrinsics, and views to add."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from arm.se3 import Array
from calib.camera.result import CalibrationView, CameraCalibration
from calib.camera.score_tests import ErrorHypothesis
from calib.camera.verdict import CELLS, cells, coverage, describe, where
from calib.camera.working_volume import COLUMNS, LAYERS, ROWS
from cell.report.html import Table, render
from cell.report.lens_text import VIEW_COLUMNS, intrinsics_rows, left_out, rms_mm, view_row

ARROWS = 0.02  # length of the arrow of a typical residual, in image widths
LABEL = 0.036  # font size of the views' numbers, in image widths
DEEP = 340  # height of the drawing of the targets, px
CELL = 60, 40  # width and height of a work point's cell, px


def lens_page(c: CameraCalibration, source: str) -> str:
    """Return the page, self-contained. The same calibration gives the same bytes.

    Args:
        c: calibration.
        source: name of the folder of images, for the title.
    """
    width, height = c.camera.size
    return render(
        "report/templates/lens.html.j2",
        title=f"Lens: {source}",
        source=source,
        c=c,
        width=width,
        height=height,
        figures=(
            (f"{c.corner_sigma:.3f} px", "error of a corner"),
            (f"{c.cross.sigma_px:.3f} px", "of views held out"),
            (f"{1e3 * c.work_sigmas.max():.3f} mm", f"worst work point (limit {c.limits.work_mm:g} mm)"),
            (f"{rms_mm(c.work_sigmas):.3f} mm", "mean work point"),
            (f"{100 * coverage(c):.0f} %", f"of {where(c)} covered"),
        ),
        corners=_corners(c),
        work=_work(c),
        intrinsics=Table(("", "value", "std"), intrinsics_rows(c)),
        poses=_poses(c),
        suspects=_suspects(c),
        suspected=describe(c.hypotheses[0]) if c.hypotheses and c.hypotheses[0].sigmas > 5 else "",
        next_views=list(_next_views(c)),
        views=_views(c),
    )


def _corners(c: CameraCalibration) -> dict[str, Any]:
    """Return cells of the image shaded by their number of corners, and an arrow for every residual, px."""
    width, height = c.camera.size
    count, (columns, rows) = cells(c), CELLS
    cell_w, cell_h, most = width / columns, height / rows, max(int(count.max()), 1)
    shaded = [
        (x * cell_w, y * cell_h, cell_w, cell_h, 0.25 * count[y, x] / most)
        for y in range(rows)
        for x in range(columns)
    ]
    typical = max(c.corner_sigma, 1e-6)
    scale = ARROWS * width / typical
    arrows = []
    for view in c.used:
        if view.residual is None or view.photo.view is None or view.dropped is None:
            continue
        for (u, v), (du, dv), wrong in zip(
            view.photo.view.corners_px, view.residual, view.dropped, strict=True
        ):
            size = float(np.hypot(du, dv))
            colour = "bad" if wrong else "warm" if size > 3.0 * typical else "blue"
            shown = min(scale, 0.1 * width / max(size, 1e-9))
            arrows.append((u, v, shown * du, shown * dv, colour))
    return {"cells": shaded, "arrows": arrows, "scale": scale}


def _work(c: CameraCalibration) -> dict[str, Any]:
    """Return the standard deviations of the work points, um: for each distance a grid over the image."""
    sigmas = np.full((LAYERS, ROWS, COLUMNS), np.nan)  # NaN where the lens model has no inverse
    sigmas[:, c.work.seen] = 1e6 * c.work_sigmas.reshape(LAYERS, -1)
    most, limit = float(np.nanmax(sigmas)), 1e3 * c.limits.work_mm
    cell_w, cell_h = CELL
    layer_h = ROWS * cell_h + 34
    distances = np.linspace(c.work.near, c.work.far, LAYERS)
    return {
        "size": (COLUMNS * cell_w, LAYERS * layer_h),
        "cell": CELL,
        "layers": [(layer * layer_h + 16, distance) for layer, distance in enumerate(distances)],
        "cells": [
            (column * cell_w, layer * layer_h + 24 + row * cell_h, s, 0.15 + 0.7 * s / most, s <= limit)
            for (layer, row, column), s in np.ndenumerate(sigmas)
            if np.isfinite(s)
        ],
    }


def _poses(c: CameraCalibration) -> dict[str, Any] | None:
    """Return outlines of the target in the camera frame, along the image's x and along its y; None without a pose."""
    width, height = c.target.size
    outline = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]], dtype=float)
    placed = [
        outline @ v.T_camera_target[:3, :3].T + v.T_camera_target[:3, 3]
        for v in c.used
        if v.T_camera_target is not None
    ]
    if not placed:
        return None
    points = np.concatenate(placed)
    reach = float(np.abs(points[:, :2]).max()) * 1.1
    far = float(points[:, 2].max()) * 1.05
    scale = DEEP / far
    edges, outlines, labels = [], [], []
    for axis in (0, 1):
        middle = (2 * axis + 1) * reach * scale
        half = DEEP * c.camera.size[axis] / 2.0 / c.camera.K[axis, axis]
        edges += [(middle, -half), (middle, half)]
        outlines += [
            "L".join(f"{middle + scale * p[axis]:.1f} {DEEP - scale * p[2]:.1f}" for p in corners)
            for corners in placed
        ]
        labels.append((middle, "xy"[axis]))
    return {
        "width": 4 * reach * scale,
        "height": DEEP,
        "far_m": far,
        "edges": edges,
        "outlines": outlines,
        "labels": labels,
    }


def _amount(s: ErrorHypothesis) -> str:
    if s.unit == "px":
        return f"{s.amount:+.3f} +- {s.sigma:.3f} px"
    scale, unit = (1e3, "mm") if s.unit == "m" else (100.0, "%")
    return f"{scale * s.amount:{'.3f' if unit == 'mm' else '+.3f'}} +- {scale * s.sigma:.3f} {unit}"


def _suspects(c: CameraCalibration) -> Table:
    rows = [
        (s.name, _amount(s), f"{s.sigmas:.1f}", f"{rms_mm(c.work.shifts(s.intrinsics_change)):.4f} mm")
        for s in c.hypotheses
    ]
    return Table(("cause", "amount", "standard deviations", "shift of work points"), rows)


def _next_views(c: CameraCalibration) -> Iterator[tuple[int, str, float, float, float]]:
    """Yield the number, outline, position of the number and font size, px, of each proposed view in the image."""
    lines = np.array([[0, 0, 0], [c.target.size[0], 0, 0], [*c.target.size, 0], [0, c.target.size[1], 0]])
    labels: list[Array] = []
    size = LABEL * c.camera.size[0]
    for number, view in enumerate(c.next, start=1):
        pixels = c.camera.project(
            _along(lines) @ view.T_camera_target[:3, :3].T + view.T_camera_target[:3, 3]
        )
        if not np.isfinite(pixels).all():
            continue
        label = pixels.mean(axis=0)
        while any(np.abs(label - other).max() < size for other in labels):
            label = label + (size, 0.0)  # targets at the same position with other rotations
        labels.append(label)
        yield number, "L".join(f"{u:.0f} {v:.0f}" for u, v in pixels), *label, size


def _along(corners: Array, steps: int = 12) -> Array:
    """Return points along the closed outline of `corners`, so that it shows the distortion."""
    after = np.roll(corners, -1, axis=0)
    share = np.arange(steps)[:, None] / steps
    return np.concatenate([a + share * (b - a) for a, b in zip(corners, after, strict=True)])


def _views(c: CameraCalibration) -> Table:
    worst = max((v.rms_px for v in c.used), default=1.0)

    def residual(v: CalibrationView) -> str:
        if not v.used:
            return left_out(v)
        lost = int(v.dropped.sum()) if v.dropped is not None else 0
        return "▇" * max(1, round(12 * v.rms_px / worst)) + (f"  {lost} corners left out" if lost else "")

    rows = [(*view_row(v), residual(v)) for v in c.views]
    return Table((*VIEW_COLUMNS, "residual"), rows, [i for i, v in enumerate(c.views) if not v.used])
