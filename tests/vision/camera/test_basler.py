"""A Basler camera, by pylon's own emulation of one: what it sends is passed on bit by bit, or refused with a reason."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from arm.errors import CameraError, InputError
from pictures.cameras import SERIAL, Wrong, photographs, refused, settings, showing
from vision.camera import basler
from vision.camera.basler import BaslerCamera, BaslerSettings
from vision.camera.basler_devices import load_pylon
from vision.camera.frame_source import FrameSource

pytestmark = pytest.mark.xdist_group("basler")


@pytest.fixture(autouse=True)
def two_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pylon counts its emulated cameras whenever it is asked what is there."""
    monkeypatch.setenv("PYLON_CAMEMU", "2")


def test_photographs_are_passed_on_bit_by_bit_and_in_order(camera: BaslerCamera, tmp_path: Path) -> None:
    source: FrameSource = camera
    truth = photographs(tmp_path / "shots", 4, seed=1)
    for _ in range(2):
        seen = source.grab(4)
        assert [image.dtype for image in seen] == [np.uint8] * 4
        assert np.array_equal(seen, truth)


def test_colour_is_made_grey(tmp_path: Path) -> None:
    (tmp_path / "shots").mkdir()
    colour = np.random.default_rng(0).integers(0, 256, (200, 320, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "shots/0.png"), colour)
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    for form in ("BGR8Packed", "RGB8Packed"):
        features = {**showing(tmp_path / "shots"), "PixelFormat": form}
        with BaslerCamera(SERIAL, BaslerSettings(features=features)) as camera:
            assert np.array_equal(camera.grab(1)[0], grey)
    cv2.imwrite(str(tmp_path / "shots/0.png"), np.full_like(colour, (0, 0, 200)))
    features = {**showing(tmp_path / "shots"), "PixelFormat": "BayerRG8"}
    with BaslerCamera(SERIAL, BaslerSettings(features=features)) as camera:
        assert np.unique(camera.grab(1)[0][4:-4, 4:-4]).tolist() == [60]  # 0.299 of red, and no pattern
    cv2.imwrite(str(tmp_path / "shots/0.png"), grey)
    features = {**showing(tmp_path / "shots"), "PixelFormat": "Mono12"}
    with BaslerCamera(SERIAL, BaslerSettings(features=features)) as camera:
        assert np.array_equal(camera.grab(1)[0], grey)


def test_settings_are_made(tmp_path: Path) -> None:
    photographs(tmp_path / "shots")
    made = BaslerSettings(exposure=0.0123, gain=6.0, features={"ReverseX": True, "TriggerMode": "Off"})
    with BaslerCamera(SERIAL, made) as camera:
        assert camera.device.ExposureTime.Value == pytest.approx(12300.0)
        assert camera.device.Gain.Value == pytest.approx(6.0, abs=0.01)
        assert (camera.exposure, camera.gain) == pytest.approx((0.0123, 6.0), abs=1e-3)
        assert camera.device.ReverseX.Value
        assert camera.device.PixelFormat.Value == "Mono8"
        assert camera.device.TriggerMode.Value == "On"  # whatever the features say
        assert camera.device.TriggerSource.Value == "Software"


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (BaslerSettings(exposure=20.0), r"exposure_us = 20000000\.0: must be from 1 to 1e\+07 us"),
        (BaslerSettings(gain=60.0), r"gain_db = 60\.0: must be from 0 to 48 dB"),
        (BaslerSettings(features={"Expsure": 1}), r"features\.Expsure = 1: this camera has no such feature"),
        (BaslerSettings(features={"ReverseX": "so"}), r"features\.ReverseX = 'so': .*cannot convert string"),
        (BaslerSettings(features={"Width": 10**6}), r"features\.Width = 1000000: .*4096"),
    ],
)
def test_settings_that_cannot_be_made_are_told(made: BaslerSettings, message: str) -> None:
    with pytest.raises(CameraError, match=message) as caught, BaslerCamera(SERIAL, made):
        pass
    assert caught.value.data["reason"] == "setting"


@pytest.mark.parametrize("change", [("TriggerMode", "Off"), ("TriggerSource", "Line1")])
def test_a_camera_that_takes_frames_on_its_own_is_refused(
    camera: BaslerCamera, change: tuple[str, str]
) -> None:
    camera.device.GetNodeMap().GetNode(change[0]).SetValue(change[1])
    assert f"takes frames without triggers (TriggerMode {'Off' if change[1] == 'Off' else 'On'}" in refused(
        camera, "stale"
    )


def test_a_camera_that_is_not_there_is_told_with_those_that_are(monkeypatch: pytest.MonkeyPatch) -> None:
    for selector, message in (
        (
            "serial:1234",
            "camera serial:1234: not found; connected: Emulation serial:0815-0000 class:Basler",
        ),
        ("class:BaslerCamEmu", "matches 2 cameras; use serial:NUMBER; connected: Emulation serial:0815-0000"),
    ):
        with pytest.raises(CameraError, match=message) as caught, BaslerCamera(selector):
            pass
        assert [found["serial"] for found in caught.value.data["found"]] == ["0815-0000", "0815-0001"]
    monkeypatch.setenv("PYLON_CAMEMU", "0")
    with pytest.raises(CameraError, match="not found, nor is any other; is it powered"), BaslerCamera(SERIAL):
        pass


