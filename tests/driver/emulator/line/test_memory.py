"""A line in memory: latency, damage and loss, in stepped time."""

from __future__ import annotations

import pytest

from driver.emulator import Emulator
from driver.emulator.line.memory import MemoryLine
from driver.line.link import Link, LinkLost, NoAnswer
from driver.line.protocol import BYTES_PER_SECOND
from driver.line.stepped_clock import SteppedClock


@pytest.mark.parametrize("latency_s", [0.0, 0.016, 0.1, 0.2])
def test_an_answer_takes_its_latency_and_its_bytes(
    emulator: Emulator, clock: SteppedClock, latency_s: float
) -> None:
    link = Link(emulator.open_line(latency_s), clock)
    link.send("ECHO:0")
    link.synchronise()
    clock.sleep(1.0)
    begin = clock.now()
    answer = link.ask("VER")
    line_s = (len("VER?\n") + len(f"VER={answer}\r\n")) / BYTES_PER_SECOND
    assert clock.now() - begin == pytest.approx(2.0 * latency_s + line_s, abs=3e-3)
    link.close()


def test_damage_of_the_line_is_what_a_function_says(emulator: Emulator, clock: SteppedClock) -> None:
    seen: list[tuple[float, bytes]] = []

    def damage(at: float, data: bytes) -> bytes:
        seen.append((at, data))
        return data.replace(b"VER", b"VXR")

    line = emulator.open_line(to_unit=damage, to_host=lambda at, data: data.replace(b"STAMP=", b"STAMP:"))
    link = Link(line, clock)
    with pytest.raises(NoAnswer, match="VER"):
        link.ask("VER")
    assert seen == line.sent == [(0.0, b"VER?\n")]
    assert [text for _, text in emulator.ignored] == ["VXR?"]
    with pytest.raises(NoAnswer, match="STAMP"):
        link.synchronise()
    link.close()


def test_a_line_that_is_lost_is_told_after_what_came_before(emulator: Emulator, clock: SteppedClock) -> None:
    line = emulator.open_line(latency_s=0.1)
    link = Link(line, clock)
    link.send("STAMP:5")
    clock.call_after(0.15, line.hang_up)
    with pytest.raises(LinkLost, match="closed by the other side"):
        link.wait(1.0)
    assert clock.now() == pytest.approx(0.25)
    assert b"".join(data for _, data in line.received).endswith(b"STAMP=5\r\n")
    with pytest.raises(LinkLost):
        link.send("VER?")
    link.close()


def test_a_unit_that_takes_no_bytes(emulator: Emulator, clock: SteppedClock) -> None:
    line = MemoryLine(clock)  # nobody reads at its other end
    link = Link(line, clock)
    with pytest.raises(LinkLost, match="takes no more bytes"):
        link.send("VER?" + " " * 200)
    assert 2.0 < clock.now() < 4.0
    line.reset_output_buffer()
    assert line.out_waiting == 0
    link.close()
