"""``a465 calibrate camera``: fit a lens to a folder of images and judge it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import InputError
from arm.io.storage import keep_apart, sha256, write_atomic
from calib.camera.calibrate import calibrate_camera
from calib.camera.result import CalibrationLimits, CameraCalibration
from calib.camera.verdict import coverage, marker_share
from calib.camera.view_selection import TargetPhoto
from calib.model.intrinsics import NAMES, vector_of
from cell.console import Console
from cell.report.camera import lens_page
from vision.camera.frame_source import IMAGE_SUFFIXES, Image, read_grey
from vision.camera.model import write_camera
from vision.markers.exposure import darkness
from vision.targets.quality import measure_quality
from vision.targets.target import Target, TargetFinder, read_target

HOLDABLE = NAMES[4:]


@dataclass(frozen=True)
class LensOptions:
    """Options of the command.

    Attributes:
        target: target file; None for the default target.
        hold: lens parameters to fix at zero.
        work_mm: nearest and farthest working distance.
        limit_mm: largest accepted standard deviation at the work points.
        most_views: number of views to fit at most; the others are held out.
        output: camera file to write.
        report: HTML file to write; beside `output` if None.
    """

    target: Path | None = None
    hold: tuple[str, ...] = ()
    work_mm: tuple[float, float] | None = None
    limit_mm: float | None = None
    most_views: int | None = None
    output: Path | None = None
    report: Path | None = None

    def limits(self) -> CalibrationLimits:
        """Return the limits of the verdict.

        Raises:
            InputError: an option is out of range.
        """
        limits = CalibrationLimits()
        if self.limit_mm is not None:
            if not 0.0 < self.limit_mm < np.inf:
                raise _option("--limit-mm", self.limit_mm, "must be above 0 mm and finite")
            limits = replace(limits, work_mm=self.limit_mm)
        if self.most_views is not None:
            if self.most_views < limits.views:
                raise _option("--most-views", self.most_views, f"must be at least {limits.views}")
            limits = replace(limits, most_views=self.most_views)
        return limits

    def work(self) -> tuple[float, float] | None:
        """Return the nearest and farthest working distance, m.

        Raises:
            InputError: they are in the wrong order.
        """
        if self.work_mm is None:
            return None
        near, far = self.work_mm
        if not 0.0 < near < far:
            raise _option(
                "--work-mm", list(self.work_mm), "must be two distances in mm, the nearer one first"
            )
        return near / 1e3, far / 1e3

    def held(self) -> tuple[str, ...]:
        """Return the lens parameters to fix at zero.

        Raises:
            InputError: a name is unknown.
        """
        for name in self.hold:
            if name not in HOLDABLE:
                raise _option("--hold", name, f"must be one of {', '.join(HOLDABLE)}")
        return self.hold


def _option(name: str, value: object, rule: str) -> InputError:
    return InputError(f"{name} {value}: {rule}", option=name, value=value)


def camera_step(
    images: Path,
    options: LensOptions,
    live: bool,
    camera: str | None,
    simulated: Path | None,
    console: Console,
) -> dict[str, Any]:
    """Take images if `live`, calibrate, print and write the results. A refused lens is not written.

    Args:
        images: folder of the images; with `live` they are written there.
        options: options of the command.
        live: take images now, with `camera` (a selector) or the simulated camera of the task file `simulated`.

    Returns:
        The object for ``--json``, including the verdict.

    Raises:
        InputError: a file or an option is wrong.
        CalibrationRefused: nothing could be computed.
    """
    limits, work, hold = options.limits(), options.work(), options.held()
    output = options.output
    report = options.report or (output.with_suffix(".html") if output is not None else None)
    _check_written(output, report, options.target)
    target = read_target(options.target) if options.target is not None else Target()
    if live:
        from cell.commands.calibration.camera_live import open_source, take_views

        with open_source(camera, simulated, target, console) as (source, hand):
            take_views(images, target, source, hand, work, limits, console)
    elif camera is not None or simulated is not None:
        raise InputError("--camera and --simulated need --live; without it, the images in IMAGES are used")
    photos, size = find_target(images, target, console)
    console.step(f"fit: {sum(p.view is not None for p in photos)} views of {target.label()}")
    calibration = calibrate_camera(photos, target, size, held=hold, work=work, limits=limits)
    if report is not None:
        write_atomic(report, lens_page(calibration, images.name))
    tell(calibration, console)
    if report is not None:
        console.say(f"report: {report}")
    if output is not None and calibration.accepted:
        write_lens(output, calibration)
        console.say(f"written: {output}")
    elif output is None and calibration.accepted:
        console.say("no camera file was written; give -o FILE to write one")
    return to_json(calibration)


def _check_written(output: Path | None, report: Path | None, target: Path | None) -> None:
    """Check the output files before images are taken, which may take an hour.

    Raises:
        InputError: an output file is a folder, the target file, named like an image, or named twice.
    """
    for option, written in (("--output", output), ("--report", report)):
        if written is None:
            continue
        keep_apart(written, target)
        if written.exists() and not written.is_file():
            raise _option(option, written, "is not a regular file; give the name of a file")
        if written.suffix.lower() in IMAGE_SUFFIXES:
            raise _option(
                option, written, "has the suffix of an image; use camera.toml, and camera.html for the report"
            )
    if output is not None and report is not None and output.resolve() == report.resolve():
        raise _option("--output", output, "is also the name of the report; use camera.toml, or give --report")


def find_target(folder: Path, target: Target, console: Console) -> tuple[list[TargetPhoto], tuple[int, int]]:
    """Detect the target in every image of a folder, in the order of their names.

    Returns:
        The detections, and width and height of the images, px.

    Raises:
        InputError: there is no such folder, it has no images, one cannot be read, their sizes differ, or none shows
            the target (the message names what they show instead).
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder of images", path=str(folder))
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
    if not files:
        raise InputError(
            f"{folder}: contains no images; their names must end in {' '.join(IMAGE_SUFFIXES)}",
            path=str(folder),
        )
    finder = TargetFinder(target)
    photos: list[TargetPhoto] = []
    first: Image | None = None
    for number, file in enumerate(files):
        console.progress(f"detecting the target in {file.name}", number / len(files))
        image = read_grey(file)
        if first is None:
            first = image
        if image.shape != first.shape:
            raise InputError(
                f"{file}: is {image.shape[1]} x {image.shape[0]} px, but {files[0].name} is {first.shape[1]} x "
                f"{first.shape[0]} px; all images of a calibration must have the same size",
                path=str(file),
            )
        view = finder.find(image)
        quality = None if view is None else measure_quality(image, target, view)
        photos.append(TargetPhoto(file.name, view, quality, file.stat().st_mtime))
    if first is None or all(photo.view is None for photo in photos):
        image = read_grey(files[0])
        instead = finder.seen_instead(image)
        instead = instead or darkness(image) or ""
        raise InputError(
            f"{folder}: none of {len(files)} images shows the target ({target.label()})"
            + (f"; {files[0].name} shows {instead}" if instead else ""),
            path=str(folder),
            instead=instead,
        )
    return photos, (first.shape[1], first.shape[0])


