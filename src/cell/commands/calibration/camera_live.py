"""``a465 calibrate camera --live``: guide a person who holds the target, and take the images."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from arm.credentials import without_url
from arm.errors import CalibrationRefused, CameraError, InputError
from arm.io.storage import unmade
from arm.se3 import Array, rotation, transform
from calib.camera.guided_capture import FIRST, Advice, GuidedViews
from calib.camera.result import CalibrationLimits
from calib.camera.view_selection import TargetPhoto
from cell.console import Console
from cell.sim.target_photos import TargetCamera, target_pose
from cell.task.look import write_png
from vision.camera.frame_source import IMAGE_SUFFIXES, FrameSource, Image, read_grey
from vision.camera.model import Region
from vision.targets.target import Target, TargetFinder

if TYPE_CHECKING:
    from cell.files.task import Task

QUIET_S = 180.0  # wall time without a new view after which the session ends
REPEAT_S = 10.0  # wall time between two messages why no view is taken
MOST_VIEWS = 60


class SimulatedHand:
    """Frame source that simulates a person who follows the advice roughly.

    The target stays in place for two frames, then moves to the advised pose.

    Args:
        camera: camera that sees the target.
        target: target that is held.
        rng: of the deviations from the advice.
    """

    def __init__(self, camera: TargetCamera, target: Target, rng: np.random.Generator) -> None:
        self._seen_by, self._camera, self._target = camera, camera.camera, target
        self._rng = rng
        self._taken = 0
        self._T: Array | None = None
        self.advice: Callable[[], Advice] = lambda: Advice(FIRST[0], None, False, None)

    def grab(self, count: int) -> list[Image]:
        """Return the next frames."""
        images = []
        for _ in range(count):
            if self._T is None or self._taken % 2 == 0:
                self._T = self._place(self.advice())
            self._taken += 1
            images.append(self._seen_by.photograph(self._target, self._T))
        return images

    def _place(self, advice: Advice) -> Array:
        rng, size = self._rng, np.array(self._camera.size)
        if advice.T_camera_target is not None:
            R = rotation(rng.normal(0.0, 0.05, 3)) @ advice.T_camera_target[:3, :3]
            return transform(R, advice.T_camera_target[:3, 3] + rng.normal(0.0, 0.01, 3))
        turn = np.array([[0, 0], [0, 1], [0, -1], [-1, 0], [1, 0]], dtype=float)[FIRST.index(advice.words)]
        fill = 0.6 * size[0] / self._camera.K[0, 0]
        distance = self._target.size[0] / fill * rng.uniform(1.0, 1.1)
        at = size / 2.0 + rng.normal(0.0, 0.06, 2) * size
        return target_pose(self._camera, self._target, at, distance, 0.5 * turn, rng.normal(0.0, 0.1))


@contextlib.contextmanager
def open_source(
    selector: str | None, simulated: Path | None, target: Target, console: Console
) -> Iterator[tuple[FrameSource, SimulatedHand | None]]:
    """Open the camera, or the simulated camera of a task's cell.

    Raises:
        InputError: not exactly one of them is given, or the file is wrong.
        CameraError: the camera cannot be opened.
    """
    from cell.session.cameras import VARIABLE, camera_by, device_of

    if simulated is None:
        selector = selector or device_of(None)
    if selector is not None and simulated is not None:
        raise InputError(
            f"--camera {without_url(selector)} and --simulated {simulated}: give only one source of images"
        )
    if selector is None and simulated is None:
        why = (
            f"--live needs --camera SELECTOR (or {VARIABLE}), or --simulated TASK to try it without a camera"
        )
        raise InputError(why)
    if simulated is not None:
        from cell.files.task import read_task
        from cell.session.connection import target_camera

        task: Task = read_task(simulated)
        rng = np.random.default_rng(0)
        hand = SimulatedHand(target_camera(task, None, rng), target, rng)
        yield hand, hand
        return
    with camera_by(str(selector), tell=console.say) as camera:
        yield camera, None


def take_views(
    folder: Path,
    target: Target,
    source: FrameSource,
    hand: SimulatedHand | None,
    work: tuple[float, float] | None,
    limits: CalibrationLimits,
    console: Console,
    quiet_s: float = QUIET_S,
    clock: Callable[[], float] = time.monotonic,
    region: Callable[[tuple[int, int]], Region | None] = lambda size: None,
) -> int:
    """Guide until the views suffice, and write each view to the folder; return the number of new views.

    Images already in the folder count as views, so that an interrupted session continues.

    Args:
        folder: folder of the views.
        target: target that is shown.
        source: camera.
        hand: simulated person who follows the advice; None: a real one.
        work: nearest and farthest working distance, m; None: those of the views.
        limits: limits of the verdict.
        console: output.
        quiet_s: wall time without a new view after which the session ends, s.
        clock: time source, s.
        region: gives the part of the image that matters, px, for the images' size.

    Raises:
        InputError: the folder cannot be created or written, the region is not in the image, or the target is a part of
            the print.
        CameraError: the camera delivers no frame.
        CalibrationRefused: the target was never seen.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be created: {unmade(folder, error)}", path=str(folder)) from error
    finder = TargetFinder(target)
    (first,) = source.grab(1)
    size = (first.shape[1], first.shape[0])
    guided = GuidedViews(target, size, work, limits, region(size))
    if hand is not None:
        hand.advice = lambda: guided.advice
    number = _resume(folder, finder, guided, console, size)
    taken, since = 0, clock()
    said, last = since, first
    console.say(f"show the target {guided.advice.words}")
    while not guided.advice.done and len(guided.photos) < MOST_VIEWS:
        if clock() - since > quiet_s:
            if not guided.photos:
                instead = finder.seen_instead(last)
                raise CalibrationRefused(
                    f"no view of the target in {quiet_s:.0f} s; is it the one of the target file ({target.label()})?"
                    + (f" the last image shows {instead}" if instead else ""),
                    target=target.label(),
                )
            console.say(f"no new view for {quiet_s:.0f} s: continuing with {len(guided.photos)}")
            break
        if (image := _next(source, len(guided.photos), console)) is None:
            break
        last = image
        wrong = guided.consider(TargetPhoto.of(f"live-{number + 1:03d}.png", image, finder))
        if wrong:
            console.progress(f"{guided.advice.words}", min(len(guided.photos) / limits.views, 1.0), wrong)
            if clock() - max(said, since) > REPEAT_S:
                said = clock()
                console.say(f"waiting: {wrong}")
            continue
        if not taken and (part := finder.read_in_part(image)):
            raise InputError(f"the image shows more than the target ({target.label()}): {part}", instead=part)
        number, taken, since = number + 1, taken + 1, clock()
        write_png(folder / f"live-{number:03d}.png", image)
        advice = guided.advice
        known = "" if advice.work_mm is None else f" ({advice.work_mm:.3f} mm, limit {limits.work_mm:g} mm)"
        console.step(f"view {len(guided.photos)} taken{known}")
        console.say("the views suffice" if advice.done else f"show the target {advice.words}")
    return taken


