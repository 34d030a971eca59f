"""What a Basler camera rests on: selectors, settings under the names of two generations, order of frames, deadlines."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from arm.errors import CameraError, InputError
from pictures.cameras import SERIAL, nameless
from vision.camera.basler import BaslerCamera
from vision.camera.basler_devices import FoundDevice, Selector, read_selector
from vision.camera.basler_features import set_exposure, set_gain, set_heartbeat
from vision.camera.deadline_worker import Worker
from vision.camera.frame_order import LAST_SHORT, NO_NUMBER, FrameOrder

pytestmark = pytest.mark.xdist_group("basler_parts")

LAB = [
    FoundDevice("camera-crs93", "21923415", "192.168.0.7", "BaslerGigE", "acA1920-40gm"),
    FoundDevice("camera-crs97", "21923416", "192.168.0.8", "BaslerGigE", "acA1920-40gm"),
    FoundDevice("21923415", "40000001", "", "BaslerUsb", "a2A1920-160um"),
    FoundDevice("", "40000002", "", "BaslerUsb", "a2A1920-160um"),
    FoundDevice("twin", "40000003", "", "BaslerCamEmu", "Emulation"),
    FoundDevice("twin", "40000004", "", "BaslerCXP", "boA1936"),
]


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("camera-crs93", 0),
        ("name:camera-crs97", 1),
        ("serial:21923415", 0),
        ("21923415", 2),  # a name goes before a serial number
        ("40000002", 3),
        (" ip : 192.168.0.8 ", 1),
        ("class:BaslerCXP", 5),
    ],
)
def test_a_selector_finds_its_camera(text: str, number: int) -> None:
    assert read_selector(text).choose(LAB) == number


@pytest.mark.parametrize(
    ("text", "reason", "message"),
    [
        (
            "twin",
            "ambiguous",
            "camera twin: matches 2 cameras; use serial:NUMBER; connected: acA1920-40gm name:camera",
        ),
        ("class:BaslerUsb", "ambiguous", "matches 2 cameras"),
        ("name:21923416", "missing", "camera name:21923416: not found; connected:"),
        ("serial:camera-crs93", "missing", "serial:21923415 ip:192.168.0.7 class:BaslerGigE"),
        ("ip:192.168.0.9", "missing", "not found"),
    ],
)
def test_a_selector_that_means_none_or_several_lists_all(text: str, reason: str, message: str) -> None:
    with pytest.raises(CameraError, match=message) as caught:
        read_selector(text).choose(LAB)
    assert caught.value.data["reason"] == reason
    assert len(caught.value.data["found"]) == len(LAB)
    with pytest.raises(CameraError, match="not found, nor is any other; is it powered"):
        read_selector(text).choose([])


@pytest.mark.parametrize("text", ["", "  ", "name:", ":x", "colour:red", "ip:camera", "ip:192.168.0.300"])
def test_what_is_no_selector_is_told(text: str) -> None:
    with pytest.raises(InputError, match="must be"):
        read_selector(text)


def test_a_selector_is_written_as_it_was_read() -> None:
    assert str(read_selector("ip:10.0.0.1")) == "ip:10.0.0.1"
    assert read_selector(" lab ") == Selector("", "lab")


def refuse(key: str, value: Any, rule: str) -> Exception:
    return CameraError("lab", "setting", f"{key} = {value!r}: {rule}")


@pytest.fixture
def nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    with BaslerCamera(SERIAL) as camera:
        yield camera.device.GetNodeMap()


@pytest.mark.parametrize("number", range(3))
def test_exposure_under_all_its_names(nodes: Any, number: int) -> None:
    names = ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
    hidden = names[:number]
    nodes.GetNode("ExposureAuto").SetValue("Continuous")
    assert set_exposure(nameless(nodes, *hidden), 0.0043, refuse) == pytest.approx(0.0043)
    assert nodes.GetNode(names[number]).GetValue() == pytest.approx(4300.0)
    assert nodes.GetNode("ExposureAuto").GetValue() == "Off"
    with pytest.raises(CameraError, match=r"exposure_us = 60000000\.0: must be from"):
        set_exposure(nameless(nodes, *hidden), 60.0, refuse)


def test_a_camera_without_any_exposure_is_told(nodes: Any) -> None:
    bare = nameless(nodes, "ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
    with pytest.raises(
        CameraError, match=r"exposure_us = 4300\.0: the exposure of this camera cannot be set"
    ):
        set_exposure(bare, 0.0043, refuse)


def test_gain_is_in_decibels_or_not_at_all(nodes: Any) -> None:
    nodes.GetNode("GainAuto").SetValue("Continuous")
    assert set_gain(nodes, 12.0, refuse) == pytest.approx(12.0, abs=0.01)
    assert nodes.GetNode("GainAuto").GetValue() == "Off"
    with pytest.raises(CameraError, match=r"features = \{ GainRaw = NUMBER \}, from 192 to 1023"):
        set_gain(nameless(nodes, "Gain", "GainAbs"), 12.0, refuse)
    with pytest.raises(CameraError, match="the gain of this camera cannot be set"):
        set_gain(nameless(nodes, "Gain", "GainAbs", "GainRaw"), 12.0, refuse)


class Heartbeat:
    """The node of a GigE camera, which pylon's emulation has not."""

    def __init__(self) -> None:
        self.value = 0

    def GetNode(self, name: str) -> Heartbeat:
        assert name == "HeartbeatTimeout"
        return self

    def IsWritable(self) -> bool:
        return True

    def GetMin(self) -> int:
        return 500

    def GetMax(self) -> int:
        return 60000

    def GetInc(self) -> int:
        return 7

    def SetValue(self, value: int) -> None:
        assert 500 <= value <= 60000
        assert (value - 500) % 7 == 0
        self.value = value


