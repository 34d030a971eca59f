"""The echo as checksum: nothing counts as arrived that the unit did not receive, and nothing sound is doubted."""

from __future__ import annotations

import random
import re

import pytest

from driver.line.echo import EchoWatch, Kind, Mismatch, kind_of
from driver.line.splitter import LineSplitter
from emulated.echoing_unit import ENDS, SPLINE, EchoingUnit, answers, feed, motion, session, talk


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("answer_first", [False, True])
def test_a_sound_line_is_verified_to_its_end_and_every_answer_comes_through(
    end: str, answer_first: bool
) -> None:
    for seed in range(30):
        lines = session(random.Random(seed))
        watch, numbers, heard = talk(lines, EchoingUnit(end, answer_first))
        assert watch.mismatch is None
        assert watch.verified == max(numbers)
        assert watch.unechoed_bytes == 0
        assert not watch.unanswered
        assert len(heard) == sum(bool(answers(line)) for line in lines)


@pytest.mark.parametrize("end", ENDS)
def test_a_byte_that_was_put_before_a_motion_is_no_end_of_an_answer(end: str) -> None:
    """The unit ignores such a line; its echo must not count, though an answer came just before it."""
    for seed in range(20):
        rng = random.Random(seed)
        first, second = motion(rng), motion(rng)

        def put(data: bytes, line: str = second, rng: random.Random = rng) -> bytes:
            return data.replace(line.encode(), bytes([rng.choice(b"*J\x08\x02\x0b")]) + line.encode())

        watch, numbers, _ = talk([first, "ST?", second, "STAMP:77"], EchoingUnit(end), there=put)
        assert watch.mismatch is not None
        assert watch.mismatch.sent == second
        assert numbers[watch.verified] in (first, "ST?")


def test_a_command_that_was_never_sent_stops_whatever_comes_next() -> None:
    """Bytes that arrive twice may make a line of their own of two others."""
    for seed in range(20):
        rng = random.Random(seed)
        lines = [motion(rng) for _ in range(6)]
        data = "".join(f"{line}\n" for line in lines).encode()
        ends = [m.end() for m in re.finditer(b"\n", data)]
        at = rng.randrange(ends[1] + 20, ends[2])
        begin = at - rng.randrange(70, 100)
        twice = data[:at] + data[begin:at] + data[at:]
        watch = EchoWatch()
        watch.resume()
        numbers = {watch.sent(line, 0.0): line for line in lines}
        unit = EchoingUnit()
        feed(watch, unit.take(twice))
        assert watch.mismatch is not None, seed
        assert watch.verified < max(numbers)
    watch = EchoWatch()
    watch.resume()
    watch.take("COORDMVT:100,1,2,3,4,5,6,7", 0.0)
    assert watch.mismatch is not None
    assert "was never sent" in watch.mismatch.describe()


def damages(rng: random.Random, data: bytes) -> bytes:
    """One of: a digit changed, a bit flipped, bytes lost, a line lost, cut, doubled, two lines joined."""
    ends = [m.end() for m in re.finditer(rb"\n", data)]
    k = rng.randrange(len(ends) - 1)
    begin, end = (ends[k - 1] if k else 0), ends[k]
    at = rng.randrange(begin, end)
    match rng.randrange(7):
        case 0:
            digits = [i for i in range(begin, end) if data[i : i + 1].isdigit()]
            if not digits:
                return data[:begin] + data[end:]
            i = rng.choice(digits)
            other = rng.choice([d for d in b"0123456789" if d != data[i]])
            return data[:i] + bytes([other]) + data[i + 1 :]
        case 1:
            return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]
        case 2:
            return data[:at] + data[at + rng.randint(1, 300) :]
        case 3:
            return data[:begin] + data[end:]
        case 4:
            return data[:at] + data[end - 1 :]
        case 5:
            return data[:end] + data[begin:]
    return data[: end - 1] + data[end:]


