"""An absolute move that is verified before it begins: it waits in the unit behind a dwell while it comes back.

Needs a path generator that stands where the unit's next segment is to begin (`Mars.reference`): a dwell is a relative
segment of no length, and would jump otherwise.
"""

from __future__ import annotations

from driver.line.link import LineDamaged, Link
from driver.line.protocol import BYTES_PER_SECOND, encode_dwell
from driver.mars.lookahead import BUSY_HOST_S, JITTER_S, Needs


def send_verified(link: Link, axes: int, line: str) -> None:
    """Send a line of motion behind a dwell of `axes`, and let it come back before that is over.

    Raises:
        LineDamaged: it came back otherwise, or not in time; it has not begun, and a STOP now keeps it from that.
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
    _come_back(link, dwell, number, decide_at - size / BYTES_PER_SECOND - needs.echo_s(size, size))
    _come_back(link, line, link.send(line), decide_at)


def _come_back(link: Link, line: str, number: int, until: float) -> None:
    """Wait for an echo."""
    while link.echo.verified < number:
        if link.clock.now() >= until:
            raise LineDamaged(
                f"the line was damaged: sent {line!r}, nothing came back before it would begin",
                sent=line,
                received="",
                column=1,
                reason="line",
            )
        link.receive(until)
