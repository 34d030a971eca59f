"""A device that stands for OpenCV's VideoCapture: it takes frames by its own clock, queues them, and can misbehave."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

import cv2
import numpy as np
import pytest

from vision.camera.frame_source import Image

SIZE = (32, 24)
DEVICE, STREAM = "video:/dev/null", "video:rtsp://me:secret@camera/1"  # the first is there, and may be opened


class FakeDevice:
    """Takes a frame of the present scene every `PERIOD_S`; a scene is a grey level, with noise.

    Attributes:
        scene: what frames show from now on; set by `show`.
        grabs: frames read so far.
        opened: arguments of `open`.
        properties: as set, by code.
        frozen, dead: frames equal each other to the bit; none comes any more.
        damaged: number of frames that are yet to be damaged.
        hangs: names of calls that do not return until `free` is set.
        slow, opening: what a frame takes to be read, and the device to be opened, s.
    """

    PERIOD_S, QUEUE = 0.005, 4

    def __init__(self, stamps: str = "host", size: tuple[int, int] = SIZE) -> None:
        """
        Args:
            stamps: "host", "own" (another clock), "counted" (1 ms each), or "" for none.
            size: of frames, px.
        """
        self.scene, self.size, self.grabs = 1, size, 0
        self.opened: tuple[Any, ...] = ()
        self.properties: dict[int, float] = {}
        self.fixed: set[int] = set()
        self.frozen = self.dead = False
        self.damaged, self.slow, self.opening = 0, 0.0, 0.0
        self.hangs: set[str] = set()
        self.free = threading.Event()
        self.released = False
        self._stamps, self._begun = stamps, time.monotonic()
        self._due, self._held = self._begun, 0.0
        self._frames: deque[tuple[float, int, int]] = deque()
        self._count = 0
        self._lock = threading.Lock()
        self._frame = (self._begun, 1, 0)

    def show(self, scene: int) -> None:
        with self._lock:
            self._take()
            self.scene = scene

    def hold(self, seconds: float) -> None:
        """Deliver nothing for a time, and then all that was taken meanwhile, as a network may."""
        self._held = time.monotonic() + seconds

    def wait_grabs(self, more: int) -> None:
        wanted, until = self.grabs + more, time.monotonic() + 20.0
        while self.grabs < wanted:
            assert time.monotonic() < until, "nobody reads"
            time.sleep(0.002)

    def _take(self) -> None:
        held = time.monotonic() < self._held
        while self._due <= time.monotonic():
            self._count += 1
            if (
                len(self._frames) < self.QUEUE or held
            ):  # a driver's queue drops what does not fit; a network's grows
                self._frames.append((self._due, self.scene, self._count))
            self._due += self.PERIOD_S

    def _hang(self, call: str) -> None:
        if call in self.hangs:
            self.free.wait(20.0)

    # -- as of cv2.VideoCapture

    def open(self, *arguments: Any) -> bool:
        self.opened = arguments
        time.sleep(self.opening)
        self._hang("open")
        return not self.dead

    def grab(self) -> bool:
        self._hang("grab")
        time.sleep(self.slow)
        while not self.dead:
            with self._lock:
                self._take()
                if self._frames and time.monotonic() >= self._held:
                    self._frame = self._frames.popleft()
                    self.grabs += 1
                    return True
            time.sleep(0.001)
        return False

    def retrieve(self) -> tuple[bool, Image | None]:
        _, scene, number = self._frame
        if self.damaged:
            self.damaged -= 1
            return False, None
        rng = np.random.default_rng(0 if self.frozen else number)
        shape = (self.size[1], self.size[0], 3)
        return True, (40 * scene + rng.integers(0, 20, shape)).astype(np.uint8)

    def get(self, code: int) -> float:
        if code == cv2.CAP_PROP_POS_MSEC:
            taken, _, number = self._frame
            stamp = {"host": taken, "own": taken - self._begun + 1.0, "counted": 1e-3 * number, "": 0.0}
            return 1e3 * stamp[self._stamps]
        return self.properties.get(code, -1.0)

    def set(self, code: int, value: float) -> bool:
        if code not in self.fixed:
            self.properties[code] = value
        return True

    def release(self) -> None:
        self._hang("release")
        self.released = True


def scene_of(image: Image) -> int:
    """The scene that a frame of a fake device shows."""
    return int(image.mean() // 40)


def plugged(monkeypatch: pytest.MonkeyPatch, device: FakeDevice) -> FakeDevice:
    """Make OpenCV open this device, whatever is asked for."""
    monkeypatch.setattr(cv2, "VideoCapture", lambda: device)
    return device