@pytest.mark.parametrize(
    "words",
    [
        "Failed to open device '2676:ba02:2:2:25' for XML file download. Error: 'Device is exclusively opened by "
        "another client.' : RuntimeException thrown (file 'PylonUsbTL.cpp', line 474)",
        "Failed to open 'Basler'. The device is controlled by another application. Err: An attempt was made to "
        "access an address location which is currently/momentary not accessible. (0xE1018006)\n : RuntimeException "
        "thrown (file 'gigedevice.cpp', line 274)",
    ],
    ids=["usb", "gige"],
)
def test_a_camera_of_another_program_is_told(monkeypatch: pytest.MonkeyPatch, words: str) -> None:
    genicam, pylon = load_pylon()  # its emulation lets two programs in; the words are those of real cameras

    def taken(_: Any) -> None:
        raise genicam.RuntimeException(words)

    monkeypatch.setattr(pylon.InstantCamera, "Open", taken)
    with pytest.raises(CameraError, match="is in use by another program; end that first") as caught:
        BaslerCamera(SERIAL).__enter__()
    assert "thrown" not in str(caught.value)


@pytest.mark.parametrize("when", ["before a look", "before a frame", "after a frame"])
def test_a_camera_that_is_unplugged_is_told(camera: BaslerCamera, when: str) -> None:
    real = camera.device
    camera.settings = BaslerSettings(timeout=0.5)

    def unplugged() -> None:
        if when == "after a frame":
            real.ExecuteSoftwareTrigger()
        real.FirePnPCallback.Execute()

    if when == "before a look":
        unplugged()
    else:
        camera.device = Wrong(real, ExecuteSoftwareTrigger=unplugged)
    assert "was unplugged, or lost its power" in refused(camera, "removed")
    assert "was unplugged, or lost its power" in refused(camera, "removed")
    camera.close()


def test_without_pypylon_it_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pypylon", None)
    with pytest.raises(CameraError, match=r"`make basler` or pip install 'a465\[basler\]'") as caught:
        BaslerCamera(SERIAL).__enter__()
    assert caught.value.data["reason"] == "no pypylon"
    if (project := Path(__file__).parents[3] / "pyproject.toml").is_file():  # both are there to be used
        assert tomllib.loads(project.read_text())["project"]["optional-dependencies"]["basler"] == ["pypylon"]
        assert "\nbasler:" in project.with_name("Makefile").read_text()


def test_a_call_that_hangs_holds_nothing_up(
    camera: BaslerCamera, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(basler, "MARGIN_S", 1.0)
    free = threading.Event()
    camera.settings = BaslerSettings(timeout=0.1)
    camera.device = Wrong(camera.device, ExecuteSoftwareTrigger=lambda: free.wait(300.0))
    begun = time.monotonic()
    assert "image 1: no answer within 1.2 s; unplug the camera" in refused(camera, "hung")
    assert "an earlier call hangs" in refused(camera, "hung")
    camera.close()
    assert time.monotonic() - begun < 60.0
    free.set()
    assert not told
    with BaslerCamera(SERIAL) as again:
        assert len(again.grab(1)) == 1


@pytest.mark.slow
def test_a_close_that_hangs_does_not_keep_the_program(tmp_path: Path) -> None:
    code = (
        "import time\nfrom vision.camera import basler\nbasler.CLOSE_S = 0.3\n"
        f"with basler.BaslerCamera('{SERIAL}', tell=print) as camera:\n"
        "    camera._release = lambda: time.sleep(60)\n"
        "print('done')"
    )
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True, timeout=600
    )
    assert ran.stdout.splitlines() == [
        f"camera {SERIAL}: closing it: no answer within 0.3 s; unplug the camera and plug it in again",
        "done",
    ]


def test_an_interrupt_is_heard_during_a_look(camera: BaslerCamera) -> None:
    camera.device = Wrong(camera.device, ExecuteSoftwareTrigger=lambda: None)
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    camera.settings = BaslerSettings(timeout=300.0)
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        camera.grab(1)
    assert time.monotonic() - begun < 60.0  # the frame that does not come is not waited for
    camera.device = camera.device.real
    assert len(camera.grab(1)) == 1


def test_after_a_failure_the_camera_can_be_opened_again(tmp_path: Path) -> None:
    truth = photographs(tmp_path / "shots")
    for _ in range(3):
        with pytest.raises(CameraError), BaslerCamera(SERIAL, settings(tmp_path), (9, 9)) as camera:
            camera.grab(1)
        assert camera.device is None
        refused(camera, "closed")
        camera.close()  # does no harm
    with BaslerCamera(SERIAL, settings(tmp_path)) as camera:
        assert np.array_equal(camera.grab(3), truth)
    with camera:  # one object may be opened again too
        assert np.array_equal(camera.grab(3), truth)


def test_a_wrong_selector_is_an_input_error() -> None:
    with pytest.raises(InputError, match="must be name:NAME, serial:NUMBER, ip:ADDRESS or class:CLASS"):
        BaslerCamera("colour:red")
