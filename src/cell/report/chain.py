"""The report of a kinematic chain's calibration as one HTML page: parameters, residuals, possible causes of error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from arm.se3 import Array, apply
from calib.chain.result import ChainCalibration
from calib.chain.self_test import SelfTest
from calib.chain.verdict import describe
from cell.report.chain_text import Numbers, describe_self_test, left_out, numbers
from cell.report.html import Table, render

_ROW, _LABEL, _FIGURE = (
    22,
    96,
    128,
)  # of the drawing of changes: height of a row, widths of names and figures, px
_WIDE, _BAR = 420, 110  # width of a drawing, and height of its bars, px
_MOST_DOTS = 6000
_FEW = 30  # outlines that stay apart where they are drawn at full strength


class Changed(NamedTuple):
    """A quantity before and after a calibration, both in the unit that its name ends with.

    Attributes:
        name: such as "J2, deg".
        was, now: before and after.
        sigma: standard deviation of `now`.
    """

    name: str
    was: float
    now: float
    sigma: float


def chain_page(
    title: str,
    source: str,
    c: ChainCalibration,
    found: Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]],
    test: SelfTest | None = None,
    images: Sequence[Numbers] = (),
    changed: Sequence[Changed] = (),
    against: str = "",
) -> str:
    """Return the page, self-contained. The same calibration gives the same bytes.

    Args:
        title: what was calibrated.
        source: file of the recording.
        c: the calibration.
        found: tables of results: title, header and rows each.
        test: self-test; None if the calibration was refused before.
        images: see `cell.report.chain_text.left_out`.
        changed: quantities before and after; none if there is nothing to compare with.
        against: what they are compared with.
    """
    x, y = c.problem.pixel_sigma
    return render(
        "report/templates/chain.html.j2",
        title=f"{title}: {source}",
        heading=title,
        source=source,
        c=c,
        used=c.images - sum(map(len, c.wrong)),
        left_out=numbers(left_out(c, images)),
        figures=(
            (f"{1e3 * c.held_out.metres:.3f} mm", f"held-out images (limit {1e3 * c.limits.held_out:g} mm)"),
            (f"{c.held_out.px:.3f} px", "of held-out corners"),
            (f"{c.residual_std.mean():.3f} px", "residuals if joint readings are taken as exact"),
            (f"{x:.3f} / {y:.3f} px", "noise of the corners"),
            (f"{c.fit.chi2_dof:.3f}", f"chi2/dof (limit {c.limits.chi2_dof:g})"),
        ),
        self_test="not run, as the calibration is refused" if test is None else describe_self_test(test),
        found=[(name, Table(header, rows)) for name, header, rows in found],
        scatter=_scatter(c),
        arrows=_arrows(c),
        bars=_bars(c),
        places=_places(c),
        changes=_changes(changed),
        against=against,
        model=_model(c),
        suspects=_suspects(c),
        correlations=Table(("", "", "correlation"), [(a, b, f"{r:+.3f}") for a, b, r in c.correlations[:12]]),
    )


def _residuals(c: ChainCalibration) -> tuple[Array, Array]:
    """Return measured corners and residuals (n, 2), px, of the used images."""
    pixels, residuals = [], []
    for s, r, w in zip(c.problem.sightings, c.fit.residuals, c.fit.weights, strict=True):
        seen = np.isfinite(r[..., 0]) & (w > 0.0)[:, None]
        pixels.append(s.pixels[seen])
        residuals.append(r[seen])
    return np.concatenate(pixels), np.concatenate(residuals)


def _some(count: int) -> Array:
    """Return at most `_MOST_DOTS` indices below `count`, evenly spread."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, _MOST_DOTS)).astype(int))


def _scatter(c: ChainCalibration) -> dict[str, Any]:
    """Return residuals as dots in a square frame, with ellipses at one, two and three standard deviations."""
    _, residuals = _residuals(c)
    reach = 1.1 * float(np.quantile(np.abs(residuals), 0.999)) if len(residuals) else 1.0
    half = _WIDE // 2
    scale = half / max(reach, 1e-9)
    shown = residuals[_some(len(residuals))]
    return {
        "half": half,
        "frame_px": 2 * reach,
        "dots": scale * shown[np.abs(shown).max(axis=1) <= reach],
        "rings": [k * scale * residuals.std(axis=0) for k in (1, 2, 3)] if len(residuals) else [],
    }


