"""What a link is connected to is found out before anything is sent that moves or sets."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import InputError
from driver.emulator import Emulator
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from driver.mars.identity import gripper_answers, refuse_another
from driver.mars.mars import Mars


@pytest.mark.parametrize("version", ["LX_ROCON v2", "MARS81 x", "", "mars8"])
def test_another_controller_is_refused_untouched(fake: Any, unit: Unit, clock: Clock, version: str) -> None:
    fake.hooks["VER"] = lambda line: [f"VER={version}"]
    with Mars(fake.line, unit, clock) as mars, pytest.raises(InputError, match="is not MARS8"):
        mars.identify()
    assert {line.split(":")[0] for line in fake.lines} <= {"", "ECHO", "STAMP", "VER?"}


def test_something_that_only_echoes_is_refused(fake: Any, unit: Unit, clock: Clock) -> None:
    for name in ("STAMP", "VER", "ECHO"):
        fake.hooks[name] = lambda line: [line]
    with (
        Mars(fake.line, unit, clock) as mars,
        pytest.raises(InputError, match="does not answer like a MARS8"),
    ):
        mars.identify()
    assert {line.split(":")[0] for line in fake.lines} <= {"", "ECHO", "STAMP"}


def test_power_up_noise_does_not_hide_the_unit(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.echo = False  # an echoed line end would separate the noise from the answer
    fake.write(b"\xff\x00\x80MARS")  # half a line of noise that spoils the first answer
    with Mars(fake.line, unit, clock) as mars:
        assert mars.identify().startswith("MARS8 v1.0")


def test_nothing_moves_before_identify(fake: Any, unit: Unit, clock: Clock) -> None:
    with Mars(fake.line, unit, clock) as mars, pytest.raises(InputError, match=r"call identify\(\) first"):
        mars.initialise()
    assert fake.lines == []


@pytest.mark.parametrize("name", ["crs93", "crs97"])
def test_another_units_gripper_axis_is_refused_before_anything_is_set(name: str) -> None:
    """Both ways round: the emulated unit is one arm, the cell file says the other."""
    clock = SteppedClock()
    is_there, said = load_unit(name), load_unit("crs97" if name == "crs93" else "crs93")
    with Emulator(is_there, clock) as emulator, Mars(emulator.open_line(), said, clock) as mars:
        mars.identify()
        with pytest.raises(InputError, match=f"unit = {said.name}") as refused:
            mars.initialise()
        assert refused.value.exit_code == 2
        assert refused.value.data["answers"][said.gripper.axis] == "0"
        assert f"AP{is_there.gripper.axis} = " in str(refused.value)
        set_or_moved = ("REG", "HH", "COORD", "PURGE", "SPDT", "ANAX", "STOP")
        assert not [line for _, line in emulator.lines if line.startswith(set_or_moved)]
        with pytest.raises(InputError, match="this is another arm"):
            mars.initialise(home=False)


@pytest.mark.parametrize("silent", [[], ["AP{}=0"], ["FAIL!"]])
@pytest.mark.parametrize("answered", [(), ("G", "H"), ("G",)])
def test_which_gripper_axis_answers_is_never_proof(
    fake: Any, unit: Unit, answered: tuple[str, ...], silent: list[str]
) -> None:
    """No answer, or both, or the right one: it goes on as it would, and the log has what was answered."""
    for axis in "GH":
        said = [f"AP{axis}=840"] if axis in answered else [text.format(axis) for text in silent]
        fake.hooks[f"AP{axis}"] = lambda line, said=said: said
    told: list[dict[str, Any]] = []
    with Mars(fake.line, unit, fake.clock) as mars:
        mars.identify()
        mars.note = lambda kind, **data: told.append({"kind": kind, **data})  # type: ignore[method-assign]
        answers = gripper_answers(mars.link)
        refuse_another(unit, answers)
        assert {axis for axis, text in answers.items() if text == "840"} == set(answered)
        mars.initialise()
    (whose,) = [note for note in told if note["kind"] == "whose_arm"]
    assert whose["gripper_axes"] == answers
    assert whose["unit"] == unit.name


@pytest.mark.parametrize("text", ["840", "-840", " 1001 "])
def test_any_whole_number_but_nought_is_a_gripper(unit: Unit, text: str) -> None:
    own = unit.gripper.axis
    (other,) = {"G", "H"} - {own}
    for nothing in ("0", "-0", None, "FAIL!", ""):
        with pytest.raises(InputError, match="this is another arm"):
            refuse_another(unit, {own: nothing, other: text})
        refuse_another(unit, {own: text, other: nothing})
        refuse_another(unit, {own: nothing, other: nothing})
    refuse_another(unit, {own: text, other: text})