@pytest.mark.parametrize(("seconds", "ms"), [(3.0, 3000), (0.1, 500), (100.0, 60000)])
def test_heartbeat(seconds: float, ms: int) -> None:
    node = Heartbeat()
    set_heartbeat(node, seconds)
    assert abs(node.value - ms) < 7


@pytest.mark.parametrize(
    ("last", "frame", "first", "fits"),
    [
        (FrameOrder(), FrameOrder(0), True, True),
        (FrameOrder(), FrameOrder(17), True, True),  # nothing is known yet
        (FrameOrder(), FrameOrder(17), False, False),
        (FrameOrder(), FrameOrder(NO_NUMBER), True, False),
        (FrameOrder(), FrameOrder(None), True, False),
        (FrameOrder(4), FrameOrder(5), False, True),
        (FrameOrder(4), FrameOrder(4), False, False),
        (FrameOrder(4), FrameOrder(6), False, False),
        (FrameOrder(4), FrameOrder(3), False, False),
        (FrameOrder(4), FrameOrder(1), False, False),
        (FrameOrder(4), FrameOrder(1), True, True),  # numbers begin anew, or go on
        (FrameOrder(4), FrameOrder(5), True, True),
        (FrameOrder(4), FrameOrder(6), True, False),
        (FrameOrder(LAST_SHORT), FrameOrder(1), False, True),
        (FrameOrder(LAST_SHORT), FrameOrder(LAST_SHORT + 1), False, True),
        (FrameOrder(LAST_SHORT), FrameOrder(2), False, False),
        (FrameOrder(4, 100), FrameOrder(5, 101), False, True),
        (FrameOrder(4, 100), FrameOrder(5, 100), False, False),
        (FrameOrder(4, 100), FrameOrder(0, 99), True, False),
        (FrameOrder(4, 100), FrameOrder(5, 0), False, True),  # no stamps
    ],
)
def test_order_of_frames(last: FrameOrder, frame: FrameOrder, first: bool, fits: bool) -> None:
    assert last.is_next(frame, first) is fits


def test_a_worker_gives_what_calls_give_and_raise() -> None:
    worker = Worker("test")
    assert worker.call(lambda: 3, 1.0) == 3
    with pytest.raises(ZeroDivisionError):
        worker.call(lambda: 1 // 0, 1.0)
    with pytest.raises(TimeoutError, match="its own"):
        worker.call(lambda: (_ for _ in ()).throw(TimeoutError("its own")), 1.0)
    assert not worker.lost
    assert worker.call(lambda: 4, 1.0) == 4
    worker.end()


def test_a_worker_that_is_lost_makes_no_other_call() -> None:
    worker, free, made = Worker("test"), threading.Event(), []
    begun = time.monotonic()
    with pytest.raises(TimeoutError, match=r"no answer within 0\.1 s"):
        worker.call(lambda: free.wait(20.0), 0.1)
    with pytest.raises(TimeoutError, match="an earlier call hangs"):
        worker.call(lambda: made.append(1), 20.0)
    assert time.monotonic() - begun < 2.0
    free.set()
    assert not made


def test_a_worker_that_was_ended_is_gone() -> None:
    """A native thread that ends while the interpreter does is ended by the C library, with exit code 134."""
    worker = Worker("ends")
    assert worker.call(lambda: 7, 5.0) == 7
    worker.end()
    assert "ends" not in {thread.name for thread in threading.enumerate()}