def tell(c: CameraCalibration, console: Console) -> None:
    """Print tables of the lens and the views, and the verdict."""
    values = zip(NAMES, vector_of(c.camera), c.sigmas, c.free, strict=True)
    console.table(
        ("number", "value", "std"),
        [
            (n, f"{v:.5g}" if i > 3 else f"{v:.2f}", f"{s:.2g}" if f else "held")
            for i, (n, v, s, f) in enumerate(values)
        ],
    )
    console.say()
    console.table(
        ("view", "corners", "rms px", "distance mm", "tilt deg", "blur px", ""),
        [
            (
                v.photo.name,
                0 if v.photo.view is None else len(v.photo.view.ids),
                f"{v.rms_px:.3f}" if v.used else "-",
                f"{1e3 * v.distance:.0f}" if v.used else "-",
                f"{np.degrees(v.tilt):.0f}" if v.used else "-",
                f"{v.photo.quality.blur_px:.1f}" if v.photo.quality is not None else "-",
                f"left out: {v.why_not}" if v.why_not else "",
            )
            for v in c.views
        ],
    )
    console.say()
    worst, mean = 1e3 * float(c.work_sigmas.max()), 1e3 * float(np.sqrt(np.mean(c.work_sigmas**2)))
    console.say(
        f"target:      {c.target.label()}; its size scales all distances and cannot be verified from images"
    )
    console.say(f"corners:     {c.corner_sigma:.3f} px (held-out views {c.cross.sigma_px:.3f} px)")
    console.say(
        f"work points: {mean:.3f} mm, at worst {worst:.3f} mm (one standard deviation, {1e3 * c.work.near:.0f} to "
        f"{1e3 * c.work.far:.0f} mm away)"
    )
    console.say(
        f"coverage:    {100 * coverage(c):.0f} % of the image, {len(c.used)} of {len(c.views)} views used"
    )
    for remark in c.remarks:
        console.say(f"note: {remark}")
    if c.next and not c.accepted:
        console.say("views that would help most:")
        for view in c.next:
            console.say(f"  {view.words}")
    console.say("accepted" if c.accepted else "refused:")
    for reason in c.reasons:
        console.say(f"  {reason}")


