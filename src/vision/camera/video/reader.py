"""Read a live video source continuously, so that no queued frame is ever used, and date every frame.

Drivers queue frames: V4L2 keeps four buffers, a network stream keeps what the sender and the sockets hold. A frame that
is read from a queue shows the past. So a thread reads all the time; a frame is as old as the transport, and no older.
A transport that paused may have held frames back, which then come in a burst: `Lateness` tells by the time stamps,
`Pauses` without them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from vision.camera.frame_source import Image, as_grey

DRIFT = 2e-4  # by which the clocks of device and host may differ, s/s: ten times a common quartz
HOST_S = 10.0  # a stamp that is at most this much before the arrival is of the host's own clock


@dataclass(frozen=True)
class Frame:
    """A frame that was read.

    Attributes:
        number: of frames read so far, with this one.
        image: (h, w) grey; None if nobody wanted it when it was read, or it is damaged.
        damaged: whether it was wanted, and could not be decoded.
        received: when the driver delivered it, s of the reader's clock.
        taken: `received` less its lateness by the time stamps, if there are any, s of the same clock.
        repeats: whether it equals the image before it to the bit.
    """

    number: int
    image: Image | None
    damaged: bool
    received: float
    taken: float
    repeats: bool


@dataclass
class Lateness:
    """How much later than the promptest frame a frame arrived, by the device's time stamps.

    Attributes:
        host: whether stamps are of the host's monotonic clock, as V4L2's are; lateness is then absolute.
        stamp: the last one, s; None before the first.
    """

    host: bool = False
    stamp: float | None = None
    _least: float = 0.0
    _at: float = 0.0

    def of(self, received: float, stamp: float, may_be_host: bool) -> float | None:
        """Return the lateness of a frame, s; None if its stamp does not follow the last one.

        Args:
            received: when it arrived, s.
            stamp: of the device, s.
            may_be_host: whether the source stamps by the host's clock, if by any.
        """
        offset = received - stamp
        if self.stamp is None:
            self.host = may_be_host and 0.0 <= offset <= HOST_S
            self._least = offset
        elif stamp <= self.stamp:
            return None
        self._least = min(self._least + DRIFT * (received - self._at), offset)
        self.stamp, self._at = stamp, received
        return max(offset, 0.0) if self.host else offset - self._least


@dataclass
class Pauses:
    """How late a frame without time stamp may be: by the sum of the pauses that ended less than their own length ago.

    What was held back for a pause has come after a further pause of that length, if the line carries at least twice
    what the camera sends. Steady frames are late by at most one period or two: each may be from right after the last.

    Attributes:
        last: arrival of the last frame, s; at first, when opening began, as frames may wait since then; None: unknown.
    """

    last: float | None
    _open: list[tuple[float, float]] = field(default_factory=list)

    def of(self, received: float) -> float:
        """Return by how much a frame that arrived at `received`, s, may be late, s."""
        pause = 0.0 if self.last is None else received - self.last
        self.last = received
        self._open = [(end, s) for end, s in self._open if end > received] + [(received + pause, pause)]
        return sum(s for _, s in self._open)


class FrameReader:
    """Reads a source until told to stop; keeps the last frame. `run` is for a thread of its own.

    Attributes:
        stamped: whether the source gives time stamps.
        fault: reason and words of why reading ended; None while it goes on.
    """

    def __init__(
        self,
        device: Any,
        use_stamps: bool,
        local: bool,
        first: Image | None = None,
        opened: float | None = None,
        coded: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            device: OpenCV's VideoCapture, open.
            use_stamps: whether its time stamps are those of a clock.
            local: whether it is a device of this machine, which stamps by the host's clock.
            first: image taken before; the first one read must differ from it.
            opened: when opening began, s of `clock`, as frames may wait since then; None: none wait.
            coded: whether the device hands out JPEG images as they were sent.
            clock: s.
        """
        self.fault: tuple[str, str] | None = None
        self._device, self._use_stamps, self._local, self._clock = device, use_stamps, local, clock
        self._coded, self._opened = coded, opened
        self._settled: float | None = None  # when those that waited since opening have come, s
        self._changed = threading.Condition()
        self._wanted = self._stopped = False
        self._frame: Frame | None = None
        self._number = 0
        self._image = first
        self._lateness, self._pauses = Lateness(), Pauses(opened)

    @property
    def stamped(self) -> bool:
        """Whether the source has given time stamps of a clock so far."""
        return self._lateness.stamp is not None

    def run(self) -> None:
        """Read until `stop`, or until the source fails."""
        import cv2

        try:
            while not self._stopped and self.fault is None:
                self._read(cv2.CAP_PROP_POS_MSEC)
        except Exception as error:  # noqa: BLE001 - the caller of `next` raises it
            self._end("driver", f"{type(error).__name__}: {error}")

    def stop(self) -> None:
        """Make `run` return after its present call."""
        self._stopped = True

    def want(self, wanted: bool) -> None:
        """Whether frames are to be decoded from now on."""
        self._wanted = wanted

    def last_number(self) -> int:
        """Number of frames read so far."""
        with self._changed:
            return self._number

    def next(self, after: int, until: float) -> Frame | None:
        """Wait for a frame with a number above `after`; None if there is none by `until`, s, or reading ended."""
        with self._changed:
            while self.fault is None and (self._frame is None or self._frame.number <= after):
                left = until - self._clock()
                if left <= 0.0:
                    return None
                self._changed.wait(left)
            return None if self.fault is not None else self._frame

    def _read(self, position: int) -> None:
        asked = self._clock()
        if not self._device.grab():
            words = (
                "sends no more frames: it was unplugged, its stream ended, or its network is lost; nothing came for "
                f"{self._clock() - asked:.1f} s, and a stream has timeout_s; start again when it sends"
            )
            self._end("removed", words)
            return
        received = self._clock()
        taken = self._taken(received, 1e-3 * float(self._device.get(position)) if self._use_stamps else 0.0)
        if taken is None:
            return
        image, repeats, wanted = None, False, self._wanted
        if wanted:
            image = retrieve(self._device, self._coded)
            if image is not None:
                repeats = self._image is not None and np.array_equal(image, self._image)
                self._image = image
        damaged = wanted and image is None
        self._keep(Frame(self.last_number() + 1, image, damaged, received, taken, repeats))

    def _keep(self, frame: Frame) -> None:
        with self._changed:
            self._number, self._frame = frame.number, frame
            self._changed.notify_all()

    def _taken(self, received: float, stamp: float) -> float | None:
        if self._settled is None:
            self._settled = received + (0.0 if self._opened is None else received - self._opened)
        paused = self._pauses.of(received)
        if stamp <= 0.0 and not self.stamped:
            return received - paused
        late = self._lateness.of(received, stamp, self._local)
        if late is None:
            self._end(
                "stale",
                f"a frame's time stamp ({stamp:.3f} s) is not after the one before ({self._lateness.stamp:.3f} s); "
                "if its stamps are not those of a clock, write stamps = false under [look.video]",
            )
            return None
        opening = received < self._settled and not self._lateness.host  # the promptest frame is not yet known
        return received - (max(late, paused) if opening else late)

    def _end(self, reason: str, words: str) -> None:
        with self._changed:
            self.fault = (reason, words)
            self._changed.notify_all()


