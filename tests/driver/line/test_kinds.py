"""What each kind of line means to the echo, and what holds before any has come back."""

from __future__ import annotations

import pytest

from driver.line.echo import EchoWatch, Kind, kind_of


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
