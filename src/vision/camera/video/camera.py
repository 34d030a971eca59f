"""A camera that OpenCV opens: a device of this machine, a network stream, or a video file (docs/cameras.md)."""

from __future__ import annotations

import os
import stat
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np

from arm.errors import CameraError
from vision.camera.deadline_worker import T, Worker
from vision.camera.frame_source import Image
from vision.camera.video.network import why_no_stream
from vision.camera.video.reader import Frame, FrameReader, keep_coded, retrieve
from vision.camera.video.selector import COUNTED, read_video
from vision.camera.video.settings import VideoSettings, set_device

FAILED_FRAMES = 2  # frames per look that could not be decoded and are taken again
OPEN_S = 20.0  # wall time for a step of opening
CLOSE_S = 5.0
MOST_REPEATS = 25  # frames of a recording that equal the one before: more are a frozen one
NO_NOISE = "shows nothing but black or white, or its compression drops what differs"
MARGIN_S = 2.0  # wall time for a call of the driver beyond the time-out
VIDEO_MAJOR = 81  # of every V4L2 device (Linux, Documentation/admin-guide/devices.txt)


class VideoCamera:
    """Takes images with OpenCV (`vision.camera.frame_source.FrameSource`); a context manager.

    Devices and streams are read all the time (`FrameReader`), and only frames taken after the call of `grab` plus
    `VideoSettings.latency` are used. A file's frames are used once each, in their order: it is a recording, and does
    not show the present cell. Of frames that repeat to the bit only the first is used.

    Attributes:
        selector: of the source.
        settings: requested.
        device: OpenCV's VideoCapture while open.
        description: the source, the size of its frames and its settings in one line.
        doubts: what the source does not tell, a sentence each.
        stand_in: what it is if it cannot show the present cell: a recording; "" of other sources.
    """

    def __init__(
        self,
        selector: str,
        settings: VideoSettings | None = None,
        size: tuple[int, int] | None = None,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        """
        Args:
            selector: of the source; see `vision.camera.video.selector.read_video`.
            settings: of the source; those of the driver are for devices.
            size: required width and height of frames, px; None for any, the same within a look.
            tell: called with one line per problem that does not stop the work.

        Raises:
            InputError: the selector is invalid.
        """
        self.selector = read_video(selector)
        self.settings = settings or VideoSettings()
        self.device: Any = None
        self.description = ""
        self.doubts: tuple[str, ...] = ()
        self.stand_in = "a recording" if self.selector.kind == "file" else ""
        self._size = size or self.selector.size or self.settings.size
        self._tell = tell
        self._worker: Worker | None = None
        self._reader: FrameReader | None = None
        self._last: Image | None = None
        self._opened, self._coded = 0.0, False
        self._given = 0  # frames of a recording

    # -- opening and closing

    def __enter__(self) -> Self:
        """Open the source, make its settings and take a first frame.

        Raises:
            CameraError: the source is missing or in use, refuses a setting, or gives no frame of the required size.
        """
        self._require_there()
        self._worker, self._last, self._given = Worker(f"camera {self.selector}"), None, 0
        try:
            self._ask(self._open, OPEN_S, "opening it")
            if self.selector.kind != "file":
                self._last = self._ask(self._first, OPEN_S, "its first frame")
                self._require_size(self._last)
                self._describe(self._last)
                self._read_on(self._last)
            else:
                self.description = f"{self.selector}: a recording, which need not show the present cell"
                self.doubts = ("it is a recording: it need not show the present cell",)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the source in any state, within `CLOSE_S`; report problems by `tell`."""
        if self._reader is not None:
            self._reader.stop()
        if self._worker is not None and self.device is not None:
            try:
                self._ask(self.device.release, CLOSE_S, "closing it")
            except CameraError as error:
                self._tell(str(error))
        if self._worker is not None:
            self._worker.end()
        self.device = self._worker = self._reader = None

    def _require_there(self) -> None:
        chosen = self.selector
        if chosen.kind == "file" and not chosen.path.is_file():
            raise self._error("missing", f"{chosen.path}: {_no_camera(chosen.path) or 'no such video file'}")
        if chosen.kind != "device" or not sys.platform.startswith("linux"):
            return
        found = sorted(str(path) for path in Path("/dev").glob("video*"))
        if not chosen.path.exists():
            there = (
                f"; connected: {', '.join(found)}"
                if found
                else ", nor is any other; is its cable plugged in?"
            )
            raise self._error("missing", f"{chosen.path}: not found{there}", found=found)
        if not os.access(chosen.path, os.R_OK | os.W_OK):
            rule = f"{chosen.path}: you may not open it; join its group: sudo usermod -aG video USER, and log in again"
            raise self._error("permission", rule)

    def _open(self) -> None:
        import cv2

        chosen, timeout_ms = self.selector, max(1, round(1e3 * self.settings.timeout))
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # the error says it in one line
        if "OPENCV_LOG_LEVEL" not in os.environ:
            cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
        self._opened = time.monotonic()
        device = cv2.VideoCapture()
        if chosen.kind == "device":
            backend = cv2.CAP_V4L2 if sys.platform.startswith("linux") else cv2.CAP_ANY
            opened = device.open(int(chosen.source) if chosen.source.isdigit() else chosen.source, backend)
        else:
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, round(1e3 * OPEN_S / 2.0)]
            limits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, timeout_ms]
            limits += [cv2.CAP_PROP_N_THREADS, 1]  # each further thread of a decoder delays it by a frame
            opened = device.open(chosen.source, cv2.CAP_FFMPEG, limits)
        if not opened:
            if chosen.kind == "device":
                if rule := _no_camera(chosen.path):
                    raise self._error("missing", rule)
                rule = "cannot be opened: another program has it open, or it takes no images"
                raise self._error("in use", rule)
            waited_s = time.monotonic() - self._opened
            rule = (
                "cannot be read as a video"
                if chosen.kind == "file"
                else why_no_stream(chosen.source, waited_s, OPEN_S / 2.0)
            )
            raise self._error("missing", rule)
        self.device = device
        device.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # pixels as of the sensor, as for images from files
        if chosen.kind == "stream" and device.get(cv2.CAP_PROP_FRAME_COUNT) > 0.0:
            raise self._error("stale", "is a recording that is sent over the network, not a camera")
        if chosen.kind == "device":
            self.doubts = set_device(device, self.settings, self._size, self._refused)
            for doubt in self.doubts:
                self._tell(f"camera {chosen}: {doubt}")
        elif chosen.kind == "stream":
            if (key := self.settings.first_of_device()) is not None:
                raise self._refused(
                    key, None, "a stream has no such setting here; set it in the camera itself"
                )
            self._coded = keep_coded(device)

    def _first(self) -> Image:
        for _ in range(1 + FAILED_FRAMES):
            if not self.device.grab():
                break
            if (image := retrieve(self.device, self._coded)) is not None:
                return image
        rule = "opened, but gives no frame; is it a camera, and can its cable or network carry the size?"
        raise self._error("removed", rule)

    def _describe(self, first: Image) -> None:
        import cv2

        height, width = first.shape
        fps = self._ask(lambda: float(self.device.get(cv2.CAP_PROP_FPS)), MARGIN_S, "its rate")
        rate = f" at {fps:.3g} frames/s" if 0.0 < fps < 1000.0 else ""
        made = self.settings.words() if self.selector.kind == "device" else ""
        self.description = f"camera {self.selector}: {width} x {height} px{rate}{made}"

    def _read_on(self, first: Image) -> None:
        if self._worker is None:
            raise self._error("closed", "is not open")
        use = self.settings.stamps
        use_stamps = self.selector.scheme not in COUNTED if use is None else use
        reader = FrameReader(
            self.device, use_stamps, self.selector.kind == "device", first, self._opened, self._coded
        )
        self._reader = reader
        self._worker.begin(reader.run)
        begun, number = time.monotonic(), 0
        queued: list[Frame] = []
        until = begun + max(begun - self._opened, self.settings.timeout) + MARGIN_S
        while (frame := reader.next(number, until)) is not None and frame.taken < begun:
            number, queued = frame.number, [frame]
        if frame is None:
            raise self._late(reader, queued)
        if not reader.stamped:
            latency = self.settings.latency_of(self.selector)
            self.doubts += (
                f"it gives no time stamps of use: only latency_s = {latency:g} guards against old frames",
            )
        if self.selector.kind == "stream":
            self.doubts += ("its compression can shift edges, and hides damaged parts of frames",)
        self.doubts += (
            "whether its shutter rolls is unknown: only a camera and scene at rest are measured well",
        )

    # -- images

    def grab(self, count: int) -> list[Image]:
        """Take `count` images, (h, w) grey: taken after this call, or the next ones of a recording.

        Up to `FAILED_FRAMES` damaged frames are reported and left out. A frame that equals the one before it to the bit
        is left out too: noise makes images of a sensor differ, so that it was sent twice.

        Raises:
            CameraError: frames are late, stale, damaged or of another size, or the source is gone, at its end or hangs.
        """
        if self.device is None:
            raise self._error("closed", "is not open")
        if self._reader is None:
            return [self._next_of_file(n + 1) for n in range(count)]
        reader, number = self._reader, self._reader.last_number()
        after = time.monotonic() + self.settings.latency_of(self.selector)
        until = after + self.settings.timeout
        images: list[Image] = []
        unfit: list[Frame] = []  # since the last image
        damaged = 0
        reader.want(True)
        try:
            while len(images) < count:
                frame = reader.next(number, until)
                if frame is None:
                    raise self._late(reader, unfit)
                number = frame.number
                fits = frame.taken >= after and not frame.repeats
                if frame.damaged:
                    damaged += 1
                    self._count_damaged(damaged, len(images) + 1, count)
                elif frame.image is not None and fits:
                    self._require_size(frame.image)
                    images.append(frame.image)
                    unfit, until = [], time.monotonic() + self.settings.timeout
                elif frame.image is not None and frame.received >= after:
                    unfit.append(frame)
                if time.monotonic() > until:
                    raise self._late(reader, unfit)
        finally:
            reader.want(False)
        return images

    def _next_of_file(self, number: int) -> Image:
        """The next frame of a recording that differs from the one before it."""
        for repeats in range(MOST_REPEATS + 1):
            image = self._ask(self._decoded, self.settings.timeout + MARGIN_S, f"image {number}")
            if image is None:
                again = f", and its last {repeats} repeat the one before to the bit" if repeats else ""
                rule = f"the recording has no more frames{again}; {self._given} were used"
                raise self._error("ended", rule, repeats=repeats, used=self._given)
            if self._last is None or not np.array_equal(image, self._last):
                self._require_size(image)
                self._last, self._given = image, self._given + 1
                return image
        rule = f"the recording repeats the same image more than {MOST_REPEATS} times, to the bit: it is frozen, or "
        raise self._error("stale", rule + NO_NOISE, repeats=MOST_REPEATS + 1)

    def _decoded(self) -> Image | None:
        """The next frame of a recording that can be decoded; None at its end."""
        while self.device.grab():
            if (image := retrieve(self.device, self._coded)) is not None:
                return image
        return None

    def _late(self, reader: FrameReader, unfit: list[Frame]) -> CameraError:
        """The error for a frame that did not come in time, after frames that could not be used."""
        wait_s = self.settings.timeout
        if unfit and all(frame.repeats for frame in unfit):
            rule = f"sent the same image {len(unfit)} times in {wait_s:g} s, to the bit: it is frozen, or {NO_NOISE}"
            return self._error("stale", rule, frames=len(unfit))
        if unfit:
            late = max(frame.received - frame.taken for frame in unfit)
            rule = (
                f"its frames may be up to {late:.2f} s old: it paused, and what was held back then comes first; is its "
                "network good? a larger timeout_s under [look.video] waits longer"
            )
            if reader.stamped:
                rule = (
                    f"its frames arrive up to {late:.2f} s late by their time stamps, so that none was surely taken "
                    "after the request; if its stamps are not those of a clock, write stamps = false under [look.video]"
                )
            return self._error("stale", rule, late_s=late)
        # the driver's call is waiting for a frame: does it return at all?
        again = reader.next(reader.last_number(), time.monotonic() + MARGIN_S)
        if reader.fault is not None:
            return self._error(*reader.fault)
        if again is None:
            rule = f"no answer within {wait_s + MARGIN_S:g} s; unplug the camera and plug it in again"
            return self._error("hung", rule)
        return self._error("timeout", f"no frame within {wait_s:g} s; is the cable or network good?")

    def _count_damaged(self, damaged: int, number: int, count: int) -> None:
        if damaged > FAILED_FRAMES:
            rule = f"{damaged} frames of one look could not be decoded; check cable and bandwidth"
            raise self._error("failed", rule, frames=damaged)
        self._tell(f"camera {self.selector}: image {number} of {count} was damaged and is taken again")

    def _require_size(self, image: Image) -> None:
        height, width = image.shape
        wanted = self._size or ((width, height) if self._last is None else self._last.shape[1::-1])
        if self._last is None:
            self._last = image
        if (width, height) != wanted:
            rule = (
                f"sent a frame of {width} x {height} px, but {wanted[0]} x {wanted[1]} px are needed; set the size of "
                "the calibration (size_px under [look.video], or on the camera's own page), or calibrate for this one"
            )
            raise self._error("size", rule, size_px=[width, height])

    # -- errors

    def _ask(self, function: Callable[[], T], seconds: float, what: str) -> T:
        """Call `function` on the worker, within `seconds`; errors of OpenCV become `CameraError`."""
        import cv2

        if self._worker is None:
            raise self._error("closed", "is not open")
        try:
            return self._worker.call(function, seconds)
        except TimeoutError as error:
            raise self._error("hung", f"{what}: {error}; unplug the camera and plug it in again") from error
        except (cv2.error, ValueError) as error:
            raise self._error("driver", f"{what}: {error}") from error

    def _refused(self, key: str, value: Any, rule: str) -> CameraError:
        shown = key if value is None else f"{key} = {value!r}"
        return self._error("setting", f"{shown}: {rule}", key=key, value=value)

    def _error(self, reason: str, rule: str, **data: Any) -> CameraError:
        return CameraError(self.selector, reason, rule, **data)


def _no_camera(path: Path) -> str:
    """Say what a path that exists is, if it is no video file or camera; else ""."""
    if not path.exists():
        return ""
    found = path.stat()
    is_other = sys.platform.startswith("linux") and os.major(found.st_rdev) != VIDEO_MAJOR
    kinds = (
        (stat.S_ISDIR, "a directory"),
        (stat.S_ISFIFO, "a pipe"),
        (stat.S_ISSOCK, "a socket"),
        (stat.S_ISBLK, "a block device"),
        (lambda mode: stat.S_ISCHR(mode) and is_other, "a character device that is no camera"),
    )
    kind = next((words for is_one, words in kinds if is_one(found.st_mode)), "")
    return f"is no video file or camera: {kind}" if kind else ""
