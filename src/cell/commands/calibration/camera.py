"""``a465 calibrate camera``: fit a lens to a folder of images and judge it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.io.kind import read_any
from arm.io.outputs import keep_apart
from arm.io.storage import sha256
from calib.camera.calibrate import calibrate_camera
from calib.camera.flat_views import Lift
from calib.camera.result import CalibrationLimits, CameraCalibration
from calib.camera.view_selection import TargetPhoto
from calib.model.intrinsics import NAMES, vector_of
from cell.commands.calibration.options import ResultOptions, checked_limit, option_error
from cell.console import Console
from cell.report.camera import lens_page
from cell.report.lens_text import lens_json, print_lens
from vision.camera.frame_source import IMAGE_SUFFIXES, Image, read_grey, require_folder
from vision.camera.model import Region, write_camera
from vision.markers.exposure import darkness
from vision.targets.target import Target, TargetFinder, read_target

HOLDABLE = NAMES[4:]
NEAREST_MM = 20.0  # working distance: no lens of a cell looks at less, and a distance in m is less
NARROWEST_PX = 16.0  # part of an image: nothing of an arm is as small, and fractions of the image are smaller
_LIFT = re.compile(r"(.+)=([^=]+?)(?:\+-([^=]+))?")
_MM = re.compile(r"\d{1,9}(?:\.\d+)?")
_ELSEWHERE = 2.0  # times nearer or farther than all views that a working distance is doubted


@dataclass(frozen=True)
class LensOptions(ResultOptions):
    """Options of the command; `limit_mm` is for the standard deviation at the work points.

    Attributes:
        target: target file; None for the default target.
        hold: lens parameters to fix at zero.
        work_mm: nearest and farthest working distance.
        most_views: largest number of views to fit; the others are held out.
        lift: IMAGE=HEIGHT_MM or IMAGE=HEIGHT_MM+-STD_MM, of images in which the target lies on a box.
        work_region: part of the image that matters: left, top, right, bottom, px.
    """

    target: Path | None = None
    hold: Sequence[str] = ()
    work_mm: tuple[float, float] | None = None
    most_views: int | None = None
    lift: Sequence[str] = ()
    work_region: Region | None = None

    def limits(self) -> CalibrationLimits:
        """Return the limits of the verdict.

        Raises:
            InputError: an option is out of range.
        """
        limits = CalibrationLimits()
        if self.limit_mm is not None:
            limits = replace(limits, work_mm=checked_limit(self.limit_mm))
        if self.most_views is not None:
            if self.most_views < limits.views:
                raise option_error("--most-views", self.most_views, f"must be at least {limits.views}")
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
            raise option_error(
                "--work-mm", list(self.work_mm), "must be two distances in mm, the nearer one first"
            )
        if near < NEAREST_MM:
            rule = f"must be {NEAREST_MM:g} mm or more: the unit is mm; are these metres?"
            raise option_error("--work-mm", list(self.work_mm), rule)
        return near / 1e3, far / 1e3

    def region(self, size: tuple[int, int]) -> Region | None:
        """Return the part of the image that matters, px.

        Args:
            size: of the images, px.

        Raises:
            InputError: it is empty or inverted, or not in the image.
        """
        if self.work_region is None:
            return None
        left, top, right, bottom = self.work_region
        for first, at, second, until in (("left", left, "right", right), ("top", top, "bottom", bottom)):
            if not at < until:
                rule = f"must be left, top, right and bottom: {first} {at:g} must be less than {second} {until:g}"
                raise option_error("--work-region", list(self.work_region), rule)
        if not (0.0 <= left < right <= size[0] and 0.0 <= top < bottom <= size[1]):
            rule = f"must be left, top, right and bottom of a part of the image of {size[0]} x {size[1]} px"
            raise option_error("--work-region", list(self.work_region), rule)
        if min(right - left, bottom - top) < NARROWEST_PX:
            rule = f"must be {NARROWEST_PX:g} px or more wide and high: the unit is px; are these fractions?"
            raise option_error("--work-region", list(self.work_region), rule)
        return self.work_region

    def lifts(self, names: Sequence[str]) -> dict[str, Lift]:
        """Return the heights at which the target lies in images.

        Args:
            names: of the images.

        Raises:
            InputError: the form or a number is wrong, or there is no such image.
        """
        found = {}
        for text in self.lift:
            match = _LIFT.fullmatch(text)
            if match is None:
                raise option_error("--lift", text, "must be IMAGE=HEIGHT_MM or IMAGE=HEIGHT_MM+-STD_MM")
            name, height, within = match.groups()
            for what, number in (("height", height), ("standard deviation", within)):
                if number is not None and not _MM.fullmatch(number):
                    rule = f"its {what} {number} must be from 0 to 999999999 mm in digits, such as 50 or 30.5"
                    raise option_error("--lift", text, rule)
            if name not in names:
                raise option_error("--lift", text, f"must name an image of the folder, such as {names[0]}")
            found[name] = Lift(float(height) / 1e3, *([float(within) / 1e3] if within else []))
        return found

    def held(self) -> tuple[str, ...]:
        """Return the lens parameters to fix at zero.

        Raises:
            InputError: a name is unknown.
        """
        for name in self.hold:
            if name not in HOLDABLE:
                again = " ".join(f"--hold {one.strip()}" for one in name.split(","))
                repeat = f"; repeat the option: {again}" if "," in name else ""
                raise option_error("--hold", name, f"must be one of {', '.join(HOLDABLE)}{repeat}")
        return tuple(self.hold)


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
    output, options = options.output, options.checked((options.target,))
    _require_replaceable(output)
    target = read_target(options.target) if options.target is not None else Target()
    if live:
        from cell.commands.calibration.camera_live import open_source, take_views

        with open_source(camera, simulated, target, console) as (source, hand):
            take_views(images, target, source, hand, work, limits, console, region=options.region)
    elif camera is not None or simulated is not None:
        raise InputError("--camera and --simulated need --live; without it, the images in IMAGES are used")
    lifts = options.lifts([path.name for path in _images(images)])
    photos, size = find_target(images, target, console)
    if doubt := target.doubt():
        console.say(f"NOTE: {doubt}")
    console.step(f"fit: {sum(p.view is not None for p in photos)} views of {target.label()}")
    region = options.region(size)
    calibration = calibrate_camera(
        photos, target, size, held=hold, work=work, limits=limits, lifts=lifts, region=region
    )
    if elsewhere := _elsewhere(calibration, work):
        console.say(f"NOTE: {elsewhere}")
    print_lens(calibration, console)
    options.write_report(lambda: lens_page(calibration, images.name), console)
    if output is not None and calibration.accepted:
        write_lens(output, calibration)
        console.say(f"written: {output}")
    elif output is None and calibration.accepted:
        console.say("no camera file was written; give -o FILE to write one")
    return lens_json(calibration)


def _elsewhere(c: CameraCalibration, work: tuple[float, float] | None) -> str:
    """Say that the working distances are far from those of the views; "" if they are not."""
    distances = [v.distance for v in c.views if v.used]
    if work is None or not distances:
        return ""
    if work[1] * _ELSEWHERE > min(distances) and work[0] < _ELSEWHERE * max(distances):
        return ""
    near, far = (f"{1e3 * v:g}" for v in work)
    return (
        f"--work-mm {near} {far}: the target was {1e3 * min(distances):.0f} to {1e3 * max(distances):.0f} mm away in "
        "all views: is it in mm? The lens is judged at distances that no view shows"
    )


def _require_replaceable(output: Path | None) -> None:
    """Refuse an output that is a file of another kind, or the file of a placed camera, whose pose would be lost."""
    keep_apart(output, kind="camera")
    there = read_any(output) if output is not None and output.is_file() else None
    if isinstance(there, dict) and "pose" in there:
        rule = "has a [pose], which a calibration of the lens does not find, so that it would be lost"
        help = "give another file, and copy [pose] to its end"
        raise option_error("-o", str(output), f"{rule}; {help}")


def _images(folder: Path) -> list[Path]:
    """Return the files of images in a folder, at least one, in the order of their names."""
    require_folder(folder)
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
    if not files:
        why = f"{folder}: contains no images; their names must end in {' '.join(IMAGE_SUFFIXES)}"
        raise InputError(why, path=str(folder))
    return files


def find_target(folder: Path, target: Target, console: Console) -> tuple[list[TargetPhoto], tuple[int, int]]:
    """Detect the target in every image of a folder, in the order of their names.

    Returns:
        The detections, and width and height of the images, px.

    Raises:
        InputError: there is no such folder, it has no images, one cannot be read, their sizes differ, none shows the
            target (the message names what they show instead), or it is a part of what they show.
    """
    files = _images(folder)
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
        photos.append(TargetPhoto.of(file.name, image, finder, file.stat().st_mtime))
    if first is None or all(photo.view is None for photo in photos):
        image = read_grey(files[0])
        instead = finder.seen_instead(image) or darkness(image) or ""
        raise InputError(
            f"{folder}: none of {len(files)} images shows the target ({target.label()})"
            + (f"; {files[0].name} shows {instead}" if instead else ""),
            path=str(folder),
            instead=instead,
        )
    fullest = max(photos, key=lambda photo: 0 if photo.view is None else len(photo.view.marker_ids))
    if part := finder.read_in_part(read_grey(folder / fullest.name)):
        shown = f"its images show more than the target ({target.label()}); {fullest.name} shows {part}"
        raise InputError(f"{folder}: {shown}", path=str(folder), instead=part)
    return photos, (first.shape[1], first.shape[0])


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
    camera = replace(c.camera, calibration=calibration, lens_covariance=c.covariance, region=c.work.region)
    write_camera(path, camera, placed=False, views=views)
