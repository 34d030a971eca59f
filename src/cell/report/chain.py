"""The report of a kinematic chain's calibration as one HTML page: parameters, residuals, possible causes of error."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from arm.se3 import Array
from calib.chain.result import ChainCalibration
from calib.chain.self_test import SelfTest
from calib.chain.verdict import describe
from cell.report.chain_text import Numbers, describe_self_test, left_out, numbers
from cell.report.html import bullets, page, section, table

_WIDE, _MOST_DOTS = 420, 6000
_BAR = 110


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
        test: on synthetic twins; None if the calibration was refused before.
        images: as for `cell.report.chain_text.left_out`.
    """
    badge = '<span class="badge">accepted</span>' if c.accepted else '<span class="badge no">refused</span>'
    used = c.images - sum(map(len, c.wrong))
    excluded = f"; left out: {numbers(left_out(c, images))} (images count from 0)" if used < c.images else ""
    parts = [
        f"<h1>{escape(title)} {badge}</h1>",
        f'<p class="muted">{escape(source)}: {used} of {c.images} images{escape(excluded)}</p>',
        section(
            "",
            bullets(c.reasons, "Why it is refused")
            + _figures(c)
            + _self_test(test)
            + bullets(c.remarks, "Worth knowing"),
        ),
        # a row per joint and a column per parameter: too wide for half a page
        *(section(escape(name), table(header, [("", row) for row in rows])) for name, header, rows in found),
        '<div class="two">',
        section("Residuals of all corners", _scatter(c)),
        section("Residuals over the image", _arrows(c)),
        section("Residuals by image", _bars(c)),
        section("Model", _model(c)),
        section("Possible causes of error", _suspects(c)),
        section("Correlated parameters", _correlations(c)),
        "</div>",
    ]
    return page(f"{title}: {source}", parts)


def _figures(c: ChainCalibration) -> str:
    x, y = c.problem.pixel_sigma
    shown = (
        (f"{1e3 * c.held_out.metres:.3f} mm", f"held-out images (limit {1e3 * c.limits.held_out:g} mm)"),
        (f"{c.held_out.px:.3f} px", "of held-out corners"),
        (f"{c.residual_std.mean():.3f} px", "residuals"),
        (f"{x:.3f} / {y:.3f} px", "noise of the corners"),
        (f"{c.fit.chi2_dof:.3f}", f"chi2/dof (limit {c.limits.chi2_dof:g})"),
    )
    return f'<div class="figures">{"".join(f"<div><b>{a}</b>{escape(b)}</div>" for a, b in shown)}</div>'


def _self_test(test: SelfTest | None) -> str:
    result = "not run, as the calibration is refused" if test is None else describe_self_test(test)
    return f"<p><b>Self-test:</b> {escape(result)}</p>"


def _residuals(c: ChainCalibration) -> tuple[Array, Array]:
    """Measured pixels and residuals (n, 2) px of the used images."""
    pixels, residuals = [], []
    for s, r, w in zip(c.problem.sightings, c.fit.residuals, c.fit.weights, strict=True):
        seen = np.isfinite(r[..., 0]) & (w > 0.0)[:, None]
        pixels.append(s.pixels[seen])
        residuals.append(r[seen])
    return np.concatenate(pixels), np.concatenate(residuals)


def _some(count: int) -> Array:
    return (
        np.unique(np.linspace(0, count - 1, min(count, _MOST_DOTS)).astype(int))
        if count
        else np.zeros(0, int)
    )


def _scatter(c: ChainCalibration) -> str:
    _, residuals = _residuals(c)
    reach = 1.1 * float(np.quantile(np.abs(residuals), 0.999)) if len(residuals) else 1.0
    scale = _WIDE / 2.0 / max(reach, 1e-9)
    dots = "".join(
        f'<circle cx="{scale * u:.1f}" cy="{scale * v:.1f}" r="1.6"/>'
        for u, v in residuals[_some(len(residuals))]
        if max(abs(u), abs(v)) <= reach
    )
    x, y = c.residual_std
    rings = "".join(
        f'<ellipse class="frame" rx="{k * scale * x:.1f}" ry="{k * scale * y:.1f}" stroke-width="1.5"/>'
        for k in (1, 2, 3)
    )
    half = _WIDE / 2
    return (
        f'<figure><svg viewBox="{-half - 4:.0f} {-half - 4:.0f} {_WIDE + 8} {_WIDE + 8}"><g fill="var(--blue)" '
        f'opacity="0.35">{dots}</g>{rings}<rect class="frame" x="{-half:.0f}" y="{-half:.0f}" width="{_WIDE}" '
        f'height="{_WIDE}" stroke-width="1.5"/></svg><figcaption>One dot per corner; the frame is {2 * reach:.2f} px '
        "wide, ellipses at one, two and three standard deviations.</figcaption></figure>"
    )


