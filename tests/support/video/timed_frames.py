"""Frames that carry the time at which they were taken, as blocks that survive compression, and their camera's moods."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np

from vision.camera.frame_source import Image

SIZE = (128, 80)
BLOCK, BITS = 16, 32  # px a side; bits of a time in ms


class TimedCamera:
    """Takes a frame every `period` s of the host's monotonic clock, and hands them out at that rate.

    Attributes:
        size: of frames, px.
        stalled: no frame goes out; those taken meanwhile are lost.
        held: no frame goes out; those taken meanwhile are kept, and go out at once afterwards.
        ended: the camera closes its connections.
        sent: frames handed out so far.
    """

    def __init__(self, period: float = 0.02, first_after: float = 0.0) -> None:
        """
        Args:
            period: between frames, s.
            first_after: time before the first frame, s.
        """
        self.size, self.sent = SIZE, 0
        self.stalled = self.held = self.ended = False
        self.closing = threading.Event()
        self._period, self._first_after = period, first_after

    def jpegs(self) -> Iterator[tuple[float, bytes]]:
        """Yield the time at which a frame was taken, s, and the frame, until the camera ends."""
        due = time.monotonic() + self._first_after
        kept: list[tuple[float, bytes]] = []
        while not self.ended and not self.closing.wait(max(0.0, due - time.monotonic())):
            if not self.stalled:
                kept.append((taken := time.monotonic(), jpeg(taken, self.size)))
            due += self._period
            while kept and not (self.stalled or self.held or self.ended):
                self.sent += 1
                yield kept.pop(0)


def jpeg(taken: float, size: tuple[int, int] = SIZE) -> bytes:
    """A frame that shows the time in ms, four rows of eight blocks, above a strip of noise."""
    milliseconds = int(1e3 * taken)
    bits = np.array([(milliseconds >> n) & 1 for n in range(BITS)], dtype=np.uint8).reshape(4, 8)
    image = np.full((size[1], size[0], 3), 128, dtype=np.uint8)
    image[: 4 * BLOCK, : 8 * BLOCK] = np.kron(40 + 170 * bits, np.ones((BLOCK, BLOCK), np.uint8))[..., None]
    image[4 * BLOCK :] = np.random.default_rng(milliseconds).integers(0, 255, (size[1] - 4 * BLOCK, 1, 1))
    encoded, data = cv2.imencode(".jpg", image)
    assert encoded
    return data.tobytes()


def time_of(image: Image) -> float:
    """The time that a frame shows, s."""
    blocks = image[: 4 * BLOCK, : 8 * BLOCK].reshape(4, BLOCK, 8, BLOCK).mean(axis=(1, 3))
    return 1e-3 * sum(1 << n for n, level in enumerate(blocks.ravel()) if level > 128)
