"""From where the arm is to q_start: certified, seen, and what was seen is what is sent."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.plan_file import read_plan
from cell.commands.manual.park import park_step
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from emulated.on_pty import lines_to, on_pty
from emulated.stepped_cell import names_sent, push_to, stepped_cell
from typed.command_line import a465
from typed.heard import Heard

from .conftest import CELL

QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}
NEAR_START = (-57.0, -40.0, -80.0, 0.0, -60.0, 5.0)


def _code() -> str:
    found = re.search(r'"code": ?"(\w{4}-\w{4})"', Path("runs/park-1/preview.html").read_text())
    assert found is not None
    return found[1]


def test_the_code_of_the_preview_lets_the_arm_go(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    console, asked = Heard(), []
    with stepped_cell(here, monkeypatch, NEAR_START) as emulator:

        def answer() -> str:
            asked.append((console.all, set(names_sent(emulator))))
            return _code()

        answers(answer)
        report = park_step(CELL, "/dev/mars", None, None, False, console)
        np.testing.assert_array_equal(emulator.counts(), here.unit.counts(here.q_start))
        assert emulator.violations == ()
        assert not any(name.startswith("HH") for name in names_sent(emulator))
    ((told, sent),) = asked
    assert "type the code shown by the preview of this plan" in told
    assert "before the plan, the arm moves" not in told
    assert sent <= QUERIES
    plan = read_plan(Path("runs/park-1/plan.json"))
    assert all(move.certified for move in plan.moves)
    assert plan.speed == 0.2
    assert plan.start == tuple(here.unit.counts(np.radians(NEAR_START)))
    np.testing.assert_allclose(report["q_deg"], np.degrees(here.q_start), atol=0.01)


def test_without_the_code_the_unit_gets_queries_only(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    answers(lambda: "AAAA-AAAA")
    with stepped_cell(here, monkeypatch, NEAR_START) as emulator:
        with pytest.raises(InputError, match="was not confirmed with the code of its preview; nothing moved"):
            park_step(CELL, "/dev/mars", None, None, False, Heard())
        assert set(names_sent(emulator)) <= QUERIES


def test_an_arm_that_was_moved_meanwhile_does_not_go(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    with stepped_cell(here, monkeypatch, NEAR_START) as emulator:

        def answer() -> str:
            push_to(emulator, here.unit.counts(np.radians((-50.0, *NEAR_START[1:]))))
            return _code()

        answers(answer)
        with pytest.raises(ImpossibleError, match="the arm is not at the start"):
            park_step(CELL, "/dev/mars", None, None, False, Heard())
        assert not any(name.startswith("COORDSPLINE") for name in names_sent(emulator))


def test_an_arm_that_is_there_stays(here: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    console = Heard()
    with stepped_cell(here, monkeypatch, np.degrees(here.q_start)) as emulator:
        park_step(CELL, "/dev/mars", None, None, True, console)
        assert set(names_sent(emulator)) <= QUERIES
    assert "the arm is at q_start already" in console.all


def test_a_unit_that_was_not_homed_is_refused(here: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    with stepped_cell(here, monkeypatch) as emulator:
        with pytest.raises(ImpossibleError, match="the unit must be homed"):
            park_step(CELL, "/dev/mars", None, None, True, Heard())
        assert set(names_sent(emulator)) <= QUERIES


def test_an_arm_in_the_zone_needs_a_look(here: Cell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    in_the_zone, look = (0.0, -40.0, -90.0, 0.0, -50.0, 0.0), tmp_path / "look.json"
    look.write_text('{"scenes": [{"boards": []}]}')
    with stepped_cell(here, monkeypatch, in_the_zone) as emulator:
        with pytest.raises(ImpossibleError, match="with --look FILE only the boards that were seen do"):
            park_step(CELL, "/dev/mars", None, None, True, Heard())
        assert set(names_sent(emulator)) <= QUERIES
        park_step(CELL, "/dev/mars", look, 1.0, True, Heard())
        np.testing.assert_array_equal(emulator.counts(), here.unit.counts(here.q_start))


def test_jaws_that_may_hold_a_cube_are_refused_and_others_are_told(
    here: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    gripper, axis = here.gripper, here.unit.gripper
    with stepped_cell(here, monkeypatch, NEAR_START) as emulator:
        emulator.machine.jaws.slip(axis.adc(gripper.fraction_closed(here.cube_size)))
        with pytest.raises(ImpossibleError, match="as on a cube"):
            park_step(CELL, "/dev/mars", None, None, True, Heard())
        assert set(names_sent(emulator)) <= QUERIES
        emulator.machine.jaws.slip(axis.adc(gripper.fraction_closed(0.02)))
        console = Heard()
        park_step(CELL, "/dev/mars", None, None, True, console)
        assert "planned for any opening" in console.all
        np.testing.assert_array_equal(emulator.counts(), here.unit.counts(here.q_start))


def test_an_arm_that_is_too_near_is_sent_to_the_steps_that_lead_away(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (scenes / "cell.toml").read_text()
    (scenes / "cell.toml").write_text(re.sub(r"(?m)^clearance_mm = 10\b", "clearance_mm = 48", text))
    wide = read_cell(scenes / "cell.toml")
    assert wide.clearance == 0.048
    with (
        stepped_cell(wide, monkeypatch, NEAR_START),
        pytest.raises(
            ImpossibleError, match=r"is itself too near: .*; the steps of a465 jog lead the two apart"
        ),
    ):
        park_step(scenes / "cell.toml", "/dev/mars", None, None, True, Heard())


def test_the_errors_of_the_arm_count_with_half_open_jaws(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = scenes / "realistic/cell.toml"
    here = read_cell(place)
    assert here.calibration is not None
    text = place.read_text()
    place.write_text(text + "\n[accuracy]\nleast_clearance_mm = 50\n")
    strict = read_cell(place)
    assert strict.erring_clearance == pytest.approx(0.05)
    with stepped_cell(here, monkeypatch, NEAR_START) as emulator:
        emulator.machine.jaws.slip(here.unit.gripper.adc(here.gripper.fraction_closed(0.02)))
        with pytest.raises(ImpossibleError, match="for all errors of the arm within"):
            park_step(place, "/dev/mars", None, None, True, Heard())
        assert set(names_sent(emulator)) <= QUERIES


@pytest.mark.slow
def test_over_a_port(here: Cell, tmp_path: Path) -> None:
    log = tmp_path / "unit.jsonl"
    with on_pty(here.unit, log, 1.0, homed_deg=NEAR_START) as (emulator, port):
        a465("park", CELL, port, "--unseen", "--json")
        np.testing.assert_array_equal(emulator.counts(), here.unit.counts(here.q_start))
    assert any(line.startswith("COORDSPLINET:") for line in lines_to(log))


def test_nobody_to_ask_is_refused_before_a_port_is_opened(tmp_path: Path) -> None:
    _, told = a465("park", CELL, "/dev/null", code=2)
    assert "no terminal to confirm that the arm may move: give --unseen" in told
    assert list(tmp_path.iterdir()) == []
