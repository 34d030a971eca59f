"""Check by frame number and time stamp that a frame is the next one of its camera."""

from __future__ import annotations

from dataclasses import dataclass

NO_NUMBER = 2**64 - 1
LAST_SHORT = 2**16 - 1  # GigE cameras with 16-bit numbers continue at 1


@dataclass(frozen=True)
class FrameOrder:
    """Number and time stamp of a frame.

    Attributes:
        number: the camera's block id; None before the first.
        stamp: time of the camera's own clock, in its own unit; 0 if it has none (like pylon's emulation).
    """

    number: int | None = None
    stamp: int = 0

    def is_next(self, frame: FrameOrder, first: bool) -> bool:
        """Whether `frame` follows this one, and no frame was lost or repeated in between.

        Args:
            frame: the newer one.
            first: whether grabbing was restarted after this one, so that numbers may restart at 0 or 1.
        """
        if frame.number in (None, NO_NUMBER) or (frame.stamp and self.stamp and frame.stamp <= self.stamp):
            return False
        expected = {0, 1} if first else set()
        if self.number is not None:
            expected |= {self.number + 1, *((1,) if self.number == LAST_SHORT else ())}
        return frame.number in expected or (first and self.number is None)

    def __str__(self) -> str:
        return f"number {self.number}, time stamp {self.stamp}"
