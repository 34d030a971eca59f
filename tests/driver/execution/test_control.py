"""Requests to a running stream: an abort is at the wire at once; an override out of range is refused."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest

from arm.errors import ExecutionStopped, InputError
from driver.execution.control import Control
from driver.line.protocol import BYTES_PER_SECOND
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from wire.controlled_stream import Script, moved, moved_after_stop, reaches, run


@pytest.mark.parametrize("ask", ["control", "SIGINT"])
@pytest.mark.parametrize("after_s", [0.05, 0.61, 0.617, 0.74, 0.87, 3.3])
def test_stop_is_at_the_wire_within_100_ms(
    mars: Mars, fake: Any, clock: SteppedClock, ask: str, after_s: float
) -> None:
    """Whenever it is asked for, behind no more bytes than may be on their way."""
    control = Control()
    asked: list[float] = []

    def do() -> None:
        asked.append(clock.now())
        if ask == "control":
            control.abort()
        else:
            os.kill(os.getpid(), signal.SIGINT)

    clock.call_after(after_s, do)
    with pytest.raises(ExecutionStopped) as stopped:
        stream(mars, run(60), None, None, control)
    assert stopped.value.data["reason"] == {"control": "aborted", "SIGINT": "interrupted"}[ask]
    assert stopped.value.data["state"]["at_rest"] is True
    assert moved_after_stop(fake) == []
    stop = fake.lines.index("STOP:")
    assert fake.times[stop] - asked[0] < 0.1
    carried_at = 0.0  # when a line of 19200 baud has carried all that was sent before STOP
    for at, data in fake.line.sent[: min(k for k, (_, d) in enumerate(fake.line.sent) if b"STOP" in d)]:
        carried_at = max(carried_at, at) + len(data) / BYTES_PER_SECOND
    assert (carried_at - asked[0]) * BYTES_PER_SECOND <= 64 + 32  # and the piece that was being written


def test_an_abort_while_the_arm_stands_in_a_pause(mars: Mars, fake: Any) -> None:
    control = Control()
    script = Script((reaches(10), control.pause), (lambda p: control.standing, control.abort))
    with pytest.raises(ExecutionStopped, match="aborted on request; the arm has stopped") as stopped:
        stream(mars, run(60), script, None, control)
    assert stopped.value.data["reason"] == "aborted"
    assert moved_after_stop(fake) == []


def test_nothing_is_streamed_after_an_abort(mars: Mars, fake: Any) -> None:
    control = Control()
    control.abort()
    with pytest.raises(ExecutionStopped, match="aborted"):
        stream(mars, run(5), None, None, control)
    assert moved(fake) == []


@pytest.mark.parametrize("factor", [0.0, 0.04, 1.01, -1.0, float("nan")])
def test_an_override_out_of_range_is_refused(factor: float) -> None:
    with pytest.raises(InputError, match=r"must be from 0\.05 to 1; an override only slows down"):
        Control().override = factor
    with pytest.raises(InputError, match="only slows down"):
        Control(factor)


def test_an_override_stays_below_its_ceiling() -> None:
    control = Control(ceiling=0.4)
    assert control.override == 0.4
    with pytest.raises(InputError, match=r"must be from 0.05 to 0.4"):
        control.override = 0.5
    for ceiling in (0.0, 1.2, float("nan")):
        with pytest.raises(InputError, match="must be above 0 and at most 1"):
            Control(ceiling=ceiling)
    assert Control(ceiling=0.02).override == 0.02
