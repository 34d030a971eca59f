"""Signals that would end the program: the arm is told STOP, also where they come in pairs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from arm.controller.unit import Unit, load_unit
from driver.emulator import Emulator, EmulatorOptions
from driver.line.clock import Clock
from driver.line.link import Link
from driver.line.signals import SIGNALS, caught, hear_again, interruptible
from driver.mars.mars import Mars
from driver.mars.stopping import bring_to_rest
from emulated.near_marks import near_marks

CHILD = """
import sys
import driver.line.signals
from arm.controller.unit import load_unit
from driver.line.clock import Clock
from driver.mars.mars import Mars

driver.line.signals.QUIET_S = 60.0  # a busy host may sleep between two signals
unit = load_unit("crs93")
with Mars(sys.argv[1], unit, Clock(4.0)) as mars:
    mars.identify()
    mars.initialise(home=False)
    print("moving", flush=True)
    mars.move_to([int(c) for c in unit.counts(unit.lower * 0.9)])
"""


PAIRS = {"SIGINT-SIGTERM": (signal.SIGINT, signal.SIGTERM), "SIGHUP-SIGHUP": (signal.SIGHUP, signal.SIGHUP)}
SCALE = 4.0


@pytest.fixture(scope="module")
def homed() -> Iterator[Emulator]:
    """An emulated unit that is homed, and away from its marks, that nobody uses."""
    unit = load_unit("crs93")
    with Emulator(unit, Clock(SCALE), options=EmulatorOptions(power_up_deg=near_marks(unit))) as emulator:
        with Mars(emulator.open_pty(), unit, Clock(SCALE)) as mars:
            mars.identify()
            mars.initialise(soft_home=False)
            mars.move_to([-1000] * 6)
        yield emulator


@pytest.mark.parametrize(
    ("pair", "gap_s"),
    [
        ("SIGINT-SIGTERM", 0.0),
        ("SIGHUP-SIGHUP", 1e-3),
        pytest.param("SIGINT-SIGTERM", 2e-4, marks=pytest.mark.slow),
        pytest.param("SIGINT-SIGTERM", 1e-3, marks=pytest.mark.slow),
        pytest.param("SIGHUP-SIGHUP", 0.0, marks=pytest.mark.slow),
        pytest.param("SIGHUP-SIGHUP", 2e-4, marks=pytest.mark.slow),
    ],
)
def test_two_signals_close_together_stop_the_arm(homed: Emulator, pair: str, gap_s: float) -> None:
    url = homed.paths()[0]
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, url], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        assert child.stdout is not None
        assert child.stdout.readline() == b"moving\n"
        begun = homed.counts()
        over = time.monotonic() + 300.0
        while homed.counts() == begun:
            assert time.monotonic() < over, "it never moved"
            time.sleep(0.01)
        last_ms = homed.lines[-1][0]  # a long record forgets its first lines, so their number says nothing
        for number in PAIRS[pair]:
            os.kill(child.pid, number)
            time.sleep(gap_s)
        _, told = child.communicate(timeout=300.0)
    finally:
        child.kill()
        child.wait()
    assert "STOP:" in [line for time_ms, line in homed.lines if time_ms >= last_ms]
    assert b"move interrupted; the arm has stopped and is still under power, at [" in told
    at = homed.counts()
    time.sleep(0.2)
    assert homed.counts() == at


def _kill_myself(wait_s: float = 1.0) -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(wait_s)


def test_ctrl_z_is_an_interrupt_where_an_arm_may_move_and_halts_elsewhere() -> None:
    with interruptible(), pytest.raises(KeyboardInterrupt, match="SIGTSTP"):
        signal.raise_signal(signal.SIGTSTP)
    assert signal.getsignal(signal.SIGTSTP) == signal.SIG_DFL


def test_only_the_first_signal_is_heard_and_the_handlers_are_put_back() -> None:
    before = {number: signal.getsignal(number) for number in SIGNALS}
    heard = []
    with interruptible(), interruptible():
        for number in (*SIGNALS, *SIGNALS):
            try:
                os.kill(os.getpid(), number)
                time.sleep(0.01)
            except KeyboardInterrupt as told:
                heard.append(str(told))
    assert heard == ["SIGINT"]
    assert {number: signal.getsignal(number) for number in SIGNALS} == before
    with pytest.raises(KeyboardInterrupt, match="SIGTERM"), interruptible():
        _kill_myself()


class Dropped:
    """Python drops what is raised in a finaliser."""

    def __del__(self) -> None:
        _kill_myself(0.01)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("ends", [False, True])
def test_an_interrupt_that_python_drops_does_not_make_the_program_deaf(
    monkeypatch: pytest.MonkeyPatch, ends: bool
) -> None:
    monkeypatch.setattr("driver.line.signals.QUIET_S", 0.05)
    with interruptible(ends):
        dropped = Dropped()
        del dropped
        time.sleep(0.1)
        with pytest.raises(KeyboardInterrupt):
            _kill_myself()


def test_once_the_arm_stands_the_next_signal_is_heard_unless_the_program_ends() -> None:
    for ends, count in ((False, 3), (True, 1)):
        heard = 0
        with interruptible(ends):
            for _ in range(3):
                try:
                    _kill_myself(0.01)
                except KeyboardInterrupt:
                    heard += 1
                hear_again()
        assert heard == count


def test_stop_goes_out_though_its_sending_is_interrupted(
    homed: Emulator, unit: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, tried = Link.send_stop, []

    def interrupted(link: Link, again: bool = False) -> None:
        tried.append(1)
        if len(tried) < 3:
            raise KeyboardInterrupt
        plain(link, again)

    with Mars(homed.paths()[0], unit, Clock(SCALE)) as mars:
        mars.identify()
        monkeypatch.setattr(Link, "send_stop", interrupted)
        last_ms = homed.lines[-1][0]
        state = bring_to_rest(mars.link, ())
        monkeypatch.undo()
    assert len(tried) >= 3
    assert state.at_rest
    assert "STOP:" in [line for time_ms, line in homed.lines if time_ms >= last_ms]


def test_once_it_is_caught_no_other_is_heard_until_the_program_has_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = {number: signal.getsignal(number) for number in SIGNALS}
    monkeypatch.setattr("driver.line.signals.QUIET_S", 0.0)
    try:
        with interruptible(ends=True):
            with pytest.raises(KeyboardInterrupt):
                _kill_myself()
            caught()
            for _ in range(3):
                _kill_myself(0.01)
        assert {signal.getsignal(number) for number in SIGNALS} == {signal.SIG_IGN}
        _kill_myself(0.01)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    with interruptible():  # a program that goes on hears each of them
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                _kill_myself()
            caught()
    assert {number: signal.getsignal(number) for number in SIGNALS} == before


def test_a_program_that_does_not_end_hears_again_at_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """It hangs where it should end: Ctrl-C must work then."""
    monkeypatch.setattr("driver.line.signals.QUIET_S", 0.0)
    monkeypatch.setattr("driver.line.signals.ENDING_S", 0.05)
    with interruptible(ends=True):
        with pytest.raises(KeyboardInterrupt):
            _kill_myself()
        caught()
        time.sleep(0.1)
        with pytest.raises(KeyboardInterrupt):
            _kill_myself()
