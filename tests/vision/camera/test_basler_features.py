"""Settings of Basler cameras under the names of two generations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from arm.errors import CameraError
from pictures.cameras import SERIAL, nameless
from vision.camera.basler import BaslerCamera
from vision.camera.basler_features import set_exposure, set_gain, set_heartbeat

pytestmark = pytest.mark.xdist_group("basler_parts")


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
