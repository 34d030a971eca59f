"""What the commands beside the arm share: low speeds, questions, and what surrounds the arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from arm.controller.unit import load_unit
from arm.errors import InputError
from cell.commands.manual.gripper import gripper_step
from cell.commands.manual.home import home_step
from cell.commands.manual.move import Goal, move_step
from cell.commands.manual.park import park_step
from cell.commands.manual.session import SPEED, holds_cube, manual_speed, require_consent, require_person
from cell.config.cell import Cell
from cell.files.task import read_place
from cell.session.connection import NoImages, WhichCell, require_openable
from emulated.stepped_cell import names_sent, stepped_cell
from typed.heard import Heard

from .conftest import CELL

AT = (10.0, -20.0, -60.0, 0.0, -70.0, 0.0)  # deg


def test_the_speed_is_low_unless_somebody_wants_another(here: Cell) -> None:
    assert manual_speed(here, None) == SPEED < here.speed
    assert manual_speed(replace(here, speed=0.05), None) == 0.05
    assert manual_speed(here, 0.7) == 0.7
    with pytest.raises(InputError, match="--speed 2: must be from"):
        manual_speed(here, 2.0)


def test_nobody_can_be_asked_without_a_terminal() -> None:
    require_person(True, "--free", "that the cell is clear", "/dev/none-such")
    with pytest.raises(
        InputError, match="no terminal to confirm that the cell is clear: give --free"
    ) as refused:
        require_person(False, "--free", "that the cell is clear", None)
    assert refused.value.data["option"] == "--free"
    with pytest.raises(InputError, match=r"port /dev/none-such: is not there; is the cable plugged in"):
        require_person(False, "--free", "that the cell is clear", "/dev/none-such")


def test_only_the_word_is_consent(answers: Callable[..., None]) -> None:
    said = iter(["no", "CRS93"])
    answers(lambda: next(said))
    require_consent(True, "--unseen", Heard(), "type crs93:", "crs93")
    console = Heard()
    require_consent(False, "--unseen", console, "type crs93:", "crs93")
    assert console.told.count("type crs93:") == 2
    answers(lambda: None)
    with pytest.raises(InputError, match="'crs93' was not typed; nothing moved"):
        require_consent(False, "--unseen", Heard(), "type crs93:", "crs93")


def test_jaws_at_the_width_of_a_cube_may_hold_one(here: Cell) -> None:
    held = [holds_cube(here, 1e-3 * mm) for mm in (30.0, 38.0, 40.0, 42.0, 60.0)]
    assert held == [False, True, True, True, False]
    assert not holds_cube(here, None)


def test_a_cell_without_a_camera_opens_and_has_no_images() -> None:
    task = read_place(CELL)
    require_openable(task, WhichCell("/dev/mars", blind=True))
    with pytest.raises(InputError, match="--port needs a camera"):
        require_openable(task, WhichCell("/dev/mars"))
    with pytest.raises(InputError, match="this command opens no camera"):
        NoImages().grab(3)


@pytest.mark.parametrize(
    "verb",
    [
        lambda: home_step(CELL, "/dev/mars", 1.0, False, Heard()),
        lambda: park_step(CELL, "/dev/mars", None, None, False, Heard()),
        lambda: gripper_step("open", CELL, "/dev/mars", False, Heard()),
        lambda: move_step(Goal("by", (0.0, 0.0, 10.0)), CELL, "/dev/mars", None, None, False, Heard()),
    ],
    ids=["home", "park", "gripper", "move"],
)
def test_nobody_is_asked_about_another_arm(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None], verb: Callable[[], object]
) -> None:
    answers(lambda: pytest.fail("asked"))
    with stepped_cell(replace(here, nominal_unit=load_unit("crs97")), monkeypatch, AT) as emulator:
        with pytest.raises(
            InputError, match="unit = crs93: its gripper is on axis G, but this arm has it on axis H"
        ):
            verb()
        assert set(names_sent(emulator)) <= {"ECHO", "STAMP", "VER?", "ST?", "APG?", "APH?"}