def _arrows(c: ChainCalibration) -> dict[str, Any]:
    """Return enlarged residuals at their corners in the image, px."""
    pixels, residuals = _residuals(c)
    width, height = c.problem.camera.size
    sizes = np.linalg.norm(residuals, axis=1)
    typical = float(np.median(sizes)) if len(sizes) else 1.0
    scale = 0.02 * width / max(typical, 1e-9)
    some = _some(min(len(pixels), _MOST_DOTS // 3))
    some = some[sizes[some] < 5.0 * typical]
    lines = np.hstack([pixels[some], scale * residuals[some]])
    return {"width": width, "height": height, "scale": scale, "lines": lines}


def _changes(changed: Sequence[Changed]) -> dict[str, Any]:
    """Return a row for each quantity: where it was and is, and two standard deviations to both sides, px from zero."""
    reach: dict[str, float] = {}  # by unit: all rows of one have the same scale
    for name, *values, sigma in changed:
        unit = name.rpartition(" ")[2]
        reach[unit] = max(reach.get(unit, 0.0), *(abs(v) + 2.0 * sigma for v in values))
    half = 0.5 * (_WIDE - _LABEL - _FIGURE)
    rows = []
    for k, one in enumerate(changed):
        scale = 0.95 * half / max(reach[one.name.rpartition(" ")[2]], 1e-12)
        now, spread = scale * one.now, 2.0 * scale * one.sigma
        was, new = (f"{round(v, 3) + 0.0:+.3f}".replace("-", "\N{MINUS SIGN}") for v in (one.was, one.now))
        figures = f"{was} to {new}"
        rows.append((one.name, (k + 0.5) * _ROW, scale * one.was, now, now - spread, now + spread, figures))
    return {"rows": rows, "zero": _LABEL + half, "width": _WIDE, "height": _ROW * max(len(rows), 1)}


def _places(c: ChainCalibration) -> list[dict[str, Any]]:
    """Return where the targets were, in the camera's frame, as it sees them and from the side: drawings in mm."""
    outlines, used = [], []
    for s, errors, w in zip(c.problem.sightings, c.fit.errors, c.fit.weights, strict=True):
        (x0, y0, z), (x1, y1, _) = s.points.min(axis=0), s.points.max(axis=0)
        corners = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        T = s.evaluate(c.fit.unknowns, errors).T
        outlines += [1e3 * apply(one, corners) for one in T]
        used += [bool(v > 0.0) for v in w]
    points = np.array(outlines)
    views = [("as the camera sees them", (0, 1)), ("from the side, the camera above", (0, 2))]
    drawn = []
    for name, axes in views:
        flat = points[..., axes]
        low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
        margin = 0.04 * float((high - low).max())
        drawn.append(
            {
                "name": name,
                "low": low - margin,
                "size": high - low + 2.0 * margin,
                "stroke": float((high - low).max()) / 300.0,
                "faint": max(min(1.0, _FEW / len(outlines)), 0.3),  # of hundreds, none could be made out
                "outlines": list(zip(flat.round(1).tolist(), used, strict=True)),
                "range": (float(low[1]), float(high[1])),
            }
        )
    return drawn


def _bars(c: ChainCalibration) -> dict[str, Any]:
    """Return the RMS of every image divided by the noise of its corners, in the order of the recording."""
    heights: list[tuple[float, bool]] = []
    for s, r, w in zip(c.problem.sightings, c.fit.residuals, c.fit.weights, strict=True):
        size = np.sqrt(np.nanmean((r / s.sigma(c.problem.pixel_sigma)) ** 2, axis=(1, 2)))
        heights += [(float(v), bool(used > 0.0)) for v, used in zip(size, w, strict=True)]
    most, step = 3.0, max(_WIDE // max(len(heights), 1), 2)
    return {
        "width": max(step * len(heights), 1),
        "height": _BAR,
        "line": _BAR * (1.0 - 1.0 / most),
        "bar": step - 1,
        "bars": [(k * step, _BAR * min(v, most) / most, used) for k, (v, used) in enumerate(heights)],
    }


def _model(c: ChainCalibration) -> Table:
    return Table(
        ("part", "", "increase of cost without it", "by chance, up to"),
        [(t.part, "in" if t.needed else "left out", f"{t.rise:.1f}", f"{t.limit:.1f}") for t in c.trials],
        [i for i, t in enumerate(c.trials) if not t.needed],
    )


def _suspects(c: ChainCalibration) -> Table:
    shown = c.hypotheses[:8]
    return Table(
        ("cause", "cost it explains", "by chance, up to", ""),
        [(s.name, f"{s.drop:.1f}", f"{s.limit:.1f}", describe(s) if s.sure else "chance") for s in shown],
        [i for i, s in enumerate(shown) if not s.sure],
    )
