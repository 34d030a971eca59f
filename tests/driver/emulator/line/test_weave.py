"""A byte echo: the bytes that arrive and the answers share one line to the host."""

from __future__ import annotations

import random

import pytest

from driver.emulator.line.weave import BYTES_PER_MS, Weave

ARRIVED, ANSWERED = b"abcdefghijkl", b"ABCDEFGH"


@pytest.mark.parametrize(
    ("mixed", "sent"), [(True, b"aAbBcCdDeEfFgGhHijkl"), (False, b"aABCDEFGHbcdefghijkl")]
)
def test_bytes_alternate_or_an_answer_stays_whole(mixed: bool, sent: bytes) -> None:
    weave = Weave(mixed, lambda: True, b"\r\n")
    for i, byte in enumerate(ARRIVED):
        weave.arrives(i / BYTES_PER_MS, byte)
    weave.answer(0.1, ANSWERED)
    assert weave.take(1e3) == sent


@pytest.mark.parametrize("mixed", [True, False])
def test_whenever_it_is_asked_bytes_keep_their_order_and_take_their_time(mixed: bool) -> None:
    rng = random.Random(7)
    for _ in range(50):
        weave, got, now = Weave(mixed, lambda: True, b"\r\n"), b"", 0.0
        for i, byte in enumerate(ARRIVED):
            weave.arrives(i / BYTES_PER_MS, byte)
        weave.answer(rng.uniform(0.0, 8.0), ANSWERED)
        while (due := weave.next_at()) is not None:
            now = max(now, due) + rng.choice([0.0, 0.0, 1.3])
            got += weave.take(now)
            assert len(got) <= now * BYTES_PER_MS + 1e-9
        assert bytes(b for b in got if b in ARRIVED) == ARRIVED
        assert bytes(b for b in got if b in ANSWERED) == ANSWERED


def test_an_echo_that_is_off_or_forgotten_says_nothing_and_line_feeds_end_as_told() -> None:
    echoes = False
    weave = Weave(True, lambda: echoes, b"\r\n")
    weave.arrives(0.0, ord("x"))
    assert weave.take(1e3) == b""
    echoes = True
    weave.arrives(1e3, ord("\n"))
    assert weave.take(2e3) == b"\r\n"
    weave.arrives(2e3, ord("y"))
    weave.answer(2e3, b"z")
    weave.forget()
    assert weave.next_at() is None
    assert weave.take(3e3) == b""
