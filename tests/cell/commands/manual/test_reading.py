"""What is told of an arm's state, and what is left open when it is not known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import load_unit
from cell.commands.manual.reading import Reading, _unit_with_gripper_on, print_reading, read_arm
from cell.doctor.devices import FIRMWARE
from driver.line.protocol import ARM_POWER_OFF, AXIS_ERROR, BUSY, Status
from driver.mars.identity import identified
from emulated.on_pty import lines_to, on_pty
from emulated.stepped_cell import push_to
from typed.heard import Heard

UNIT = load_unit("crs93")
AT = tuple(int(c) for c in UNIT.counts(np.radians([10, 20, -30, 0, 40, 0])))


def _told(reading: Reading) -> str:
    console = Heard()
    print_reading(reading.to_json(), console)
    return console.all


def test_nothing_is_said_of_what_is_not_known() -> None:
    state = Reading(None, None).to_json()
    assert {key for key, value in state.items() if value not in (None, [], False)} == set()
    assert _told(Reading(None, None)) == "position: not known"


def test_counters_without_a_unit_are_no_angles() -> None:
    reading = Reading(Status(0), AT)
    assert reading.to_json()["q_deg"] is None
    assert f"counters: {', '.join(map(str, AT))}; angles need --cell CELL" in _told(reading)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        (0, "arm power on, motion stop not pressed, no axis in error, at rest"),
        (ARM_POWER_OFF, "arm power OFF"),
        (AXIS_ERROR, "an axis is in ERROR"),
        (BUSY, "MOVING"),
    ],
)
def test_each_bit_of_the_status_has_its_words(word: int, said: str) -> None:
    reading = Reading(Status(word), AT, unit=UNIT, unit_by="cell file")
    assert said in _told(reading)
    assert "J1 to J6: 10.00, 20.00, -30.00, 0.00, 40.00, 0.00 deg" in _told(reading)


def test_an_arm_whose_counters_change_moves(tmp_path: Path) -> None:
    log = tmp_path / "unit.jsonl"
    with (
        on_pty(UNIT, log, homed_deg=(0, 0, -45, 0, -45, 0)) as (emulator, port),
        identified(port, FIRMWARE) as (link, _),
    ):
        assert not read_arm(link).moving
        emulator.machine.run_axis("A", 5.0)
        assert read_arm(link).to_json()["moving"] is True
    assert not any(line.startswith(("STOP", "PURGE")) for line in lines_to(log))


def test_an_arm_that_is_pushed_moves_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing generates motion then, so the status does not tell."""
    with (
        on_pty(UNIT, tmp_path / "unit.jsonl", homed_deg=(0, 0, -45, 0, -45, 0)) as (emulator, port),
        identified(port, FIRMWARE) as (link, _),
    ):
        monkeypatch.setattr(link, "wait", lambda _: push_to(emulator, np.add(emulator.counts(), 10)))
        reading = read_arm(link)
    assert reading.status is not None
    assert not reading.status.busy
    assert reading.to_json()["moving"] is True


def test_a_unit_whose_gripper_does_not_answer_is_not_guessed() -> None:
    assert _unit_with_gripper_on(None) is None
    found = [_unit_with_gripper_on(axis) for axis in "GH"]
    assert [unit and unit.name for unit in found] == ["crs93", "crs97"]
