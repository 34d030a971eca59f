"""Received bytes to lines: the same however the bytes come in pieces, and an end that lost a half is told."""

from __future__ import annotations

import random

import pytest

from driver.line.splitter import LineSplitter, Received


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_lines_do_not_depend_on_the_pieces(end: bytes) -> None:
    lines = ["ST=16", "", "COORDAP=1,2", "A"]
    data = b"".join(line.encode() + end for line in lines)
    for seed in range(50):
        rng, splitter, found = random.Random(seed), LineSplitter(64), []
        rest = data
        while rest:
            size = rng.randint(1, 5)
            found += splitter.take(rest[:size])
            rest = rest[size:]
        assert found == [Received(line, False) for line in lines]


def test_a_line_whose_end_lost_its_second_half_is_told_by_the_next() -> None:
    splitter = LineSplitter(64)
    found = [*splitter.take(b"a\r\nb\r"), *splitter.take(b"c\r\nd\r"), *splitter.take(b"\ne\r\n")]
    assert [(line.text, line.torn) for line in found] == [
        ("a", False), ("b", False), ("c", True), ("d", False), ("e", False)
    ]  # fmt: skip


def test_an_endless_line_is_not_kept() -> None:
    splitter = LineSplitter(8)
    assert splitter.take(b"x" * 20) == []
    assert splitter.take(b"yz\n") == [Received("yz", False)]