def to_json(c: CameraCalibration) -> dict[str, Any]:
    """Return the object for ``--json``."""
    return {
        "K_px": c.camera.K.tolist(),
        "distortion_k1k2p1p2k3": c.camera.distortion.tolist(),
        "size_px": list(c.camera.size),
        "parameters": {
            name: {"value": float(v), "std": float(s) if f else None}
            for name, v, s, f in zip(NAMES, vector_of(c.camera), c.sigmas, c.free, strict=True)
        },
        "covariance": c.covariance.tolist(),
        "corner_sigma_px": c.corner_sigma,
        "held_out_px": c.cross.sigma_px,
        "work": {
            "near_mm": 1e3 * c.work.near,
            "far_mm": 1e3 * c.work.far,
            "std_mm": 1e3 * float(np.sqrt(np.mean(c.work_sigmas**2))),
            "worst_std_mm": 1e3 * float(c.work_sigmas.max()),
            "jackknife_mm": 1e3 * float(np.sqrt(np.mean(c.cross.work_sigmas**2))),
        },
        "coverage": coverage(c),
        "marker_share": marker_share(c),
        "views": [
            {
                "photograph": v.photo.name,
                "used": v.used,
                "why_not": v.why_not,
                "corners": 0 if v.photo.view is None else len(v.photo.view.ids),
                "dropped": []
                if v.dropped is None or v.photo.view is None
                else v.photo.view.ids[v.dropped].tolist(),
                "rms_px": v.rms_px if v.used else None,
                "T_camera_target": None if v.T_camera_target is None else v.T_camera_target.tolist(),
            }
            for v in c.views
        ],
        "suspects": [
            {"name": s.name, "amount": s.amount, "std": s.sigma, "unit": s.unit, "sigmas": s.sigmas}
            for s in c.suspects
        ],
        "undetermined": {name: None if v is None else v.words for name, v in c.undetermined.items()},
        "next_views": [{"words": v.words, "T_camera_target": v.T_camera_target.tolist()} for v in c.next],
        "verdict": "accepted" if c.accepted else "refused",
        "reasons": list(c.reasons),
        "remarks": list(c.remarks),
    }


def write_lens(path: Path, c: CameraCalibration) -> None:
    """Write a camera file without a camera pose.

    Raises:
        InputError: the file cannot be written.
    """
    calibration = {
        "id": "lens-" + sha256({"lens": vector_of(c.camera).tolist(), "size": list(c.camera.size)})[:12],
        "target": c.target.label(),
        "views": len(c.used),
        "corner_sigma_px": round(c.corner_sigma, 5),
        "held_out_px": round(c.cross.sigma_px, 5),
        "work_mm": [round(1e3 * c.work.near, 1), round(1e3 * c.work.far, 1)],
        "work_std_mm": round(1e3 * float(c.work_sigmas.max()), 5),
    }
    views = [
        {
            "photograph": v.photo.name,
            "rms_px": round(v.rms_px, 5),
            "T_camera_target": v.T_camera_target.tolist(),
        }
        for v in c.used
        if v.T_camera_target is not None
    ]
    camera = replace(c.camera, calibration=calibration, lens_covariance=c.covariance)
    write_camera(path, camera, placed=False, views=views)