def _next(source: FrameSource, views: int, console: Console) -> Image | None:
    """Return the next image; None at the end of a recording that gave views."""
    try:
        (image,) = source.grab(1)
    except CameraError as error:
        if error.data.get("reason") != "ended" or not views:
            raise
        console.say(f"the recording is at its end: continuing with {views}")
        return None
    return image


def _resume(
    folder: Path, finder: TargetFinder, guided: GuidedViews, console: Console, size: tuple[int, int]
) -> int:
    """Add the images in the folder as views; return the number of the last one.

    Raises:
        InputError: one has another size than the camera's images: the session would be in vain.
    """
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
    for file in files:
        image = read_grey(file)
        if (there := (image.shape[1], image.shape[0])) != size:
            rule = f"is {there[0]} x {there[1]} px, and the camera's images are {size[0]} x {size[1]} px"
            raise InputError(f"{file}: {rule}; give a new folder, or remove it", path=str(file))
        photo = TargetPhoto.of(file.name, image, finder)
        guided.consider(photo)  # twice: a view counts only if the target is held still
        guided.consider(photo)
    if files:
        console.say(f"{len(guided.photos)} views found in the folder")
    numbers = [int(p.stem[5:]) for p in files if p.stem.startswith("live-") and p.stem[5:].isdigit()]
    return max(numbers, default=0)
