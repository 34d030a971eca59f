"""``a465 doctor``: every check tells what is there, with a figure; nothing hangs, nothing raises, nothing moves."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.doctor.doctor import wrong_in
from cell.doctor.finding import NOTE, OK, WRONG
from pictures.cameras import SERIAL
from timed.relative import cost_s, interpreted
from typed.command_line import a465, replace_in

pytestmark = pytest.mark.xdist_group("doctor")

CHECKS = [
    "Python", "libraries", "extra mcap", "extra contact", "extra basler", "serial ports", "cell", "arm's shape", "lens",
    "hand-eye", "camera's watch", "cameras", "self-test: plan", "self-test: look", "self-test: unit",
]  # fmt: skip


def by_name(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {check["check"]: check for check in report["checks"]}


@pytest.mark.slow
def test_a_good_installation_is_told_in_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    ran = []
    cost = cost_s(lambda: ran.append(a465("doctor", "--camera", SERIAL, "--json", cwd=tmp_path)))
    assert cost < 1000.0 * cost_s(interpreted)
    ((said, told),) = ran
    report = json.loads(said)
    assert report["wrong"] == []
    assert report["verdict"] in (OK, NOTE)
    checks = by_name(report)
    names = [*CHECKS[:-3], "photograph", *CHECKS[-3:]]
    assert list(checks) == names
    assert checks["photograph"]["verdict"] == OK  # of any size: no cell was given
    assert all(checks[name]["verdict"] == OK for name in ("Python", "libraries", "cell", *CHECKS[-3:]))
    assert checks["libraries"]["data"]["versions"]["numpy"] == np.__version__
    assert checks["cell"]["found"].startswith("the built-in scene is valid: crs93, 6 boards")
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


@pytest.mark.slow
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
    assert (
        "needs --cell FILE whose [look.basler] or [look.video] names a device"
        in checks["photograph"]["found"]
    )
    assert all(checks[name]["help"] for name in report["wrong"])
    wrong = "a465: doctor: wrong: controller, photograph, self-test: plan; controller: "
    assert told.splitlines()[-1].startswith(wrong)
    assert checks["cell"]["found"].startswith(f"{scenes / 'task2.toml'} is valid: crs93")
    table = told.splitlines()
    start = next(i for i, line in enumerate(table) if line.startswith("self-test: plan"))
    assert "wrong" in table[start]
    assert any(line.strip().startswith("-> q_start_deg") for line in table[start:])


@pytest.mark.slow
@pytest.mark.parametrize("missing", [["numpy"], ["serial", "pypylon", "ruckig", "cv2"]], ids=lambda m: m[0])
def test_missing_libraries_are_rows_and_no_traceback(missing: list[str]) -> None:
    code = (
        f"import sys\nfor name in {missing!r}: sys.modules[name] = None\n"
        "sys.argv = ['a465', 'doctor', '--port', '/dev/nowhere', '--camera', 'cell', '--json']\n"
        "from cell.cli.start import main\nmain()"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=False
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


@pytest.mark.slow
def test_a_cell_that_cannot_be_read_is_wrong_and_the_rest_goes_on(tmp_path: Path) -> None:
    said, _ = a465("doctor", "--cell", tmp_path / "none.toml", "--json", code=3)
    report = json.loads(said)
    assert report["wrong"] == ["cell"]
    assert "none.toml: cannot be read: No such file" in by_name(report)["cell"]["found"]
    assert by_name(report)["self-test: plan"]["verdict"] == OK


@pytest.mark.slow
def test_a_checklist_that_needs_a_missing_library_is_a_row(scenes: Path) -> None:
    code = (
        "import sys\nsys.modules['serial'] = None\n"
        f"sys.argv = ['a465', 'doctor', '--cell', {str(scenes / 'cell.toml')!r}, '--json']\n"
        "from cell.cli.start import main\nmain()"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=False
    )
    assert (ran.returncode, "Traceback" in ran.stderr) == (3, False), ran.stderr
    found = by_name(json.loads(ran.stdout))["checklist"]
    assert found["verdict"] == WRONG
    assert "import of serial halted" in found["found"]


def test_what_is_wrong_is_told_in_the_last_line_with_its_cause() -> None:
    found = ("lens", "old"), ("cell", "no.toml: is not there"), ("arm", "x")
    checks = [{"check": check, "found": what} for check, what in found]
    told = wrong_in({"wrong": ["cell", "arm"], "checks": checks})
    assert told == "doctor: wrong: cell, arm; cell: no.toml: is not there"