def test_a_motion_counts_as_arrived_only_if_the_unit_obeyed_it_in_its_place() -> None:
    """All that is verified was obeyed, in order, and nothing else was obeyed among it."""
    damaged = noticed = 0
    for seed in range(3000):
        rng = random.Random(seed)
        lines = session(rng)
        unit = EchoingUnit(rng.choice(list(ENDS)), rng.random() < 0.3)
        watch, numbers, _ = talk(lines, unit, there=lambda data, rng=rng: damages(rng, data))  # type: ignore[misc]
        obeyed = [line for line in unit.obeyed if SPLINE.fullmatch(line)]
        sound = [line for n, line in numbers.items() if n <= watch.verified and kind_of(line) is Kind.MOTION]
        assert sound == obeyed[: len(sound)], seed
        meant = [line for line in lines if kind_of(line) is Kind.MOTION]
        if obeyed != meant:
            damaged += 1
            noticed += watch.mismatch is not None or watch.verified < max(numbers)
    assert damaged > 1500
    assert noticed == damaged


def test_a_line_damaged_on_its_way_back_is_not_verified() -> None:
    for seed in range(1000):
        rng = random.Random(seed)
        lines = [motion(rng) for _ in range(5)]
        watch, numbers, _ = talk(lines, EchoingUnit(), back=lambda data, rng=rng: damages(rng, data))  # type: ignore[misc]
        assert watch.mismatch is not None or watch.verified < max(numbers)


def test_damaged_answers_alone_stop_nothing() -> None:
    for seed in range(2000):
        rng = random.Random(seed)

        def spoil(answer: bytes, rng: random.Random = rng) -> bytes:
            if not answer or rng.random() < 0.5:
                return answer
            match rng.randrange(5):
                case 0:
                    return b""
                case 1:
                    at = rng.randrange(len(answer))
                    return answer[:at] + bytes([answer[at] ^ 1 << rng.randrange(8)]) + answer[at + 1 :]
                case 2:
                    return answer[: rng.randrange(len(answer) - 2)] + b"\r\n"
                case 3:
                    return answer.rstrip(b"\r\n")
            return answer * 2

        lines = [*session(rng), motion(rng)]
        watch, numbers, _ = talk(lines, EchoingUnit(spoil=spoil))
        assert watch.mismatch is None, (seed, watch.mismatch)
        assert watch.verified == max(numbers), seed


def test_the_message_shows_what_was_sent_what_came_and_where() -> None:
    lines = ["COORDMVT:60,100,200,300,400,500,600", "COORDMVT:60,101,200,300,400,500,600"]
    watch, _, _ = talk(lines, EchoingUnit(), there=lambda data: data.replace(b"0,300", b"0,900", 1))
    assert watch.mismatch == Mismatch(lines[0], "COORDMVT:60,100,200,900,400,500,600")
    assert watch.mismatch.column == 21
    text = watch.mismatch.describe()
    assert lines[0] in text
    assert "200,900" in text
    assert "column 21" in text


def test_a_line_that_came_twice_is_a_mismatch() -> None:
    line = "COORDSPLINET:100,3," + ",".join(["7"] * 18)
    watch, _, _ = talk([line], EchoingUnit(), there=lambda data: data * 2)
    assert watch.mismatch is not None
    assert "came twice" in watch.mismatch.describe()


def test_an_answer_in_the_middle_of_an_echo_is_taken_out_and_the_echo_still_counts_digit_by_digit() -> None:
    line = "COORDMVT:60,100,200,300,400,500,600"
    for spoiled in (False, True):
        for at in range(1, len(line) + 1):
            watch = EchoWatch()
            watch.resume()
            watch.sent("ST?", 0.0)
            number = watch.sent(line, 0.0)
            back = line.replace("300", "900") if spoiled else line
            heard = feed(watch, f"ST?\n{back[:at]}ST=16\r\n{back[at:]}\n".encode())
            if spoiled:
                assert watch.verified < number
            else:
                assert heard == ["ST=16"]
                assert watch.verified == number
                assert watch.mixed


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("woven", ["S\rT\nAMP=5", "\rS\nTAMP=5", "ST\rAM\nP=5", "STAMP\r=\n5", "S\nTAMP=5"])
def test_an_answer_woven_with_the_end_of_its_questions_echo_is_whole(woven: str, strict: bool) -> None:
    watch = EchoWatch()
    if strict:
        watch.resume()
    watch.sent("STAMP:5", 0.0)
    splitter = LineSplitter(512)
    splitter.take(b"\r\n")  # a unit whose lines end so
    found = splitter.take(f"STAMP:5{woven}\r\n".encode())
    heard = [watch.take(line.text, 0.0, line.torn) for line in found]
    assert [text for text in heard if text] == ["STAMP=5"]
    assert watch.verified == 1
    assert watch.mismatch is None
    assert strict or watch.came("STAMP:5")


