"""Ports, controllers and cameras as `a465 doctor` finds them."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import driver.line.clock
import driver.line.link
import driver.line.transport
from arm.controller.unit import load_unit
from arm.errors import CameraError
from cell.config.cell_file import read_cell
from cell.doctor import devices as doctordevices
from cell.doctor.finding import NOTE, OK, WRONG, CheckResult, guarded
from driver.emulator import Emulator, EmulatorOptions
from driver.line.clock import Clock
from driver.line.wire_log import WireLog
from pictures.cameras import SERIAL
from typed.command_line import replace_in
from video.fake_device import DEVICE, FakeDevice, plugged

pytestmark = pytest.mark.xdist_group("doctor")


def _ports(monkeypatch: pytest.MonkeyPatch, *devices: str) -> CheckResult:
    listed = [SimpleNamespace(device=d) for d in reversed(devices)]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda include_links: listed)
    return doctordevices.check_ports()


def test_ports_are_told_with_the_right_to_open_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine, other = tmp_path / "ttyUSB0", tmp_path / "ttyUSB1"
    for file in (mine, other):
        file.write_text("")
    none = _ports(monkeypatch)
    assert (none.verdict, none.found) == (NOTE, "none")
    assert _ports(monkeypatch, str(mine)).found == f"{mine}: you may open it"
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != str(other) and access(path, mode))
    monkeypatch.setattr("grp.getgrgid", lambda gid: SimpleNamespace(gr_name="serialists"))
    both = _ports(monkeypatch, *map(str, (tmp_path / "gone", mine, other)))
    assert both.verdict == NOTE
    assert both.found == f"{tmp_path / 'gone'} (no permission), {mine}, {other} (no permission)"
    assert both.help.startswith("join the group serialists: sudo usermod -aG")
    assert [p["may_open"] for p in both.data["ports"]] == [False, True, False]
    assert [p["group"] for p in both.data["ports"]] == ["", "serialists", "serialists"]


def sent_to(log: Path) -> set[str]:
    records = [json.loads(line) for line in log.read_text().splitlines()]
    return {r["text"].split(":")[0] for r in records if r["kind"] == "line"}


def test_a_controller_is_asked_who_it_is_and_nothing_else(tmp_path: Path) -> None:
    clock = Clock()
    with WireLog(tmp_path / "log", clock) as log, Emulator(load_unit("crs97"), clock, log=log) as emulator:
        found = doctordevices.check_controller(emulator.open_pty())
    assert found.verdict == OK
    assert "MARS8 v1.0 build Pi" in found.found
    assert found.data["version"].startswith("MARS8")
    assert 0.0 < found.data["answer_s"] < 1.0
    assert sent_to(tmp_path / "log") - {""} == {"ECHO", "STAMP", "VER?"}


def test_another_firmware_is_wrong_and_named(tmp_path: Path) -> None:
    clock, options = Clock(), EmulatorOptions(version="MARS9 v2")
    with (
        WireLog(tmp_path / "log", clock) as log,
        Emulator(load_unit("crs93"), clock, options=options, log=log) as emulator,
    ):
        port = emulator.open_pty()
        found = guarded("controller", lambda: doctordevices.check_controller(port), 20.0, "h")
    assert isinstance(found, CheckResult)
    assert found.verdict == WRONG
    assert "firmware 'MARS9 v2' is not MARS8" in found.found
    assert found.data["version"] == "MARS9 v2"
    assert sent_to(tmp_path / "log") - {""} == {"ECHO", "STAMP", "VER?"}


@pytest.fixture
def silent_port() -> Iterator[tuple[int, str]]:
    """The other side of a line on which nobody answers, and its name."""
    import pty
    import tty

    other, line = pty.openpty()
    tty.setraw(line)
    yield other, os.ttyname(line)
    os.close(other)
    os.close(line)


@pytest.mark.slow
def test_a_silent_line_is_wrong_and_gets_harmless_lines_only(
    silent_port: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    other, port = silent_port
    monkeypatch.setattr(driver.line.clock, "LEAST_WALL_S", 0.1)
    monkeypatch.setattr(driver.line.link.Link.synchronise, "__defaults__", (0.2, 1))
    found = guarded("controller", lambda: doctordevices.check_controller(port), 20.0, "h")
    assert isinstance(found, CheckResult)
    assert (found.verdict, found.help) == (WRONG, "h")
    assert "does not answer like a MARS8" in found.found
    lines = os.read(other, 4096).decode().split("\n")
    assert {line.split(":")[0] for line in lines} == {"", "ECHO", "STAMP"}


def test_cameras_are_listed_and_one_takes_a_photograph(monkeypatch: pytest.MonkeyPatch, scenes: Path) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    listed = doctordevices.check_cameras()
    assert listed.verdict == OK
    assert "Emulation serial:0815-0000" in listed.found
    assert listed.data["cameras"][0]["serial"] == "0815-0000"
    taken = doctordevices.check_photograph(SERIAL, None)
    assert taken.verdict == OK
    assert "px; mean grey " in taken.found
    assert taken.data["size_px"][0] > 16
    replace_in(scenes / "cell.toml", "[motion]", f'[look.basler]\ndevice = "{SERIAL}"\n\n[motion]')
    cell = read_cell(scenes / "cell.toml")
    with pytest.raises(CameraError, match="but the camera's calibration is for 1920 x 1200 px"):
        doctordevices.check_photograph("cell", cell)
    with pytest.raises(CameraError, match="not found"):
        doctordevices.check_photograph("serial:1", cell)


def test_video_devices_are_listed_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "0")
    monkeypatch.setattr("vision.camera.basler_devices.find_devices", lambda pylon: [])
    monkeypatch.setattr(doctordevices, "VIDEO_DEVICES", tmp_path)
    (tmp_path / "video7").mkdir()
    (tmp_path / "video7/name").write_text("Webcam C920\n")
    listed = doctordevices.check_cameras()
    assert (listed.verdict, listed.found) == (OK, "Webcam C920 video:/dev/video7 (no permission)")
    assert listed.data["videos"][0]["device"] == "/dev/video7"


def test_a_photograph_of_a_video_source_says_what_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged(monkeypatch, FakeDevice(""))
    taken = doctordevices.check_photograph(DEVICE, None)
    assert taken.verdict == NOTE
    assert re.fullmatch(r"camera video:/dev/null: 32 x 24 px; mean grey (49|50) of 255", taken.found)
    assert taken.help.startswith("it gives no time stamps of use: only latency_s = 0.5 guards")
    assert "whether its shutter rolls is unknown" in taken.help


def test_no_camera_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctordevices, "VIDEO_DEVICES", Path("/nowhere"))
    monkeypatch.setenv("PYLON_CAMEMU", "0")
    monkeypatch.setattr("vision.camera.basler_devices.find_devices", lambda pylon: [])
    assert doctordevices.check_cameras().found == "none: neither pylon's nor video devices"
    monkeypatch.setitem(sys.modules, "pypylon", None)
    found = doctordevices.check_cameras()
    assert (found.verdict, found.help) == (NOTE, "make basler, for Basler cameras")
