"""An absolute move that is damaged on the line never begins, where the unit's reference is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from driver.emulator import Emulator, EmulatorOptions
from driver.line.protocol import BYTES_PER_SECOND
from driver.line.stepped_clock import SteppedClock
from driver.mars.absolute_move import send_verified
from driver.mars.lookahead import ANSWERS_BYTES, JITTER_S, MARGIN_S
from driver.mars.mars import Mars
from emulated.near_marks import near_marks

TARGET = (-20000, 1500, 8000, 9000, 7000, -9000)


def moved(
    unit: Unit, clock: SteppedClock, there: Any, latency_s: float = 0.0, **behaviour: Any
) -> tuple[ExecutionStopped | None, float, Emulator]:
    """A move to TARGET over a line that is damaged from then on; the error, and the farthest from its start, counts."""
    armed = [False]

    def tap(now_s: float, data: bytes) -> bytes:
        return there(data) if armed[0] else data

    options = EmulatorOptions(power_up_deg=near_marks(unit), **behaviour)
    with (
        Emulator(unit, clock, options=options) as emulator,
        Mars(emulator.open_line(latency_s, tap), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise(soft_home=False)
        mars.anchor(emulator.counts())
        armed[0], begin_ms, error = True, emulator.now_ms(), None
        try:
            mars.move_to(TARGET)
        except ExecutionStopped as stopped:
            error = stopped
        clock.sleep(1.0)
        record = emulator.record()
    counts = record.counts[record.time_ms >= begin_ms]
    return error, float(np.abs(counts).max()) if len(counts) else 0.0, emulator


@pytest.mark.parametrize("latency_s", [0.0, 0.1, 0.2])
@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data.replace(b"COORDMV:-2", b"COORDMV:-9"),
        lambda data: data.replace(b"COORDMV:-2", b"COORDMV:-9,"),
        lambda data: b"" if b"COORDMV" in data else data,
        lambda data: data.replace(b"SPLINET", b"SPLINEX"),
    ],
)
def test_a_damaged_absolute_move_never_begins(
    unit: Unit, clock: SteppedClock, damage: Any, latency_s: float
) -> None:
    error, far, _ = moved(unit, clock, damage, latency_s)
    assert error is not None
    assert error.data["reason"] == "line"
    assert error.data["state"]["at_rest"]
    assert far <= 2


@pytest.mark.parametrize("latency_s", [0.0, 0.2])
@pytest.mark.parametrize("echo", ["line", "none"])
def test_a_sound_one_arrives_with_an_echo_and_without(
    unit: Unit, clock: SteppedClock, echo: str, latency_s: float
) -> None:
    error, _, emulator = moved(unit, clock, lambda data: data, latency_s, echo=echo)
    assert error is None
    assert emulator.counts() == TARGET


def test_the_first_move_after_a_stop_goes_slowly_to_where_the_arm_stands(
    unit: Unit, clock: SteppedClock
) -> None:
    """Its reference is not known, so it cannot be verified before it begins: what damage can do is small."""
    options = EmulatorOptions(power_up_deg=near_marks(unit))
    spoilt: list[bytes] = []

    def there(now_s: float, data: bytes) -> bytes:
        if data.startswith(b"COORDMV:") and not spoilt:
            spoilt.append(data)
            return data.replace(b"COORDMV:", b"COORDMV:-90000", 1)
        return data

    with (
        Emulator(unit, clock, options=options) as emulator,
        Mars(emulator.open_line(0.0, there), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise(soft_home=False)
        with pytest.raises(ExecutionStopped, match="transmission error"):
            mars.move_to(TARGET)
        assert spoilt
        off_deg = np.abs(np.degrees(unit.positions(emulator.counts()) - unit.positions(np.zeros(6))))
    assert float(off_deg.max()) < 1.0


@pytest.mark.parametrize(("trip_s", "axes"), [(0.0, 6), (0.05, 6), (0.3, 6)])
def test_the_dwell_is_as_long_as_both_echoes_and_a_stop_take_and_no_longer(trip_s: float, axes: int) -> None:
    """Both lines and their echoes at the line's speed, a look's answers beside each, two round trips, and lateness."""
    sent: list[str] = []
    link: Any = SimpleNamespace(
        trip_s=trip_s,
        stop_delivery_s=0.03 + trip_s / 2.0,
        clock=SteppedClock(),
        line_free_at=0.0,
        echo=SimpleNamespace(verified=9),
        send=lambda line: sent.append(line) or len(sent),
    )
    line = "COORDMV:" + ",".join(["1000"] * axes)
    send_verified(link, axes, line)
    assert sent[1] == line
    dwell, size = (
        len(sent[0]),
        len(line) + 1,
    )  # a digit of the dwell's length may be less than is reckoned with
    waits = max(dwell + 1 - trip_s * BYTES_PER_SECOND, 0.0)
    on_the_line = (
        dwell + 1 + waits + size + size + max(size - trip_s * BYTES_PER_SECOND, 0.0)
    ) / BYTES_PER_SECOND
    least_s = (
        on_the_line + 2.0 * (trip_s + ANSWERS_BYTES / BYTES_PER_SECOND) + link.stop_delivery_s + MARGIN_S
    )
    dwell_s = int(sent[0].split(":")[1].split(",")[0]) / 1e3
    assert least_s + 2.0 * JITTER_S <= dwell_s <= least_s + 2.0 * JITTER_S + 2e-3