def test_the_end_of_a_wait_is_heard_though_it_is_woven_with_the_next_echo() -> None:
    for woven in ("R:\rR\n!\r\nST?\r\nST=0\r\n", "R:R\r!\n\r\nST?S\rT\n=0\r\n"):
        watch, splitter = EchoWatch(), LineSplitter(512)
        splitter.take(b"\r\n")
        watch.resume()
        for line in ("R:", "ST?"):
            watch.sent(line, 0.0)
        heard = [watch.take(line.text, 0.0, line.torn) for line in splitter.take(woven.encode())]
        assert [text for text in heard if text] == ["R!", "ST=0"]
        assert watch.verified == 2


def test_a_motion_line_with_the_beginning_of_an_answer_behind_it_has_not_come_back() -> None:
    line = "COORDMVT:60,1,2,3,4,5,6"
    watch = EchoWatch()
    watch.resume()
    watch.sent("ST?", 0.0)
    number = watch.sent(line, 0.0)
    feed(watch, f"ST?\r\n{line}S\rT\n=0\r\n".encode())
    assert watch.verified < number


def test_two_lines_that_ran_together_are_noticed_though_an_answer_stands_between_them() -> None:
    lines = ["ST?", "COORDMVT:60,1,2,3,4,5,6", "COORDMVT:60,2,2,3,4,5,6"]
    watch = EchoWatch()
    watch.resume()
    for line in lines:
        watch.sent(line, 0.0)
    feed(watch, f"ST?\n{lines[1]}ST=16\r\n{lines[2]}\n".encode())
    assert watch.mismatch is not None
    assert watch.mismatch.sent == lines[1]


def test_a_digit_is_not_explained_by_an_answer_nobody_asked_for() -> None:
    watch = EchoWatch()
    watch.resume()
    number = watch.sent("COORDMVT:60,1,2,3,4,5,6", 0.0)
    feed(watch, b"COORDMST=16\r\nVT:60,1,2,3,4,5,6\n")
    assert watch.verified < number


def test_registers_that_did_not_come_back_are_named_and_the_rest_goes_on() -> None:
    lines = ["REGMSA:7680", "REGMSB:2048", "REGMSC:5120", "STAMP:5"]
    watch, numbers, heard = talk(lines, EchoingUnit(), there=lambda data: data.replace(b"2048", b"2148"))
    assert watch.lost == [Mismatch("REGMSB:2048", "REGMSB:2148")]
    assert watch.mismatch is None
    assert watch.verified == max(numbers)
    assert heard == ["STAMP=5"]


def test_a_damaged_query_is_no_mismatch() -> None:
    lines = ["COORDMVT:60,1,2,3,4,5,6", "ST?", "COORDMVT:60,7,2,3,4,5,6"]
    for there in (
        lambda data: data.replace(b"ST?", b"SD?"),
        lambda data: data.replace(b"ST?\n", b""),
        lambda data: data.replace(b"ST?\n", b"S\n"),
    ):
        watch, numbers, _ = talk(lines, EchoingUnit(), there=there)
        assert watch.mismatch is None
        assert watch.verified == max(numbers)


def test_what_follows_a_damaged_line_by_chance_does_not_condemn_the_next_that_comes_back_whole() -> None:
    motion, register = "COORDMVT:60,1,2,3,4,5,6", "REGMSB:2048"
    for noise in ("R", "REG", "8", "xyz", "\x7f"):  # the beginning or the end of the next line, or of nothing
        watch = EchoWatch()
        watch.resume()
        watch.sent(motion, 0.0)
        watch.sent(register, 0.0)
        feed(watch, f"{motion}{noise}\n{register}\n".encode())
        assert watch.mismatch == Mismatch(motion, motion + noise)
        assert watch.lost == []
        assert watch.unechoed_bytes == 0
    watch = EchoWatch()
    watch.resume()
    watch.sent(motion, 0.0)
    feed(watch, f"{motion}xyz\n".encode())  # and nothing is awaited after it
    assert watch.mismatch == Mismatch(motion, f"{motion}xyz")


