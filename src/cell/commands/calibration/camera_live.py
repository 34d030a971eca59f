"""``a465 calibrate camera --live``: a person holds the target, the program says where and takes the views."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from arm.errors import CalibrationRefused, InputError
from arm.se3 import Array, rotation, transform
from calib.camera.guided_capture import FIRST, Advice, GuidedViews
from calib.camera.result import CalibrationLimits
from calib.camera.view_selection import TargetPhoto
from cell.console import Console
from cell.sim.target_photos import held, photograph_target
from cell.task.look import write_png
from vision.camera.frame_source import IMAGE_SUFFIXES, FrameSource, Image, read_grey
from vision.camera.model import Camera
from vision.targets.quality import measure_quality
from vision.targets.target import Target, TargetFinder

if TYPE_CHECKING:
    from cell.files.task import Task

QUIET_S = 180.0  # wall time without a new view after which nobody seems to be there
TOLD_EVERY_S = 10.0  # wall time after which it is said again why no view is taken
MOST_VIEWS = 60


class SimulatedHand:
    """A person who does as told, roughly, before a simulated camera; a frame source.

    Every second frame shows the target where the one before did; then it is moved to where the advice says.

    Args:
        camera: that sees the target.
        target: that is held.
        seed: of how roughly.
    """

    def __init__(self, camera: Camera, target: Target, seed: int = 0) -> None:
        self._camera, self._target = camera, target
        self._rng = np.random.default_rng(seed)
        self._taken = 0
        self._T: Array | None = None
        self.advice: Callable[[], Advice] = lambda: Advice(FIRST[0], None, False, None)

    def grab(self, count: int) -> list[Image]:
        """The next frames."""
        images = []
        for _ in range(count):
            if self._T is None or self._taken % 2 == 0:
                self._T = self._place(self.advice())
            self._taken += 1
            images.append(photograph_target(self._camera, self._target, self._T, self._rng))
        return images

    def _place(self, advice: Advice) -> Array:
        rng, size = self._rng, np.array(self._camera.size)
        if advice.T_camera_target is not None:
            turned = rotation(rng.normal(0.0, 0.05, 3)) @ advice.T_camera_target[:3, :3]
            return transform(turned, advice.T_camera_target[:3, 3] + rng.normal(0.0, 0.01, 3))
        turn = np.array([[0, 0], [0, 1], [0, -1], [-1, 0], [1, 0]], dtype=float)[FIRST.index(advice.words)]
        fill = 0.6 * size[0] / self._camera.K[0, 0]
        distance = self._target.size[0] / fill * rng.uniform(1.0, 1.1)
        at = size / 2.0 + rng.normal(0.0, 0.06, 2) * size
        return held(self._camera, self._target, at, distance, 0.5 * turn, rng.normal(0.0, 0.1))


@contextlib.contextmanager
def open_source(
    selector: str | None, simulated: Path | None, target: Target, console: Console
) -> Iterator[tuple[FrameSource, SimulatedHand | None]]:
    """The camera to guide for: a Basler one, or the simulated one of a task's cell.

    Raises:
        InputError: not exactly one is named.
        CameraError: the camera cannot be had.
    """
    if (selector is None) == (simulated is None):
        raise InputError("--live needs --camera SELECTOR, or --simulated TASK to try it without one")
    if simulated is not None:
        from cell.files.task import read_task

        task: Task = read_task(simulated)
        hand = SimulatedHand(task.cell.camera, target)
        yield hand, hand
        return
    from vision.camera.basler import BaslerCamera

    with BaslerCamera(str(selector), tell=console.say) as camera:
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
) -> int:
    """Guide until the views are enough; they come into the folder as they are taken. How many were taken.

    Photographs that are in the folder already count as views: an interrupted session goes on.

    Args:
        quiet_s: wall time without a new view after which it ends.

    Raises:
        InputError: the folder cannot be made or written.
        CameraError: a frame cannot be had.
        CalibrationRefused: nobody showed the target.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}", path=str(folder)) from error
    finder = TargetFinder(target)
    (first,) = source.grab(1)
    guided = GuidedViews(target, (first.shape[1], first.shape[0]), work, limits)
    if hand is not None:
        hand.advice = lambda: guided.advice
    number = _resume(folder, target, finder, guided, console)
    taken, since = 0, time.monotonic()
    said = since
    console.say(f"show the target {guided.advice.words}")
    while not guided.advice.done and len(guided.photos) < MOST_VIEWS:
        if time.monotonic() - since > quiet_s:
            if not guided.photos:
                raise CalibrationRefused(
                    f"no view of the target in {quiet_s:.0f} s; is it the one of the target file ({target.label()})?",
                    target=target.label(),
                )
            console.say(f"no new view for {quiet_s:.0f} s: going on with {len(guided.photos)}")
            break
        (image,) = source.grab(1)
        wrong = guided.consider(_photo(f"live-{number + 1:03d}.png", image, target, finder))
        if wrong:
            console.progress(f"{guided.advice.words}", min(len(guided.photos) / limits.views, 1.0), wrong)
            if time.monotonic() - max(said, since) > TOLD_EVERY_S:
                said = time.monotonic()
                console.say(f"waiting: {wrong}")
            continue
        number, taken, since = number + 1, taken + 1, time.monotonic()
        write_png(folder / f"live-{number:03d}.png", image)
        _tell(guided, limits, console)
    return taken


def _photo(name: str, image: Image, target: Target, finder: TargetFinder) -> TargetPhoto:
    view = finder.find(image)
    return TargetPhoto(name, view, None if view is None else measure_quality(image, target, view))


def _resume(folder: Path, target: Target, finder: TargetFinder, guided: GuidedViews, console: Console) -> int:
    """Take what is in the folder as views; the number of the last one."""
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
    for file in files:
        photo = _photo(file.name, read_grey(file), target, finder)
        guided.consider(photo)  # twice, as a target that is held still
        guided.consider(photo)
    if files:
        console.say(f"{len(guided.photos)} views are there from before")
    numbers = [int(p.stem[5:]) for p in files if p.stem.startswith("live-") and p.stem[5:].isdigit()]
    return max(numbers, default=0)


def _tell(guided: GuidedViews, limits: CalibrationLimits, console: Console) -> None:
    advice = guided.advice
    known = "" if advice.work_mm is None else f" ({advice.work_mm:.3f} mm, limit {limits.work_mm:g} mm)"
    console.step(f"view {len(guided.photos)} taken{known}")
    console.say("enough" if advice.done else f"show the target {advice.words}")
