"""``a465 doctor``: every check tells what is there, with a figure; nothing hangs, nothing raises, nothing moves."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import driver.link
import driver.portlink
from arm.armcalibration import ArmCalibration, write_arm_calibration
from arm.dh import A465
from arm.errors import CameraError, InputError
from arm.files import data_file
from arm.links import LinkErrors
from arm.se3 import frozen
from arm.unit import load_unit
from cell import doctorcell, doctordevices, doctorinstall, finding, selftest
from cell.cellfile import read_cell
from cell.finding import NOTE, OK, WRONG, Finding, guarded
from command_line import a465, replace_in
from driver.clock import Clock
from driver.emulator import Emulator, EmulatorOptions
from driver.wirelog import WireLog
from emulated_camera import SERIAL
from vision.camera import read_camera, write_camera

pytestmark = pytest.mark.xdist_group("doctor")
CHECKS = [
    "Python", "libraries", "extra mcap", "extra basler", "serial ports", "cell", "arm's shape", "lens", "hand-eye",
    "cameras", "self-test: plan", "self-test: look", "self-test: unit",
]  # fmt: skip


def by_name(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {check["check"]: check for check in report["checks"]}


# -- the whole


def test_a_good_installation_is_told_in_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    busy = time.process_time()
    said, told = a465("doctor", "--camera", SERIAL, "--json", cwd=tmp_path)
    assert time.process_time() - busy < 15.0
    report = json.loads(said)
    assert report["wrong"] == []
    assert report["verdict"] in (OK, NOTE)
    checks = by_name(report)
    names = [*CHECKS[:-3], "photograph", *CHECKS[-3:]]
    assert list(checks) == names
    assert checks["photograph"]["verdict"] == OK  # of any size: no cell was given
    assert all(checks[name]["verdict"] == OK for name in ("Python", "libraries", "cell", *CHECKS[-3:]))
    assert checks["libraries"]["data"]["versions"]["numpy"] == np.__version__
    assert checks["cell"]["found"].startswith("the built-in scene reads: crs93, 6 boards")
    assert checks["self-test: plan"]["data"]["clearance_mm"] > 10.0
    assert checks["self-test: look"]["data"]["off_mm"] < 0.1
    assert checks["self-test: unit"]["data"]["version"].startswith("MARS8")
    assert 0.0 < checks["self-test: unit"]["data"]["answer_s"] < 1.0
    assert platform.node() not in said + told
    lines = told.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line.split("  ")[0] for line in lines[2:-1] if not line.startswith(" ")] == names
    notes = sum(check["verdict"] == NOTE for check in report["checks"])
    assert lines[-1] == f"{len(names) - notes} ok, {notes} note, 0 wrong"
    assert list(tmp_path.iterdir()) == []


def test_what_is_wrong_is_told_and_ends_with_3(scenes: Path) -> None:
    wall = '[[walls]]\nname = "in the way"\ncentre_mm = [0, 0, 900]\nsize_mm = [900, 900, 900]\n\n[look]'
    replace_in(scenes / "cell.toml", "[look]", wall)
    arguments = ["--cell", scenes / "task2.toml", "--port", scenes / "nowhere", "--camera", "cell"]
    said, told = a465("doctor", *arguments, "--json", code=3)
    report = json.loads(said)
    checks = by_name(report)
    assert report["verdict"] == WRONG
    assert report["wrong"] == ["controller", "photograph", "self-test: plan"]
    assert "in the way" in checks["self-test: plan"]["found"]
    assert "nowhere: is not there; is the cable plugged in" in checks["controller"]["found"]
    assert "needs --cell FILE whose [look.basler] names a device" in checks["photograph"]["found"]
    assert all(checks[name]["help"] for name in report["wrong"])
    assert told.splitlines()[-1] == "a465: doctor: wrong: controller, photograph, self-test: plan"
    assert checks["cell"]["found"].startswith(f"{scenes / 'task2.toml'} reads: crs93")
    table = told.splitlines()
    start = next(i for i, line in enumerate(table) if line.startswith("self-test: plan"))
    assert "wrong" in table[start]
    assert any(line.strip().startswith("-> q_start_deg") for line in table[start:])


@pytest.mark.parametrize("missing", [["numpy"], ["serial", "pypylon", "ruckig", "cv2"]], ids=lambda m: m[0])
def test_missing_libraries_are_rows_and_no_traceback(missing: list[str]) -> None:
    code = (
        f"import sys\nfor name in {missing!r}: sys.modules[name] = None\n"
        "sys.argv = ['a465', 'doctor', '--port', '/dev/nowhere', '--camera', 'cell', '--json']\n"
        "from cell.start import main\nmain()"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False
    )
    assert ran.returncode == 3, ran.stderr
    assert "Traceback" not in ran.stderr
    checks = by_name(json.loads(ran.stdout))
    assert checks["Python"]["verdict"] == OK
    assert all(checks[name]["verdict"] == WRONG for name in CHECKS[-3:])
    assert f"import of {missing[0]} halted" in json.dumps(checks)
    assert "pip install" in checks["self-test: look"]["help"]
    if "serial" in missing:
        assert checks["cameras"]["verdict"] == NOTE
        assert checks["serial ports"]["verdict"] == checks["controller"]["verdict"] == WRONG


def test_a_cell_that_cannot_be_read_is_wrong_and_the_rest_goes_on(tmp_path: Path) -> None:
    said, _ = a465("doctor", "--cell", tmp_path / "none.toml", "--json", code=3)
    report = json.loads(said)
    assert report["wrong"] == ["cell"]
    assert "none.toml: cannot be read: No such file" in by_name(report)["cell"]["found"]
    assert by_name(report)["self-test: plan"]["verdict"] == OK


# -- deadlines and failures of a check


def test_a_check_that_hangs_is_wrong_in_time() -> None:
    over = threading.Event()
    began = time.monotonic()
    found = guarded("slow", lambda: over.wait(120.0), 0.1, "wait")
    over.set()
    assert time.monotonic() - began < 60.0
    assert found == Finding("slow", WRONG, "no answer within 0.1 s", "wait", {"error": "TimeoutError"})


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (
            InputError("bad key", key="x"),
            Finding("c", WRONG, "bad key", "h", {"error": "InputError", "key": "x"}),
        ),
        (OSError(5, "broken"), Finding("c", WRONG, "[Errno 5] broken", "h", {"error": "OSError"})),
        (ImportError("no x"), Finding("c", WRONG, "cannot be looked at: no x", finding.REINSTALL)),
    ],
)
def test_a_check_that_fails_is_wrong(error: Exception, told: Finding) -> None:
    def fail() -> Finding:
        raise error

    assert guarded("c", fail, 5.0, "h") == told


def test_mistakes_of_the_program_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        guarded("c", lambda: 1 // 0, 5.0, "h")


# -- installation


@pytest.mark.parametrize(
    ("installed", "asked", "good"),
    [
        ("4.14.0.94", "<5,>=4.14", True),
        ("4.13.9", "<5,>=4.14", False),
        ("5.0", "<5,>=4.14", False),
        ("5", "<5.0", False),
        ("4.10", ">=4.9", True),
        ("3.11.7", ">=3.11", True),
        ("2.0.1", "==2.0.1", True),
        ("2.0.2", "==2.0.1", False),
        ("2.0.1", "!=2.0.1", False),
        ("4.0rc1", ">=4", True),
        ("3", ">3", False),
        ("3.1", "<=3", False),
        ("1.0", "", True),
    ],
)
def test_versions_are_compared_by_their_numbers(installed: str, asked: str, good: bool) -> None:
    assert doctorinstall.fits(installed, asked) is good


def test_libraries_that_are_missing_or_too_old_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [
        "numpy>=99",
        "no-such-library",
        "scipy",
        "mcap>=99; extra == 'mcap'",
        "pypylon; extra == 'basler'",
    ]
    package = SimpleNamespace(requires=lines, metadata={"Requires-Python": ">=99.1"}, version="0")
    monkeypatch.setattr(doctorinstall, "distribution", lambda name: package)
    found = doctorinstall.libraries_finding()
    assert found.verdict == WRONG
    assert found.found == f"numpy {np.__version__} is not >=99; no-such-library is missing"
    mcap, basler = doctorinstall.extra_findings()
    assert (mcap.verdict, basler.verdict) == (NOTE, OK)
    assert "is not >=99; needed for a465 export --format mcap" in mcap.found
    assert "a465[mcap]" in mcap.help
    python = doctorinstall.python_finding()
    assert (python.verdict, python.help) == (WRONG, "a465 needs Python >=99.1")


def test_what_pyproject_asks_for_is_what_is_looked_at() -> None:
    of = doctorinstall.requirements(doctorinstall.distribution("a465"))
    assert {"numpy", "typer", "pyserial"} <= {r.name for r in of if not r.extra}
    assert {r.name for r in of if r.extra == "basler"} == {"pypylon"}
    assert next(r.asked for r in of if r.name == "pin" and not r.extra) == ">=4"


# -- ports and the controller


def _ports(monkeypatch: pytest.MonkeyPatch, *devices: str) -> Finding:
    listed = [SimpleNamespace(device=d) for d in reversed(devices)]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda include_links: listed)
    return doctordevices.ports_finding()


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
    assert both.found == f"{tmp_path / 'gone'} (not for you), {mine}, {other} (not for you)"
    assert both.help.startswith("join the group serialists: sudo usermod -aG")
    assert [p["may_open"] for p in both.data["ports"]] == [False, True, False]
    assert [p["group"] for p in both.data["ports"]] == ["", "serialists", "serialists"]


def sent_to(log: Path) -> set[str]:
    records = [json.loads(line) for line in log.read_text().splitlines()]
    return {r["text"].split(":")[0] for r in records if r["kind"] == "line"}


def test_a_controller_is_asked_who_it_is_and_nothing_else(tmp_path: Path) -> None:
    clock = Clock()
    with WireLog(tmp_path / "log", clock) as log, Emulator(load_unit("crs97"), clock, log=log) as emulator:
        found = doctordevices.controller_finding(emulator.open_pty())
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
        found = guarded("controller", lambda: doctordevices.controller_finding(port), 20.0, "h")
    assert isinstance(found, Finding)
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


def test_a_silent_line_is_wrong_and_gets_harmless_lines_only(
    silent_port: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    other, port = silent_port
    monkeypatch.setattr(driver.portlink, "LEAST_WALL_S", 0.1)
    monkeypatch.setattr(driver.link.Link.synchronise, "__defaults__", (0.2, 1))
    found = guarded("controller", lambda: doctordevices.controller_finding(port), 20.0, "h")
    assert isinstance(found, Finding)
    assert (found.verdict, found.help) == (WRONG, "h")
    assert "does not answer like a MARS8" in found.found
    lines = os.read(other, 4096).decode().split("\n")
    assert {line.split(":")[0] for line in lines} == {"", "ECHO", "STAMP"}


# -- cameras


def test_cameras_are_listed_and_one_takes_a_photograph(monkeypatch: pytest.MonkeyPatch, scenes: Path) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    listed = doctordevices.cameras_finding()
    assert listed.verdict == OK
    assert "Emulation serial:0815-0000" in listed.found
    assert listed.data["cameras"][0]["serial"] == "0815-0000"
    taken = doctordevices.photograph_finding(SERIAL, None)
    assert taken.verdict == OK
    assert "px; mean grey " in taken.found
    assert taken.data["size_px"][0] > 16
    replace_in(scenes / "cell.toml", "[motion]", f'[look.basler]\ndevice = "{SERIAL}"\n\n[motion]')
    cell = read_cell(scenes / "cell.toml")
    with pytest.raises(CameraError, match="but the camera's calibration is for 1920 x 1200 px"):
        doctordevices.photograph_finding("cell", cell)
    with pytest.raises(CameraError, match="is not there"):
        doctordevices.photograph_finding("serial:1", cell)


def test_no_camera_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "0")
    monkeypatch.setattr("vision.basler_devices.find_devices", lambda pylon: [])
    assert doctordevices.cameras_finding().found == "pylon sees none"
    monkeypatch.setitem(sys.modules, "pypylon", None)
    found = doctordevices.cameras_finding()
    assert (found.verdict, found.help) == (NOTE, "make basler")


# -- the cell and its calibrations


def look_at(file: Path) -> dict[str, Finding]:
    return {f.check: f for f in doctorcell.cell_findings(doctorcell.read_named(file))}


def calibrated(scenes: Path, **others: Any) -> Path:
    """A cell file that names a calibration of ten days ago."""
    camera = read_cell(scenes / "cell.toml").camera
    of = {"unit": "crs93", "lens": camera.lens_digest, "dh": A465.digest} | others
    made = of.pop("made", {"held_out_mm": 0.21, "camera_std_mm": 0.05})
    found = ArmCalibration(camera.T_base_camera, frozen([0.0] * 6), LinkErrors.none(), **of, made=made)
    write_arm_calibration(scenes / "found.toml", found)
    then = time.time() - 10.5 * 86400.0
    os.utime(scenes / "found.toml", (then, then))
    replace_in(scenes / "cell.toml", "[tool]", 'calibration = "found.toml"\n\n[tool]')
    return scenes / "cell.toml"


def test_an_uncalibrated_cell_is_a_note(scenes: Path) -> None:
    found = look_at(scenes / "cell.toml")
    assert [found[name].verdict for name in ("cell", "lens", "hand-eye")] == [OK, NOTE, NOTE]
    assert "the nominal lens of a lab" in found["lens"].found
    assert "a465 calibrate camera" in found["lens"].help
    assert found["hand-eye"].found.startswith("none: the camera stands where lab.toml says")
    assert "a465 calibrate hand-eye" in found["hand-eye"].help


def test_a_calibration_is_told_with_its_age_and_how_certain_it_is(scenes: Path) -> None:
    file = calibrated(scenes)
    found = look_at(file)["hand-eye"]
    calibration = read_cell(file).calibration
    assert calibration is not None
    assert found.verdict == OK
    assert found.data["id"] == calibration.id
    assert found.data["age_days"] == 10
    assert calibration.id in found.found
    assert "(10 days old), of crs93 and this lens: held-out targets 0.21 mm off" in found.found
    assert "camera's place 0.05 mm (one standard deviation)" in found.found


@pytest.mark.parametrize(
    ("others", "verdict", "told"),
    [
        ({"unit": "crs97"}, WRONG, "is of crs97, but unit is crs93"),
        ({"lens": "f" * 64}, WRONG, "rests on another lens"),
        ({"dh": "f" * 64}, WRONG, "other dimensions"),
        ({"lens": ""}, NOTE, "does not say of which lens"),
        ({"lens": "", "dh": ""}, NOTE, "does not say of which lens and arm"),
        ({"made": {"poses": 8}}, NOTE, "does not say how certain it is"),
    ],
)
def test_a_calibration_that_is_not_of_this_cell(
    scenes: Path, others: dict[str, Any], verdict: str, told: str
) -> None:
    file = calibrated(scenes, **others)
    for named in (file, scenes / "task2.toml"):
        found = look_at(named)
        assert found["cell"].verdict == OK
        assert found["hand-eye"].verdict == verdict
        assert told in found["hand-eye"].found
        assert "a465 calibrate hand-eye" in found["hand-eye"].help


def test_a_lens_of_ones_own_is_told_with_its_uncertainty(scenes: Path) -> None:
    file = scenes / "cameras/lab.toml"
    camera = read_camera(file)
    K = camera.K.copy()
    K[0, 0] += 1.0
    own = type(camera)(
        K, camera.distortion, camera.size, camera.T_base_camera, {"id": "lens-1", "work_std_mm": 0.07}
    )
    write_camera(file, own)
    found = look_at(scenes / "cell.toml")["lens"]
    assert (found.verdict, found.data["id"]) == (NOTE, "lens-1")
    assert "does not say how certain" in found.found
    known = type(camera)(K, own.distortion, own.size, own.T_base_camera, own.calibration, np.eye(9))
    write_camera(file, known)
    found = look_at(scenes / "cell.toml")["lens"]
    assert found.verdict == OK
    assert found.found.endswith("(today): 0.07 mm at the work (one standard deviation)")


# -- the self-test sees what is wrong


def test_a_board_that_is_found_elsewhere_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    true = selftest.render
    monkeypatch.setattr(selftest, "render", lambda camera, *rest: np.roll(true(camera, *rest), 2, axis=1))
    found = guarded("look", selftest.look_finding, 60.0, "h")
    assert isinstance(found, Finding)
    assert found.verdict == WRONG
    assert found.data["off_m"] == pytest.approx(2 * 1.13 / 4740, rel=0.1)
    assert "more than 0.1 mm" in found.found


def test_a_plan_that_does_not_hold_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = read_cell(data_file("scenes/cell.toml"))
    slower = cell.unit.limits().scaled(0.01)
    true = selftest.replay
    monkeypatch.setattr(selftest, "replay", lambda plan, scene, unit, limits: true(plan, scene, unit, slower))
    found = guarded("plan", lambda: selftest.motion_finding(cell), 60.0, "h")
    assert isinstance(found, Finding)
    assert found.verdict == WRONG


def test_no_pseudo_terminal_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> tuple[int, int]:
        raise OSError(28, "out of pty devices")

    monkeypatch.setattr(os, "openpty", none)
    cell = read_cell(data_file("scenes/cell.toml"))
    found = guarded("unit", lambda: selftest.unit_finding(cell), 60.0, "is /dev/pts there?")
    assert isinstance(found, Finding)
    assert (found.verdict, found.help) == (WRONG, "is /dev/pts there?")
    assert "out of pty devices" in found.found
