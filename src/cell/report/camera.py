"""The report of a camera calibration as one HTML page: views, residuals, intrinsics, and views to add."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from arm.se3 import Array
from calib.camera.result import CalibrationView, CameraCalibration
from calib.camera.verdict import CELLS, cells, coverage, describe
from calib.camera.working_volume import COLUMNS, LAYERS, ROWS
from calib.model.intrinsics import NAMES, vector_of
from cell.report.html import bullets, page, section, table

ARROWS = 0.02  # length of the arrow of a typical residual, in image widths
LABEL = 0.036  # font size of the views' numbers, in image widths
DEEP = 340  # height of the drawing of the targets


def lens_page(c: CameraCalibration, source: str) -> str:
    """Return the page, self-contained. The same calibration gives the same bytes.

    Args:
        c: the calibration.
        source: of the photographs, for the title.
    """
    badge = '<span class="badge">accepted</span>' if c.accepted else '<span class="badge no">refused</span>'
    parts = [
        f"<h1>Lens of a camera {badge}</h1>",
        f'<p class="muted">{escape(source)}: {len(c.used)} of {len(c.views)} photographs, '
        f"{escape(c.target.label())}</p>",
        section(
            "", bullets(c.reasons, "Why it is refused") + _figures(c) + bullets(c.remarks, "Worth knowing")
        ),
        '<div class="two">',
        section("Corners and their residuals", _residuals(c)),
        section("Uncertainty of the work points", _work(c)),
        section("Intrinsics", _numbers(c)),
        section("Poses of the target", _side(c)),
        section("Possible causes of error", _suspects(c)),
        section("Views that would help most", _next(c)),
        "</div>",
        section("Views", _views(c)),
    ]
    return page(f"Lens: {source}", parts)


def _figures(c: CameraCalibration) -> str:
    shown = (
        (f"{c.corner_sigma:.3f} px", "error of a corner"),
        (f"{c.cross.sigma_px:.3f} px", "of views held out"),
        (f"{1e3 * c.work_sigmas.max():.3f} mm", f"worst work point (limit {c.limits.work_mm:g} mm)"),
        (f"{1e3 * float(np.sqrt(np.mean(c.work_sigmas**2))):.3f} mm", "mean work point"),
        (f"{100 * coverage(c):.0f} %", "of the image covered"),
    )
    return f'<div class="figures">{"".join(f"<div><b>{a}</b>{b}</div>" for a, b in shown)}</div>'


def _residuals(c: CameraCalibration) -> str:
    width, height = c.camera.size
    count, (columns, rows) = cells(c), CELLS
    most = max(int(count.max()), 1)
    shapes = [
        f'<rect x="{x * width / columns:.0f}" y="{y * height / rows:.0f}" width="{width / columns:.0f}" '
        f'height="{height / rows:.0f}" fill="var(--blue)" opacity="{0.25 * count[y, x] / most:.3f}"/>'
        for y in range(rows)
        for x in range(columns)
    ]
    typical = max(c.corner_sigma, 1e-6)
    scale = ARROWS * width / typical
    for view in c.used:
        if view.residual is None or view.photo.view is None or view.dropped is None:
            continue
        for (u, v), (du, dv), wrong in zip(
            view.photo.view.corners_px, view.residual, view.dropped, strict=True
        ):
            size = float(np.hypot(du, dv))
            colour = "var(--bad)" if wrong else "var(--warm)" if size > 3.0 * typical else "var(--blue)"
            shown = min(scale, 0.1 * width / max(size, 1e-9))
            shapes.append(
                f'<path d="M{u:.1f} {v:.1f}l{shown * du:.1f} {shown * dv:.1f}" stroke="{colour}" stroke-width="2.5"/>'
                f'<circle cx="{u:.1f}" cy="{v:.1f}" r="4" fill="{colour}"/>'
            )
    return (
        f'<figure><svg viewBox="-4 -4 {width + 8} {height + 8}"><rect class="frame" width="{width}" '
        f'height="{height}" stroke-width="4"/>{"".join(shapes)}</svg><figcaption>Corners of all used views; shading: '
        f"number. Arrows: residuals, enlarged {scale:.0f} times; orange beyond three standard deviations, red left "
        "out.</figcaption></figure>"
    )


def _work(c: CameraCalibration) -> str:
    sigmas = np.full((LAYERS, ROWS, COLUMNS), np.nan)  # NaN where the lens model has no inverse
    sigmas[:, c.work.seen] = 1e6 * c.work_sigmas.reshape(LAYERS, -1)
    most = float(np.nanmax(sigmas))
    limit = 1e3 * c.limits.work_mm
    shapes, cell_w, cell_h = [], 60, 40
    for layer in range(LAYERS):
        top = layer * (ROWS * cell_h + 34)
        z = c.work.near + (c.work.far - c.work.near) * layer / (LAYERS - 1)
        shapes.append(f'<text x="0" y="{top + 16}">{1e3 * z:.0f} mm from the camera</text>')
        for row in range(ROWS):
            for column in range(COLUMNS):
                value = float(sigmas[layer, row, column])
                if np.isnan(value):
                    continue
                colour = "var(--bad)" if value > limit else "var(--good)"
                shapes.append(
                    f'<rect x="{column * cell_w}" y="{top + 24 + row * cell_h}" width="{cell_w - 2}" '
                    f'height="{cell_h - 2}" rx="4" fill="{colour}" opacity="{0.15 + 0.7 * value / most:.3f}"/>'
                    f'<text x="{(column + 0.5) * cell_w - 1}" y="{top + 24 + (row + 0.5) * cell_h + 3}" '
                    f'text-anchor="middle" style="fill:var(--ink)">{value:.0f}</text>'
                )
    return (
        f'<figure><svg viewBox="0 0 {COLUMNS * cell_w} {LAYERS * (ROWS * cell_h + 34)}">{"".join(shapes)}</svg>'
        "<figcaption>One standard deviation across the line of sight, micrometres, over the image at three distances, "
        "with the camera's pose determined again with this lens."
        + (" No value: the lens model has no inverse there." if c.work.blind else "")
        + "</figcaption></figure>"
    )


def _numbers(c: CameraCalibration) -> str:
    rows = []
    for name, value, sigma, free in zip(NAMES, vector_of(c.camera), c.sigmas, c.free, strict=True):
        pixels = name in NAMES[:4]
        shown = f"{value:.2f} px" if pixels else f"{value:.5g}"
        rows.append(("", (name, shown, f"{sigma:.2g}" if free else "held")))
    return table(("", "value", "std"), rows)


def _side(c: CameraCalibration) -> str:
    """Drawing of every target pose in the camera frame, along the image's x and along its y."""
    width, height = c.target.size
    outline = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]], dtype=float)
    placed = [
        outline @ v.T_camera_target[:3, :3].T + v.T_camera_target[:3, 3]
        for v in c.used
        if v.T_camera_target is not None
    ]
    if not placed:
        return ""
    points = np.concatenate(placed)
    reach = float(np.abs(points[:, :2]).max()) * 1.1
    far = float(points[:, 2].max()) * 1.05
    scale = DEEP / far
    shapes = []
    for panel, axis in enumerate((0, 1)):
        middle = (2 * panel + 1) * reach * scale
        half = c.camera.size[axis] / 2.0 / c.camera.K[axis, axis]
        for side in (-half, half):
            shapes.append(f'<path class="frame" d="M{middle:.1f} {DEEP}L{middle + side * DEEP:.1f} 0"/>')
        for corners in placed:
            path = "L".join(f"{middle + scale * p[axis]:.1f} {DEEP - scale * p[2]:.1f}" for p in corners)
            shapes.append(
                f'<path d="M{path}Z" fill="var(--blue)" fill-opacity="0.12" stroke="var(--blue)" stroke-width="1"/>'
            )
        shapes.append(
            f'<text x="{middle:.0f}" y="{DEEP + 18}" text-anchor="middle">image {"xy"[axis]}</text>'
        )
    return (
        f'<figure><svg viewBox="0 0 {4 * reach * scale:.0f} {DEEP + 24}">{"".join(shapes)}</svg><figcaption>'
        f"Targets in the camera's view, along the image's x and y. Top: {1e3 * far:.0f} mm from the camera."
        "</figcaption></figure>"
    )