def _arrows(c: ChainCalibration) -> str:
    pixels, residuals = _residuals(c)
    width, height = c.problem.camera.size
    typical = float(np.median(np.linalg.norm(residuals, axis=1))) if len(residuals) else 1.0
    scale = 0.02 * width / max(typical, 1e-9)
    some = _some(min(len(pixels), _MOST_DOTS // 3))
    lines = "".join(
        f'<path d="M{u:.1f} {v:.1f}l{scale * du:.1f} {scale * dv:.1f}"/>'
        for (u, v), (du, dv) in zip(pixels[some], residuals[some], strict=True)
        if np.hypot(du, dv) < 5.0 * typical
    )
    return (
        f'<figure><svg viewBox="-4 -4 {width + 8} {height + 8}"><rect class="frame" width="{width}" '
        f'height="{height}" stroke-width="4"/><g stroke="var(--blue)" stroke-width="{width / 900:.2f}" opacity="0.7">'
        f"{lines}</g></svg><figcaption>Residuals, enlarged {scale:.0f} times. If neighbouring arrows agree, the "
        "residuals are not just noise.</figcaption></figure>"
    )


def _bars(c: ChainCalibration) -> str:
    """RMS of every image divided by the noise of its corners, in the order of the recording."""
    shapes, x, most = [], 0, 3.0
    heights: list[tuple[float, bool]] = []
    for s, r, w in zip(c.problem.sightings, c.fit.residuals, c.fit.weights, strict=True):
        size = np.sqrt(np.nanmean((r / s.sigma(c.problem.pixel_sigma)) ** 2, axis=(1, 2)))
        heights += [(float(v), bool(used > 0.0)) for v, used in zip(size, w, strict=True)]
    step = max(_WIDE // max(len(heights), 1), 2)
    for value, used in heights:
        h = _BAR * min(value, most) / most
        colour = "var(--blue)" if used else "var(--bad)"
        shapes.append(
            f'<rect x="{x}" y="{_BAR - h:.1f}" width="{max(step - 1, 1)}" height="{h:.1f}" fill="{colour}"/>'
        )
        x += step
    line = _BAR * (1.0 - 1.0 / most)
    return (
        f'<figure><svg viewBox="0 0 {max(x, 1)} {_BAR}"><path class="frame" d="M0 {line:.1f}H{x}" stroke-width="1"/>'
        f"{''.join(shapes)}</svg><figcaption>RMS residual of each image divided by the noise of its corners. Line: 1. "
        "Red: left out as wrong.</figcaption></figure>"
    )


def _model(c: ChainCalibration) -> str:
    if not c.trials:
        return '<p class="muted">The model has no optional part.</p>'
    rows = [
        (
            "" if t.needed else "out",
            (t.part, "in" if t.needed else "left out", f"{t.rise:.1f}", f"{t.limit:.1f}"),
        )
        for t in c.trials
    ]
    return table(("part", "", "increase of cost without it", "by chance, up to"), rows)


def _suspects(c: ChainCalibration) -> str:
    rows = [
        (
            "" if s.sure else "out",
            (s.name, f"{s.drop:.1f}", f"{s.limit:.1f}", describe(s) if s.sure else "chance"),
        )
        for s in c.suspects[:8]
    ]
    return table(("cause", "cost it explains", "by chance, up to", ""), rows)


def _correlations(c: ChainCalibration) -> str:
    weak = ", ".join(f"{name} ({share:+.2f})" for name, share in c.weakest)
    weakest = f'<p class="muted">Weakest direction: {escape(weak)}</p>' if weak else ""
    if not c.correlations:
        return weakest + '<p class="muted">No two parameters are correlated by more than 0.9.</p>'
    return weakest + table(
        ("", "", "correlation"), [("", (a, b, f"{r:+.3f}")) for a, b, r in c.correlations[:12]]
    )
