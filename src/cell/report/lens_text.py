"""Output of a lens calibration: rows of text for the terminal and the page, JSON for programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm.se3 import Array
from calib.camera.result import CalibrationView, CameraCalibration
from calib.camera.verdict import coverage, marker_share, where
from calib.model.intrinsics import NAMES, vector_of
from cell.console import Console
from cell.report.verdict_text import print_verdict, verdict_json

VIEW_COLUMNS = ("view", "corners", "rms px", "distance mm", "tilt deg", "blur px")


def rms_mm(sigmas_m: Array) -> float:
    """Return the root mean square of standard deviations (n,) m, in mm."""
    return 1e3 * float(np.sqrt(np.mean(sigmas_m**2)))


def intrinsics_rows(c: CameraCalibration) -> list[tuple[str, str, str]]:
    """Return name, value and standard deviation of every intrinsic parameter."""
    values = zip(NAMES, vector_of(c.camera), c.sigmas, c.free, strict=True)
    return [
        (name, f"{v:.2f} px" if name in NAMES[:4] else f"{v:.5g}", f"{s:.2g}" if free else "held")
        for name, v, s, free in values
    ]


def view_row(v: CalibrationView) -> tuple[str, ...]:
    """Return the cells of `VIEW_COLUMNS`."""
    fitted = (f"{v.rms_px:.3f}", f"{1e3 * v.distance:.0f}", f"{np.degrees(v.tilt):.0f}")
    return (
        v.photo.name,
        str(_corners(v)),
        *(fitted if v.used else ("-", "-", "-")),
        "-" if v.photo.quality is None else f"{v.photo.quality.blur_px:.2f}",
    )


def left_out(v: CalibrationView) -> str:
    """Return why a view is not used; "" if it is."""
    return f"left out: {v.why_not}" if v.why_not else ""


def _corners(v: CalibrationView) -> int:
    return 0 if v.photo.view is None else len(v.photo.view.ids)


def print_lens(c: CameraCalibration, console: Console) -> None:
    """Print tables of the intrinsics and the views, and the verdict."""
    console.table(("number", "value", "std"), intrinsics_rows(c))
    console.say()
    console.table((*VIEW_COLUMNS, ""), [(*view_row(v), left_out(v)) for v in c.views])
    console.say()
    label, worst = c.target.label(), 1e3 * float(c.work_sigmas.max())
    console.say(f"target:      {label}; its size scales all distances and cannot be verified from images")
    console.say(f"corners:     {c.corner_sigma:.3f} px (held-out views {c.cross.sigma_px:.3f} px)")
    console.say(
        f"work points: {rms_mm(c.work_sigmas):.3f} mm, at worst {worst:.3f} mm (one standard deviation, "
        f"{1e3 * c.work.near:.0f} to {1e3 * c.work.far:.0f} mm away, in {where(c)})"
    )
    console.say(
        f"coverage:    {100 * coverage(c):.0f} % of {where(c)}, {len(c.used)} of {len(c.views)} views used"
    )
    advice = ["views that would help most:", *(f"  {view.words}" for view in c.next)]
    print_verdict(c, console, advice if c.next and not c.accepted else ())


def lens_json(c: CameraCalibration) -> dict[str, Any]:
    """Return the object for ``--json``."""
    values = zip(NAMES, vector_of(c.camera), c.sigmas, c.free, strict=True)
    return {
        "K_px": c.camera.K.tolist(),
        "distortion_k1k2p1p2k3": c.camera.distortion.tolist(),
        "size_px": list(c.camera.size),
        "parameters": {n: {"value": float(v), "std": float(s) if free else None} for n, v, s, free in values},
        "covariance": c.covariance.tolist(),
        "corner_sigma_px": c.corner_sigma,
        "held_out_px": c.cross.sigma_px,
        "work": {
            "near_mm": 1e3 * c.work.near,
            "far_mm": 1e3 * c.work.far,
            "region_px": None if c.work.region is None else list(c.work.region),
            "std_mm": rms_mm(c.work_sigmas),
            "worst_std_mm": 1e3 * float(c.work_sigmas.max()),
            "jackknife_mm": rms_mm(c.cross.work_sigmas),
        },
        "coverage": coverage(c),
        "marker_share": marker_share(c),
        "views": [_view_json(v) for v in c.views],
        "suspects": [
            {"name": s.name, "amount": s.amount, "std": s.sigma, "unit": s.unit, "sigmas": s.sigmas}
            for s in c.hypotheses
        ],
        "undetermined": {name: None if v is None else v.words for name, v in c.undetermined.items()},
        "next_views": [{"words": v.words, "T_camera_target": v.T_camera_target.tolist()} for v in c.next],
        **verdict_json(c),
    }


def _view_json(v: CalibrationView) -> dict[str, Any]:
    seen, dropped = v.photo.view, v.dropped
    return {
        "photograph": v.photo.name,
        "used": v.used,
        "why_not": v.why_not,
        "corners": _corners(v),
        "dropped": [] if seen is None or dropped is None else seen.ids[dropped].tolist(),
        "rms_px": v.rms_px if v.used else None,
        "T_camera_target": None if v.T_camera_target is None else v.T_camera_target.tolist(),
    }