def _suspects(c: CameraCalibration) -> str:
    rows = [
        (
            "",
            (
                s.name,
                f"{1e3 * s.amount:.3f} +- {1e3 * s.sigma:.3f} mm"
                if s.unit == "m"
                else f"{100 * s.amount:+.3f} +- {100 * s.sigma:.3f} %",
                f"{s.sigmas:.1f}",
                f"{1e3 * float(np.sqrt(np.mean(c.work.shifts(s.lens_change) ** 2))):.4f} mm",
            ),
        )
        for s in c.suspects
    ]
    strongest = (
        f'<p class="muted">{escape(describe(c.suspects[0]))}</p>'
        if c.suspects and c.suspects[0].sigmas > 5
        else ""
    )
    return table(("cause", "amount", "standard deviations", "shift of work points"), rows) + strongest


def _next(c: CameraCalibration) -> str:
    if not c.next:
        return '<p class="muted">Not known until some views are tilted.</p>'
    width, height = c.camera.size
    lines = np.array([[0, 0, 0], [c.target.size[0], 0, 0], [*c.target.size, 0], [0, c.target.size[1], 0]])
    shapes: list[str] = []
    labels: list[Array] = []
    size = LABEL * width
    for number, view in enumerate(c.next, start=1):
        pixels = c.camera.project(
            _along(lines) @ view.T_camera_target[:3, :3].T + view.T_camera_target[:3, 3]
        )
        if not np.isfinite(pixels).all():
            continue
        path = "L".join(f"{u:.0f} {v:.0f}" for u, v in pixels)
        label = pixels.mean(axis=0)
        while any(np.abs(label - other).max() < size for other in labels):
            label = label + (size, 0.0)  # targets at the same position with other rotations
        labels.append(label)
        u, v = label
        shapes.append(
            f'<path d="M{path}Z" fill="var(--blue)" fill-opacity="0.1" stroke="var(--blue)" stroke-width="5"/>'
            f'<text x="{u:.0f}" y="{v:.0f}" style="font-size:{size:.0f}px;fill:var(--blue)">{number}</text>'
        )
    items = "".join(f"<li>{escape(v.words)}: {100 * v.gain:.0f} % less error</li>" for v in c.next)
    return (
        f'<figure><svg viewBox="-40 -40 {width + 80} {height + 80}"><rect class="frame" width="{width}" '
        f'height="{height}" stroke-width="4"/>{"".join(shapes)}</svg></figure><ol>{items}</ol>'
    )