def keep_coded(device: Any) -> bool:
    """Make a stream of JPEG images hand them out as they were sent, before its first frame; return whether it does.

    OpenCV would decode each frame, wanted or not, and scale frames of another size to the first one's.
    """
    import cv2

    is_jpeg = device.get(cv2.CAP_PROP_FOURCC) == cv2.VideoWriter.fourcc(*"MJPG")
    return is_jpeg and bool(device.set(cv2.CAP_PROP_FORMAT, -1.0))


def retrieve(device: Any, coded: bool = False) -> Image | None:
    """The frame that a device has read, as grey (h, w); None if it cannot be decoded.

    Args:
        device: OpenCV's VideoCapture.
        coded: whether it hands out JPEG images as they were sent.

    Raises:
        ValueError: it is neither 8-bit grey nor 8-bit BGR.
    """
    import cv2

    decoded, raw = device.retrieve()
    if not decoded or raw is None:
        return None
    if not coded:
        return grey(raw)
    image = cv2.imdecode(raw.ravel(), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    return None if image is None else np.asarray(image, dtype=np.uint8)


def grey(raw: npt.NDArray[Any]) -> Image:
    """A driver's image as grey (h, w), with OpenCV's weights of colours, as for images from files.

    Raises:
        ValueError: it is neither 8-bit grey nor 8-bit BGR.
    """
    if raw.dtype != np.uint8 or not (raw.ndim == 2 or (raw.ndim == 3 and raw.shape[2] in (1, 3))):
        raise ValueError(f"frames are {raw.dtype} of shape {raw.shape}, but must be 8-bit grey or BGR")
    if raw.ndim == 3 and raw.shape[2] == 3:
        return as_grey(raw)
    return np.array(raw.reshape(raw.shape[:2]))
