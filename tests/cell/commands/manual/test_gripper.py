"""The jaws move once a person has agreed, and nothing else does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.robot.gripper import Gripper
from cell.commands.manual.gripper import gripper_step, target_width
from cell.config.cell import Cell
from cell.session.keyboard import ABORT_HELP
from driver.mars.gripper import GripperResult
from driver.mars.mars import Mars
from emulated.on_pty import lines_to, on_pty
from emulated.stepped_cell import names_sent, stepped_cell
from programs.tool_cells import tool_cell
from typed.command_line import a465
from typed.heard import Heard

from .conftest import CELL

AT = (10.0, -20.0, -60.0, 5.0, -60.0, 0.0)
QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}
MOTION = ("COORDMV", "COORDSPLINET", "HH", "GA", "GB", "GC", "GD", "GE", "GF")


def _wide(emulator: object, here: Cell) -> float:
    return 1e3 * here.gripper.width(here.unit.gripper.fraction_closed(emulator.machine.jaws.adc))  # type: ignore[attr-defined]


@pytest.mark.parametrize(("action", "mm"), [("close", 0.0), ("45", 45.0), ("12.5", 12.5), ("open", 60.0)])
def test_the_jaws_go_where_they_are_asked_to_and_no_joint_does(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None], action: str, mm: float
) -> None:
    console, asked = Heard(), []
    with stepped_cell(here, monkeypatch, AT) as emulator:

        def answer() -> str:
            asked.append((console.all, set(names_sent(emulator))))
            return "CRS93"

        answers(answer)
        report = gripper_step(action, CELL, "/dev/mars", False, console)
        assert _wide(emulator, here) == pytest.approx(mm, abs=0.1)
        assert report["jaws_mm"] == pytest.approx(mm, abs=0.1)
        np.testing.assert_array_equal(emulator.counts(), here.unit.counts(np.radians(AT)))
        assert not any(name.startswith(MOTION) for name in names_sent(emulator))
    ((told, sent),) = asked
    assert f"to {mm:.1f} mm" in told
    assert "type crs93 to let them move:" in told
    assert sent <= QUERIES


def test_without_the_name_the_unit_gets_queries_only(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    answers(lambda: "yes")
    with stepped_cell(here, monkeypatch, AT) as emulator:
        with pytest.raises(InputError, match="'crs93' was not typed; nothing moved"):
            gripper_step("close", CELL, "/dev/mars", False, Heard())
        assert set(names_sent(emulator)) <= QUERIES


@pytest.mark.parametrize(("action", "warned"), [("open", True), ("close", False)])
def test_who_opens_jaws_that_may_hold_a_cube_is_warned(
    here: Cell, monkeypatch: pytest.MonkeyPatch, action: str, warned: bool
) -> None:
    console = Heard()
    with stepped_cell(here, monkeypatch, AT) as emulator:
        emulator.machine.jaws.slip(here.unit.gripper.adc(here.gripper.fraction_closed(here.cube_size)))
        gripper_step(action, CELL, "/dev/mars", True, console)
    assert ("what they hold drops" in console.all) is warned


def test_jaws_that_do_not_open_stop_and_jaws_on_something_are_told(
    here: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Mars, "gripper", lambda *_: GripperResult(500, 0.5, stalled=True))
    with stepped_cell(here, monkeypatch, AT) as emulator:
        emulator.machine.jaws.slip(here.unit.gripper.closed_adc)
        with pytest.raises(ExecutionStopped, match="0 mm apart and do not open: something blocks them"):
            gripper_step("open", CELL, "/dev/mars", True, Heard())
        emulator.machine.jaws.slip(here.unit.gripper.closed_adc)
        with pytest.raises(ExecutionStopped, match=r"30\.0 mm apart and do not open"):
            gripper_step(
                "45", CELL, "/dev/mars", True, Heard()
            )  # less than open, and still further than they were
        emulator.machine.jaws.slip(here.unit.gripper.open_adc)
        console = Heard()
        assert gripper_step("close", CELL, "/dev/mars", True, console)["stalled"] is True
        assert "30.0 mm apart: something is between them" in console.all


def test_while_the_jaws_move_a_key_aborts(
    here: Cell, monkeypatch: pytest.MonkeyPatch, abortable: list[str]
) -> None:
    console, during = Heard(), []

    def moves(*_: object) -> GripperResult:
        during.extend(abortable)
        return GripperResult(500, 0.5, stalled=False)

    monkeypatch.setattr(Mars, "gripper", moves)
    with stepped_cell(here, monkeypatch, AT):
        gripper_step("close", CELL, "/dev/mars", True, console)
    assert during == ["aborts"]
    assert ABORT_HELP in console.all


def test_a_unit_that_was_not_homed_is_refused(here: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    with stepped_cell(here, monkeypatch) as emulator:
        with pytest.raises(ImpossibleError, match="the unit must be homed"):
            gripper_step("open", CELL, "/dev/mars", True, Heard())
        assert set(names_sent(emulator)) <= QUERIES


def test_a_width_is_in_the_stroke() -> None:
    gripper = Gripper(opening=0.06, shut=0.002)
    assert target_width("open", gripper) == 0.06
    assert target_width("close", gripper) == 0.002
    assert target_width("2", gripper) == 0.002
    for wrong in ("1.9", "60.1", "nan", "inf", "-3", "shut", ""):
        with pytest.raises(InputError, match="must be open, close, or a width from 2 to 60 mm"):
            target_width(wrong, gripper)


def test_a_width_in_metres_is_refused(here: Cell) -> None:
    for wrong in ("0.04", "0.001", "0.999"):
        with pytest.raises(
            InputError, match=rf"gripper {wrong}: must be 0, or 1 mm or more; the number is mm"
        ):
            target_width(wrong, here.gripper)
    assert [target_width(right, here.gripper) for right in ("0", "1")] == [0.0, 0.001]


def test_a_tool_without_jaws_has_none_to_move(tmp_path: Path) -> None:
    _, told = a465("gripper", "open", tool_cell(tmp_path), "/dev/none-such", "--unseen", code=2)
    assert "the tool of this cell has no jaws" in told


def test_over_a_port(here: Cell, tmp_path: Path) -> None:
    log = tmp_path / "unit.jsonl"
    with on_pty(here.unit, log, 10.0, homed_deg=AT) as (emulator, port):
        a465("gripper", "close", CELL, port, "--unseen")
        assert _wide(emulator, here) < 0.1
    assert any(line.startswith("GG:") for line in lines_to(log))
    assert (
        "no terminal to confirm that the jaws may move"
        in a465("gripper", "open", CELL, "/dev/null", code=2)[1]
    )
