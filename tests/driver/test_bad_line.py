"""One damaged line in a motion: it is noticed, and the arm stands on its path before what was damaged begins."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import ExecutionStopped
from arms.count_paths import off_path_deg
from driver.emulator import Emulator, EmulatorOptions
from driver.execution.progress import StreamOptions
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from emulated.near_marks import near_marks
from wire.fault_matrix import motion
from wire.line_damage import ANSWER, KINDS, Damage

OFF_DEG = 0.02  # rounding
REGISTER = r"REGMSA:"


def streamed(
    unit: Unit,
    clock: SteppedClock,
    latency_s: float = 0.0,
    there: Callable[[float, bytes], bytes] | None = None,
    back: Callable[[float, bytes], bytes] | None = None,
    options: StreamOptions | None = None,
    **behaviour: Any,
) -> tuple[ExecutionStopped | None, float, Mars]:
    """One motion; the error, the farthest from its path, deg, and the driver."""
    with (
        Emulator(
            unit, clock, options=EmulatorOptions(power_up_deg=near_marks(unit), **behaviour)
        ) as emulator,
        Mars(emulator.open_line(latency_s, there, back), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise(soft_home=False)
        path = motion()
        mars.anchor(path.start)
        began_ms = emulator.now_ms()
        for tap in (there, back):
            if isinstance(tap, Damage):
                tap.armed = True
        error = None
        try:
            assert stream(mars, path, options=options).end_counts == path.end == emulator.counts()
        except ExecutionStopped as stopped:
            error = stopped
        clock.sleep(2.0)
        record = emulator.record()
    counts = record.counts[record.time_ms >= began_ms]
    curve = path.at(np.arange(0.0, path.duration_s + 1e-3, 1e-3))
    return error, off_path_deg(unit, counts, curve) if len(counts) else 0.0, mars


@pytest.mark.few(10)
@pytest.mark.parametrize("latency_s", [0.0, 0.1])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("nth", "stops"), [(2, 0), (15, 2)])
def test_a_damaged_segment_never_begins(
    unit: Unit, clock: SteppedClock, kind: Any, nth: int, stops: int, latency_s: float
) -> None:
    damage = Damage(kind, nth, seed=nth, stops=stops)
    error, off_deg, _ = streamed(unit, clock, latency_s, there=damage)
    assert damage.at_s is not None
    assert error is not None
    assert error.data["reason"] == "line"
    assert error.data["state"]["at_rest"]
    assert off_deg < OFF_DEG


@pytest.mark.few(4)
@pytest.mark.parametrize(("echo_end", "echo_order"), [("LF", "before"), ("CRLF", "mixed")])
@pytest.mark.parametrize("kind", ["lost", "doubled", "digit", "0.3 s"])
@pytest.mark.parametrize("nth", [1, 9])
def test_a_damaged_segment_never_begins_where_bytes_come_back(
    unit: Unit, clock: SteppedClock, kind: Any, nth: int, echo_end: str, echo_order: str
) -> None:
    damage = Damage(kind, nth, seed=nth)
    error, off_deg, _ = streamed(
        unit, clock, there=damage, echo="byte", echo_end=echo_end, echo_order=echo_order
    )
    assert damage.at_s is not None
    assert error is not None
    assert error.data["state"]["at_rest"]
    assert off_deg < OFF_DEG


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_dwell_stops_the_arm_on_its_path(unit: Unit, clock: SteppedClock, kind: Any) -> None:
    """What follows begins too early; it is sound, so the arm is on its path until it stands."""
    damage = Damage(kind, 1, seed=5, what=re.compile(rb"COORDSPLINET:\d+,3(,0){4}"))
    error, off_deg, _ = streamed(unit, clock, there=damage)
    assert damage.at_s is not None
    assert error is not None
    assert error.data["reason"] == "line"
    assert error.data["state"]["at_rest"]
    assert off_deg < OFF_DEG


def test_the_message_shows_what_was_sent_what_came_back_and_the_column(
    unit: Unit, clock: SteppedClock
) -> None:
    damage = Damage("digit", 12, seed=5)
    error, _, _ = streamed(unit, clock, back=damage)
    assert error is not None
    sent, received, column = (error.data[key] for key in ("sent", "received", "column"))
    assert sent.encode() == damage.line
    assert sent[: column - 1] == received[: column - 1]
    assert sent[column - 1] != received[column - 1]
    assert repr(sent) in str(error)
    assert f"column {column}" in str(error)


@pytest.mark.few(3)
@pytest.mark.parametrize("kind", KINDS[:6])
def test_damaged_answers_stop_nothing(unit: Unit, clock: SteppedClock, kind: Any) -> None:
    damage = Damage(kind, 6, seed=3, what=ANSWER)
    error, off_deg, _ = streamed(unit, clock, 0.016, back=damage)
    assert damage.at_s is not None
    assert error is None
    assert off_deg < OFF_DEG


STATUS = rb"ST=16(?=\r)"
NUMBER = rb"(?<=COORDAP=)(\d+),(\d+)(?=,)"


@pytest.mark.few(6)
@pytest.mark.parametrize("echo", ["line", "none"])
@pytest.mark.parametrize(
    ("answer", "wrong"),
    [
        (STATUS, lambda found: b"ST=1"),  # as of an idle unit
        (STATUS, lambda found: b"ST=8"),  # an axis in error
        (STATUS, lambda found: b"ST=65552"),  # arm power off
        (NUMBER, lambda found: b"%s,%d" % (found[1], int(found[2]) + 10)),  # cannot run yet
        (NUMBER, lambda found: b"%s,1" % found[1]),  # is over
    ],
)
@pytest.mark.parametrize("nth", [1, 2, pytest.param(7, marks=pytest.mark.slow)])
def test_one_wrong_answer_is_asked_for_again(
    unit: Unit, clock: SteppedClock, answer: bytes, wrong: Any, nth: int, echo: str
) -> None:
    streams, seen = [False], [0]

    def there(now_s: float, data: bytes) -> bytes:
        streams[0] |= b"COORDSPLINET" in data
        return data

    def back(now_s: float, data: bytes) -> bytes:
        if not streams[0] or not re.search(answer, data):
            return data
        seen[0] += 1
        return re.sub(answer, wrong, data) if seen[0] == nth else data

    error, off_deg, _ = streamed(unit, clock, there=there, back=back, echo=echo)
    assert seen[0] > nth
    assert error is None
    assert off_deg < OFF_DEG


@pytest.mark.few(5)
@pytest.mark.parametrize(
    "latency_s", [0.0, 0.2, *(pytest.param(s, marks=pytest.mark.slow) for s in (0.016, 0.1))]
)
@pytest.mark.parametrize(
    ("echo", "echo_end", "echo_order"),
    [
        ("line", "LF", "before"),
        ("line", "CRLF", "after"),
        ("line", "CR", "before"),
        ("byte", "LF", "before"),
        ("byte", "LF", "mixed"),
        ("byte", "CR", "mixed"),
        ("byte", "CRLF", "mixed"),
        ("none", "LF", "before"),
    ],
)
def test_no_manners_of_a_unit_stop_a_sound_line(
    unit: Unit, clock: SteppedClock, echo: str, echo_end: str, echo_order: str, latency_s: float
) -> None:
    error, off_deg, mars = streamed(
        unit, clock, latency_s, echo=echo, echo_end=echo_end, echo_order=echo_order
    )
    assert error is None
    assert off_deg < OFF_DEG
    assert mars.manners.echoes == (echo != "none")
    assert mars.link.takes_turns == (echo == "byte")


@pytest.mark.few(3)
@pytest.mark.parametrize("latency_s", [0.0, 0.2])
@pytest.mark.parametrize(("echo", "times"), [("line", 1), ("byte", 1), ("byte", 2), ("none", 1)])
def test_the_end_of_a_motion_that_is_lost_on_the_line_is_asked_for_again_in_time(
    unit: Unit, clock: SteppedClock, latency_s: float, echo: str, times: int
) -> None:
    """Where turns are taken, looks are 1.6 s apart at 200 ms one way."""
    streams, lost = [False], [0]

    def there(now_s: float, data: bytes) -> bytes:
        streams[0] |= b"COORDSPLINET" in data
        return data

    def back(now_s: float, data: bytes) -> bytes:
        if streams[0] and lost[0] < times and b"!" in data:
            lost[0] += 1
            return data.replace(b"!", b"#")
        return data

    error, off_deg, _ = streamed(unit, clock, latency_s, there, back, echo=echo)
    assert lost[0] == times
    assert error is None
    assert off_deg < OFF_DEG


def test_an_adapter_that_sends_everything_back_is_not_taken_for_the_unit(
    unit: Unit, clock: SteppedClock
) -> None:
    error, _, mars = streamed(unit, clock, adapter_echo=True, echo="none")
    assert error is None
    assert (mars.manners.echoes, mars.manners.adapter) == (False, True)
    assert "NO ECHO" in mars.manners.describe()


@pytest.mark.parametrize("full", ["block", "drop"])
def test_a_small_buffer_of_the_unit_is_not_flooded(unit: Unit, clock: SteppedClock, full: str) -> None:
    error, off_deg, _ = streamed(unit, clock, input_buffer=300, input_full=full, parse_ms=5.0)
    assert error is None
    assert off_deg < OFF_DEG


def test_without_an_echo_the_arm_is_stopped_by_its_place(unit: Unit, clock: SteppedClock) -> None:
    """Later and not surely; so it is told."""
    error, off_deg, mars = streamed(unit, clock, there=Damage("lost", 15, seed=1), echo="none")
    assert error is not None
    assert error.data["reason"] in ("following", "line")
    assert off_deg > OFF_DEG
    assert "NO ECHO" in mars.manners.describe()


def test_a_register_that_arrives_wrong_is_sent_again(unit: Unit, clock: SteppedClock) -> None:
    spoiled = []

    def there(now_s: float, data: bytes) -> bytes:
        if data.startswith(REGISTER.encode()) and not spoiled:
            spoiled.append(data)
            return data.replace(b"7", b"1", 1)
        return data

    error, _, _ = streamed(unit, clock, there=there)
    assert spoiled
    assert error is None


@pytest.mark.parametrize("latency_s", [0.0, 0.016, 0.1])
def test_nothing_is_sent_behind_a_dwell_before_it_has_come_back(latency_s: float) -> None:
    """A dwell that is lost, or joined with the first segment, would let that begin at once."""
    unit, clock = load_unit("crs93"), SteppedClock()
    path = motion()
    with (
        Emulator(unit, clock, options=EmulatorOptions(power_up_deg=near_marks(unit))) as emulator,
        Mars(emulator.open_line(latency_s), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise(soft_home=False)
        mars.anchor(path.start)
        begun = emulator.now_ms()
        stream(mars, path)
        segments = [at for at, line in emulator.lines if at >= begun and line.startswith("COORDSPLINET:")]
    dwell, first = segments[:2]
    assert first - dwell >= 2e3 * latency_s + 1e3 * 100 / 1920  # there and back, and its some 50 bytes twice


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("line", "becomes"), [(b"REGACCF", b"REGACCB"), (b"REGPF", b"REGPB"), (b"REGMSF", b"REGMSB")]
)
def test_a_register_that_a_damaged_line_has_overwritten_is_told_again(line: bytes, becomes: bytes) -> None:
    """One bit of the axis: the line is another axis' then, and the unit obeys it."""

    def registers(tap: Callable[[float, bytes], bytes] | None) -> dict[str, int]:
        unit, clock = load_unit("crs93"), SteppedClock()
        with Emulator(unit, clock) as emulator, Mars(emulator.open_line(0.016, tap), unit, clock) as mars:
            mars.identify()
            mars.initialise(soft_home=False)
            return dict(emulator.machine.registers)

    hit: list[bytes] = []

    def damaged(_: float, data: bytes) -> bytes:
        if data.startswith(line) and not hit:
            hit.append(data)
            return data.replace(line, becomes, 1)
        return data

    wrong = registers(damaged)
    assert hit
    assert wrong == registers(None)
