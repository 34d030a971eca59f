"""What came back for which line, and how the echo and the answer of a stamp lie in each other."""

from __future__ import annotations

import random

import pytest

from driver.record.exchanges import Exchange, StampForm, exchanges, form_of, heard_in, lines_in
from driver.record.tape import Event


def stamp(text: str, line: str = "STAMP:17") -> Exchange:
    return Exchange("echo on", line, 1.0, ((1.01, text),))


FORMS = {
    "STAMP=17\r\n": StampForm("none", True, "", "CR LF", "", ""),
    "STAMP=17\n": StampForm("none", True, "", "LF", "", ""),
    "STAMP:17\nSTAMP=17\r\n": StampForm("before", True, "LF", "CR LF", "", ""),
    "STAMP:17\rSTAMP=17\r\n": StampForm("before", True, "CR", "CR LF", "", ""),
    "STAMP:17\r\nSTAMP=17\r": StampForm("before", True, "CR LF", "CR", "", ""),
    "STAMP=17\r\nSTAMP:17\n": StampForm("after", True, "LF", "CR LF", "", ""),
    "STAMP:17S\nTAMP=17\r\n": StampForm("interleaved", True, "", "", "", ""),
    "SSTTAAMMPP:=1177\n\r\n": StampForm("interleaved", True, "", "", "", ""),
    "> STAMP=17\r\n": StampForm("none", True, "", "CR LF", ">", ""),
    "STAMP=17\r\nMARS>": StampForm("none", True, "", "CR LF", "MARS>", ""),
    "STAM\nSTAMP=17\r\n": StampForm("odd", True, "", "", "", ""),
    "STAMP:17\nSTAMP:17\nSTAMP=17\r\n": StampForm("odd", True, "", "", "", ""),
    "STAMP:17\n": StampForm("odd", False, "", "", "", ""),
    "STAMP=18\r\n": StampForm("odd", False, "", "", "", ""),
    "": StampForm("none", False, "", "", "", ""),
}


@pytest.mark.parametrize("text", FORMS)
def test_the_form_of_an_answer_to_a_stamp(text: str) -> None:
    found = form_of(stamp(text))
    assert (found.echo, found.answered, found.echo_end, found.answer_end, found.prompt) == (
        FORMS[text].echo,
        FORMS[text].answered,
        FORMS[text].echo_end,
        FORMS[text].answer_end,
        FORMS[text].prompt,
    )
    assert found.text == text


@pytest.mark.parametrize("seed", range(50))
def test_every_way_of_interleaving_is_seen_and_no_other(seed: int) -> None:
    rng = random.Random(seed)
    number = rng.randrange(32768)
    line, answer = f"STAMP:{number}", f"STAMP={number}"
    left, mixed = [list(line), list(answer)], ""
    while any(left):
        mixed += rng.choice([part for part in left if part]).pop(0)
    forms = (
        {"interleaved"} if mixed not in (line + answer, answer + line) else {"interleaved", "before", "after"}
    )
    assert form_of(stamp(mixed + "\r\n", line)).echo in forms
    at = rng.randrange(len(mixed))
    spoilt = mixed[:at] + "#" + mixed[at + 1 :]
    assert form_of(stamp(spoilt + "\r\n", line)).echo != "interleaved"
    assert form_of(stamp(mixed[:at] + mixed[at + 1 :] + "\r\n", line)).echo != "interleaved"


def test_what_came_belongs_to_the_line_before_it_in_its_step() -> None:
    events = (
        Event(0.0, "step", "one"),
        Event(0.1, "received", "noise"),
        Event(0.2, "sent", "VER?\n"),
        Event(0.3, "received", "VER="),
        Event(0.4, "received", "MARS8 x\r\nAPA=3\r\n"),
        Event(0.5, "sent", "\n"),
        Event(0.6, "step", "two"),
        Event(0.7, "sent", "STAMP:4\n"),
        Event(0.8, "received", "STAM"),
        Event(0.9, "received", "P=4"),
        Event(1.0, "received", "\r\n"),
    )
    found = exchanges(events)
    assert [(e.step, e.line, e.text, e.answer) for e in found] == [
        ("one", "VER?", "VER=MARS8 x\r\nAPA=3\r\n", "MARS8 x"),
        ("one", "", "", None),
        ("two", "STAMP:4", "STAMP=4\r\n", "4"),
    ]
    assert found[2].answered_s() == pytest.approx(0.3)
    assert found[0].answered_s() is None
    assert heard_in(events, "two") == [(0.8, "STAM"), (0.9, "P=4"), (1.0, "\r\n")]
    assert lines_in(events, "one") == [(0.4, "noiseVER=MARS8 x"), (0.4, "APA=3")]
