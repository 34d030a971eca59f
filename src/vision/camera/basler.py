"""A Basler camera: current images, each one triggered, or an error with the reason (docs/cameras.md).

The facts about pylon used here were measured with its camera emulation: parts.md section 2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Self

from arm.errors import CameraError
from vision.camera.basler_devices import EMULATED, Selector, find_devices, load_pylon, read_selector
from vision.camera.basler_features import (
    Feature,
    choose,
    message_of,
    set_exposure,
    set_features,
    set_gain,
    set_heartbeat,
)
from vision.camera.basler_grab import FrameOrder, FrameTaker, removed
from vision.camera.deadline_worker import T, Worker
from vision.camera.frame_source import Image

FAILED_FRAMES = 2  # damaged frames to retake per look: a lost packet must not stop the arm, a bad cable must
OPEN_S = 20.0  # wall time for a step of opening; GigE cameras are searched for by broadcast
CLOSE_S = 5.0
MARGIN_S = 2.0  # wall time for a frame beyond its time-outs


@dataclass(frozen=True)
class BaslerSettings:
    """Settings of a camera; None leaves the camera's own value.

    Attributes:
        exposure: s.
        gain: dB.
        timeout: for the camera to be ready for a trigger, and for its frame to arrive, s each.
        heartbeat: of a GigE camera, s.
        features: other settings, by the camera's own names; made first, so that trigger and format override them.
    """

    exposure: float | None = None
    gain: float | None = None
    timeout: float = 2.0
    heartbeat: float = 3.0
    features: Mapping[str, Feature] = field(default_factory=dict)


class BaslerCamera:
    """Takes images with a Basler camera (`vision.camera.frame_source.FrameSource`); a context manager.

    Each frame has its own software trigger, sent after the call of `grab`, so no frame is older than the call.

    Attributes:
        device: pylon's InstantCamera while open, for settings without support here.
        settings: requested.
        exposure, gain: set by the camera, s and dB; None if not requested.
        description: the camera and its settings in one line.
        doubts: what the camera does not tell: nothing, as every frame is triggered.
        stand_in: what it is if it cannot show the present cell: pylon's emulation; "" of a real one. Known once open.
    """

    def __init__(
        self,
        selector: str,
        settings: BaslerSettings | None = None,
        size: tuple[int, int] | None = None,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        """
        Args:
            selector: of the camera; see `vision.camera.basler_devices.read_selector`.
            settings: of the camera.
            size: required width and height of frames, px; None for any, the same within a look.
            tell: called with one line per problem that does not stop the work.

        Raises:
            InputError: the selector is invalid.
        """
        self.selector: Selector = read_selector(selector)
        self.settings = settings or BaslerSettings()
        self.device: Any = None
        self.exposure: float | None = None
        self.gain: float | None = None
        self.description = ""
        self.doubts: tuple[str, ...] = ()
        self.stand_in = ""
        self._size = size
        self._tell = tell
        self._pylon: Any = None
        self._genicam: Any = None
        self._worker: Worker | None = None
        self._last = FrameOrder()

    # -- opening and closing

    def __enter__(self) -> Self:
        """Open the camera and set it up.

        Raises:
            CameraError: pypylon is not installed; the camera is missing, ambiguous or in use, or refuses a setting.
        """
        try:
            self._genicam, self._pylon = load_pylon()
        except ImportError as error:
            rule = (
                f"needs pypylon, which cannot be imported ({error}); install it by `make basler` or pip install "
                "'a465[basler]'"
            )
            raise CameraError(self.selector, "no pypylon", rule) from error
        self._worker, self._last = Worker(f"camera {self.selector}"), FrameOrder()
        try:
            found = self._ask(lambda: find_devices(self._pylon), OPEN_S, "the search for cameras")
            chosen = found[self.selector.choose([device for device, _ in found])][1]
            self._ask(lambda: self._open(chosen), OPEN_S, "opening it")
            self._ask(self._set_up, OPEN_S, "setting it up")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the camera in any state, within `CLOSE_S`; report problems by `tell`."""
        if self.device is not None:
            self._ask_aside(self._release, CLOSE_S, "closing it")
        self.device = None
        if self._worker is not None:
            self._worker.end()
        self._worker = None

    def _open(self, info: Any) -> None:
        pylon = self._pylon
        self.device = pylon.InstantCamera(pylon.TlFactory.GetInstance().CreateDevice(info))
        self.device.Open()

    def _set_up(self) -> None:
        nodes, settings = self.device.GetNodeMap(), self.settings
        set_features(nodes, settings.features, self._refused, self._genicam.GenericException)
        # one frame per software trigger, and no others
        self._pylon.SoftwareTriggerConfiguration.ApplyConfiguration(nodes)
        if "PixelFormat" not in settings.features:
            choose(nodes, "PixelFormat", "Mono8")  # frames of other formats are converted
        set_heartbeat(self.device.GetTLNodeMap(), settings.heartbeat)
        if settings.exposure is not None:
            self.exposure = set_exposure(nodes, settings.exposure, self._refused)
        if settings.gain is not None:
            self.gain = set_gain(nodes, settings.gain, self._refused)
        info = self.device.GetDeviceInfo()
        self.stand_in = "pylon's emulation" if info.GetDeviceClass() == EMULATED else ""
        width, height = (nodes.GetNode(name).GetValue() for name in ("Width", "Height"))
        self.description = (
            f"camera {self.selector}: {info.GetModelName()} serial:{info.GetSerialNumber()}, {width} x {height} px"
            + ("" if self.exposure is None else f", exposure {1e3 * self.exposure:g} ms")
            + ("" if self.gain is None else f", gain {self.gain:.1f} dB")
        )

    def _release(self) -> None:
        self.device.StopGrabbing()
        self.device.Close()
        self.device.DestroyDevice()

    # -- images

    def grab(self, count: int) -> list[Image]:
        """Take `count` images, (h, w) grey, each triggered after this call.

        Up to `FAILED_FRAMES` damaged frames are reported and retaken; none is returned.

        Raises:
            CameraError: more are damaged, one is late, stale or of another size, or the camera is gone or hangs.
        """
        if self.device is None:
            raise CameraError(self.selector, "closed", "is not open")
        taker = FrameTaker(self.device, self._pylon, self.selector, self.settings.timeout, self._last)
        frame_s = 2.0 * self.settings.timeout + MARGIN_S
        images: list[Image] = []
        failed: list[str] = []
        with self._grabbing(taker, frame_s):
            while len(images) < count:
                taken = self._ask(taker.take, frame_s, f"image {len(images) + 1}")
                if isinstance(taken, str):
                    failed.append(taken)
                    self._count_failed(failed, len(images) + 1, count)
                    self._ask(taker.restart, MARGIN_S, "restarting it")
                else:
                    self._require_size(taken, images)
                    images.append(taken)
            self._ask(taker.require_none_waiting, MARGIN_S, "its queue")
        return images

    @contextmanager
    def _grabbing(self, taker: FrameTaker, frame_s: float) -> Iterator[None]:
        self._ask(taker.start, MARGIN_S, "starting it")
        try:
            yield
        except BaseException:
            self._ask_aside(taker.stop, MARGIN_S, "stopping it")  # which ends the wait for a frame
            raise
        else:
            self._ask(taker.stop, frame_s, "stopping it")
        finally:
            self._last = taker.last

    def _count_failed(self, failed: list[str], number: int, count: int) -> None:
        if len(failed) > FAILED_FRAMES:
            rule = (
                f"{len(failed)} frames of one look were damaged: {'; '.join(failed)}; "
                "check cable, bandwidth and packet size"
            )
            raise CameraError(self.selector, "failed", rule, failed=failed)
        self._tell(
            f"camera {self.selector}: image {number} of {count} was damaged and is retaken: {failed[-1]}"
        )

    def _require_size(self, image: Image, before: list[Image]) -> None:
        height, width = image.shape
        wanted = self._size or (before[0].shape[1::-1] if before else (width, height))
        if (width, height) != wanted:
            of = "the camera's calibration is for" if self._size else "the previous frame was"
            rule = (
                f"sent a frame of {width} x {height} px, but {of} {wanted[0]} x {wanted[1]} px; set Width, Height, "
                "OffsetX and OffsetY as they were at the calibration (features), or calibrate for this size"
            )
            raise CameraError(self.selector, "size", rule, size_px=[width, height])

    # -- errors

    def _ask(self, function: Callable[[], T], seconds: float, what: str, worker: Worker | None = None) -> T:
        """Call `function` on the worker, within `seconds`; errors of pylon become `CameraError`."""

        def guarded() -> T:
            try:
                return function()
            except self._genicam.GenericException as error:
                if self.device is not None and self.device.IsCameraDeviceRemoved():
                    raise removed(self.selector) from error
                words = message_of(error)
                if "another client" in words or "another application" in words:
                    rule = f"is in use by another program; end that first ({words})"
                    raise CameraError(self.selector, "in use", rule) from error
                raise CameraError(self.selector, "pylon", f"{what}: {words}") from error

        worker = worker or self._worker
        if worker is None:
            raise CameraError(self.selector, "closed", "is not open")
        try:
            return worker.call(guarded, seconds)
        except TimeoutError as error:
            rule = f"{what}: {error}; unplug the camera and plug it in again"
            raise CameraError(self.selector, "hung", rule) from error

    def _ask_aside(self, function: Callable[[], T], seconds: float, what: str) -> None:
        """Call `function` on another thread, as the worker may be busy or hang; report problems by `tell`."""
        worker = Worker(f"camera {self.selector}, aside")
        try:
            self._ask(function, seconds, what, worker)
        except CameraError as error:
            self._tell(str(error))
        finally:
            worker.end()

    def _refused(self, key: str, value: Any, rule: str) -> CameraError:
        return CameraError(self.selector, "setting", f"{key} = {value!r}: {rule}", key=key, value=value)