def test_a_cut_line_is_told_at_once_where_it_can_be_told_from_an_answer() -> None:
    """Answers share ``COORD`` with motion lines; one character more is a line's own."""
    line = "COORDMVT:60,1,2,3,4,5,6"
    for size in range(1, len(line)):
        watch = EchoWatch()
        watch.resume()
        number = watch.sent(line, 0.0)
        feed(watch, f"{line[:size]}\n".encode())
        assert watch.verified < number
        assert watch.mismatch == (None if line[:size] in "COORD" else Mismatch(line, line[:size]))


def test_an_answer_that_comes_while_nothing_is_judged_is_no_longer_awaited() -> None:
    watch = EchoWatch()
    watch.sent("ST?", 0.0)
    assert watch.unanswered
    assert feed(watch, b"ST?\nST=16\r\n") == ["ST=16"]
    assert not watch.unanswered


def test_a_query_that_ran_into_a_motion_line_is_one() -> None:
    lines = ["ST?", "COORDMVT:60,1,2,3,4,5,6"]
    watch, _, _ = talk(lines, EchoingUnit(), there=lambda data: data.replace(b"ST?\n", b"ST?"))
    assert watch.mismatch is not None
    assert watch.mismatch.sent == lines[1]


def test_after_a_stop_nothing_is_judged_until_all_is_known_to_be_obeyed() -> None:
    watch = EchoWatch()
    watch.resume()
    watch.sent("COORDMVT:60,1,2,3,4,5,6", 0.0)
    feed(watch, b"COORDMVT:60,1,2,3,4,5,9\n")
    assert watch.mismatch is not None
    watch.forget()
    watch.sent("STOP:", 0.0)
    assert feed(watch, b"COORDM\nSTOP:\nSTAMP=4\r\n") == ["COORDM", "STAMP=4"]
    assert (watch.stops, watch.mismatch) == (1, None)


def test_the_round_trip_is_that_of_short_lines_that_did_not_wait() -> None:
    watch = EchoWatch()
    watch.resume()
    for k in range(24):
        line = motion(random.Random(k)) if k % 2 else "ST?"
        watch.sent(line, float(k))
        feed(watch, f"{line}\n".encode(), k + (0.5 if k % 2 else 0.03 + 0.04 * (k % 4 == 2)))
    assert watch.round_trip_s == pytest.approx(0.03)
    for k in range(24, 60):  # the line has become slower
        watch.sent("ST?", float(k))
        feed(watch, b"ST?\n", k + 0.1)
    assert watch.round_trip_s == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("ST?", Kind.QUERY),
        ("APG?", Kind.QUERY),
        ("R:", Kind.QUERY),
        ("RG:", Kind.QUERY),
        ("STAMP:4", Kind.QUERY),
        ("STOP:", Kind.QUERY),
        ("REGMSA:7680", Kind.REGISTER),
        ("COORDGRP:A,B", Kind.REGISTER),
        ("COORDDISCONT:5", Kind.REGISTER),
        ("COORDMV:1,2,3,4,5,6", Kind.MOTION),
        ("HHA:", Kind.MOTION),
        ("GG:103", Kind.MOTION),
        ("RELEASEG:", Kind.MOTION),
        ("SPDTB:0,300", Kind.MOTION),
    ],
)
def test_what_a_damaged_line_means(line: str, kind: Kind) -> None:
    assert kind_of(line) is kind


def test_nothing_is_verified_before_anything_has_come_back() -> None:
    watch = EchoWatch()
    assert watch.verified == 0
    watch.strict = True
    number = watch.sent("COORDMVT:60,1,2,3,4,5,6", 0.0)
    assert watch.verified < number