def _along(corners: Array, steps: int = 12) -> Array:
    """Points along the closed outline, to show the distortion."""
    after = np.roll(corners, -1, axis=0)
    share = np.arange(steps)[:, None] / steps
    return np.concatenate([a + share * (b - a) for a, b in zip(corners, after, strict=True)])


def _views(c: CameraCalibration) -> str:
    worst = max((v.rms_px for v in c.used), default=1.0)

    def row(v: CalibrationView) -> tuple[str, Sequence[str]]:
        found = "0" if v.photo.view is None else str(len(v.photo.view.ids))
        blur = "" if v.photo.quality is None else f"{v.photo.quality.blur_px:.2f}"
        if not v.used:
            return "out", (v.photo.name, found, "", "", "", blur, f"left out: {v.why_not}")
        bar = "▇" * max(1, round(12 * v.rms_px / worst))
        lost = int(v.dropped.sum()) if v.dropped is not None else 0
        note = f"{bar}{f'  {lost} corners left out' if lost else ''}"
        return "", (
            v.photo.name,
            found,
            f"{v.rms_px:.3f}",
            f"{1e3 * v.distance:.0f}",
            f"{np.degrees(v.tilt):.0f}",
            blur,
            note,
        )

    return table(
        (
            "photograph",
            "corners",
            "rms px",
            "distance mm",
            "tilt deg",
            "blur px",
            "residual",
        ),
        map(row, c.views),
    )
