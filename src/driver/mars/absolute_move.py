"""An absolute move that is verified before it begins: the unit holds it behind a dwell until its echo has come.

A dwell is a relative segment of zero length. So the end of the unit's path generator must be known (`Mars.reference`);
otherwise the arm would jump.
"""

from __future__ import annotations

from driver.line.echo import Mismatch
from driver.line.link import Link, line_damaged
from driver.line.protocol import BYTES_PER_SECOND, encode_dwell
from driver.mars.lookahead import BUSY_HOST_S, JITTER_S, Needs


def send_verified(link: Link, axes: int, line: str) -> None:
    """Send a dwell of `axes` axes and then a motion line, and verify the echoes of both before the dwell ends.

    Raises:
        LineDamaged: an echo differs or is late. The motion has not begun; a STOP sent now prevents it.
        NoAnswer, LinkLost: as `Link.receive`.
    """
    needs = Needs(link.trip_s, link.stop_delivery_s, 0.0)
    dwell_bytes, size = len(encode_dwell(1000, axes)) + 1, len(line) + 1
    need_s = needs.echo_s(dwell_bytes, dwell_bytes) + size / BYTES_PER_SECOND + needs.echo_s(size, size)
    jitter_s = link.clock.at_least(JITTER_S, BUSY_HOST_S)
    dwell_ms = int(1e3 * (need_s + needs.last_s(0.0) + 2.0 * jitter_s)) + 1
    dwell = encode_dwell(dwell_ms, axes)
    number = link.send(dwell)
    decide_at = link.line_free_at + dwell_ms / 1e3 - needs.last_s(0.0)
    _await_echo(link, dwell, number, decide_at - size / BYTES_PER_SECOND - needs.echo_s(size, size))
    _await_echo(link, line, link.send(line), decide_at)


def _await_echo(link: Link, line: str, number: int, until: float) -> None:
    while link.echo.verified < number:
        if link.clock.now() >= until:
            missing = Mismatch(line, "")
            raise line_damaged(f"{missing.describe()} before the motion would begin", missing)
        link.receive(until)
