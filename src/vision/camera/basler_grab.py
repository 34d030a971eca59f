"""Grab frames from an open Basler camera: triggers, and checks that frames are current and undamaged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.errors import CameraError
from vision.camera.frame_source import Image, as_grey

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


@dataclass(eq=False)
class FrameTaker:
    """Triggers frames of a camera one by one. Its calls may hang because pylon's may; the caller sets deadlines.

    Attributes:
        device: pylon's InstantCamera, open and set to software triggers.
        pylon: the library.
        camera: for messages.
        timeout: for the camera to be ready for a trigger, and for its frame to arrive, s each.
        last: the last frame taken with this camera.
    """

    device: Any
    pylon: Any
    camera: object
    timeout: float
    last: FrameOrder

    def start(self) -> None:
        """Make the camera wait for triggers; drop earlier frames.

        Raises:
            CameraError: the camera is not set to software triggers.
        """
        nodes = self.device.GetNodeMap()
        nodes.GetNode("TriggerSelector").SetValue("FrameStart")
        mode, source = (nodes.GetNode(name).GetValue() for name in ("TriggerMode", "TriggerSource"))
        if (mode, source) != ("On", "Software"):
            raise self._error(
                "stale",
                f"takes frames without triggers (TriggerMode {mode}, TriggerSource {source}), which may be older than "
                "the look: its settings were changed since it was opened",
            )
        self.device.StartGrabbing(self.pylon.GrabStrategy_OneByOne, self.pylon.GrabLoop_ProvidedByUser)

    def stop(self) -> None:
        """Stop grabbing; drop pending frames."""
        self.device.StopGrabbing()

    def restart(self) -> None:
        """Restart after a damaged frame; its number is unreliable, so numbering starts again."""
        self.stop()
        self.last = FrameOrder(None, self.last.stamp)
        self.start()

    def take(self) -> Image | str:
        """Trigger a frame and wait for it: (h, w) grey, or a description of the damage.

        Raises:
            CameraError: the frame is late or stale, or the camera is gone.
        """
        device, pylon = self.device, self.pylon
        timeout_ms = max(1, round(1e3 * self.timeout))
        self.require_none_waiting()
        waits = device.CanWaitForFrameTriggerReady()  # the oldest cameras cannot
        if waits and not device.WaitForFrameTriggerReady(timeout_ms, pylon.TimeoutHandling_Return):
            raise self._error("timeout", f"was not ready for a trigger within {self.timeout:g} s")
        device.ExecuteSoftwareTrigger()
        result = device.RetrieveResult(timeout_ms, pylon.TimeoutHandling_Return)
        try:
            if device.IsCameraDeviceRemoved():
                raise removed(self.camera)
            if not result.IsValid():
                raise self._error(
                    "timeout",
                    f"no frame within {self.timeout:g} s of its trigger; is the cable good, and does timeout_s exceed "
                    "the exposure?",
                )
            if not result.GrabSucceeded():
                return f"{result.ErrorDescription.rstrip('.')} (error {result.ErrorCode:#x})"
            self._require_next(FrameOrder(result.BlockID, result.TimeStamp), result.ImageNumber == 1)
            return self._grey(result)
        finally:
            result.Release()

    def require_none_waiting(self) -> None:
        """Check that no frame is waiting that was not triggered.

        Raises:
            CameraError: some are.
        """
        waiting = self.device.NumReadyBuffers.GetValue()
        if waiting:
            rule = f"sent {waiting} frame{'s' * (waiting > 1)} without a trigger"
            raise self._error("stale", rule, frames=waiting)

    def _require_next(self, frame: FrameOrder, first: bool) -> None:
        if not self.last.is_next(frame, first):
            rule = (
                f"a frame ({frame}) came after another ({self.last}): frames were lost, or this one is older than its "
                "trigger"
            )
            raise self._error("stale", rule, number=frame.number, last=self.last.number)
        self.last = frame

    def _grey(self, result: Any) -> Image:
        if result.PixelType == self.pylon.PixelType_Mono8:
            return np.asarray(result.GetArray(), dtype=np.uint8)
        converter, form = self.pylon.ImageFormatConverter(), result.PixelType
        mono = self.pylon.IsMono(form) and not self.pylon.IsBayer(form)
        converter.OutputPixelFormat = self.pylon.PixelType_Mono8 if mono else self.pylon.PixelType_BGR8packed
        image = np.array(converter.Convert(result).GetArray(), dtype=np.uint8)
        return as_grey(image)  # OpenCV's colour weights, as for images from files; pylon's differ

    def _error(self, reason: str, rule: str, **data: Any) -> CameraError:
        return CameraError(self.camera, reason, rule, **data)


def removed(camera: object) -> CameraError:
    """The error for a camera that was removed."""
    return CameraError(camera, "removed", "was unplugged, or lost its power or network")
