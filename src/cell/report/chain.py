"""The report of a kinematic chain's calibration as one HTML page: parameters, residuals, possible causes of error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from arm.se3 import Array
from calib.chain.result import ChainCalibration
from calib.chain.self_test import SelfTest
from calib.chain.verdict import describe
from cell.report.chain_text import Numbers, describe_self_test, left_out, numbers
from cell.report.html import Table, render

_WIDE, _BAR = 420, 110  # width of a drawing, and height of its bars, px
_MOST_DOTS = 6000


def chain_page(
    title: str,
    source: str,
    c: ChainCalibration,
    found: Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]],
    test: SelfTest | None = None,
    images: Sequence[Numbers] = (),
) -> str:
    """Return the page, self-contained. The same calibration gives the same bytes.

    Args:
        title: what was calibrated.
        source: file of the recording.
        c: the calibration.
        found: tables of results: title, header and rows each.
        test: self-test; None if the calibration was refused before.
        images: see `cell.report.chain_text.left_out`.
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
            (f"{c.residual_std.mean():.3f} px", "residuals"),
            (f"{x:.3f} / {y:.3f} px", "noise of the corners"),
            (f"{c.fit.chi2_dof:.3f}", f"chi2/dof (limit {c.limits.chi2_dof:g})"),
        ),
        self_test="not run, as the calibration is refused" if test is None else describe_self_test(test),
        found=[(name, Table(header, rows)) for name, header, rows in found],
        scatter=_scatter(c),
        arrows=_arrows(c),
        bars=_bars(c),
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
        "rings": [k * scale * c.residual_std for k in (1, 2, 3)],
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
