"""A motion that is loaded and verified before it begins; on a bad line it is sent again."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError
from arms.count_paths import off_path_deg, quintic
from driver.emulator import Emulator, EmulatorOptions
from driver.execution.control import Control
from driver.execution.progress import Sent, StreamOptions
from driver.line.link import LineDamaged
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.stopping import RestState
from driver.mars.streaming.preload import PRELOADS, preloaded
from driver.mars.streaming.stream import stream
from emulated.near_marks import near_marks
from wire.line_damage import KINDS, SEGMENT, Damage

OFF_DEG = 0.02


class Loaded:
    """One preloaded motion on an emulated unit, and what its line carried."""

    def __init__(
        self,
        unit: Unit,
        clock: SteppedClock,
        segments: int = 20,
        queue: int = 150,
        latency_s: float = 0.0,
        there: Any = None,
        script: Any = None,
        **behaviour: Any,
    ) -> None:
        self.told: list[str] = []
        self.error: ExecutionStopped | ImpossibleError | None = None
        self.sent: Sent | None = None
        control = Control(tell=self.told.append)
        options = EmulatorOptions(power_up_deg=near_marks(unit), **behaviour)
        with Emulator(unit, clock, options=options) as emulator:
            line = emulator.open_line(latency_s, there)
            with Mars(line, unit, clock) as mars:
                mars.identify()
                mars.initialise(soft_home=False)
                self.path: CountPath = quintic((0,) * 6, segments, (-30000, 2000, 10000, 9000, 8000, -9000))
                mars.anchor(self.path.start)
                if isinstance(there, Damage):
                    there.armed = True
                self.began_ms, began = emulator.now_ms(), clock.now()
                try:
                    on_progress = None if script is None else (lambda p: script(p, control))
                    self.sent = stream(
                        mars, self.path, on_progress, StreamOptions(preload=True, queue=queue), control
                    )
                except (ExecutionStopped, ImpossibleError) as error:
                    self.error = error
                clock.sleep(1.0)
            record = emulator.record()
            self.lines = [(at, data) for at, data in line.sent if at >= began]
            self.received = b"".join(data for at, data in line.received if at >= began)
        moved = record.counts[record.time_ms >= self.began_ms]
        far = np.abs(moved - np.array(self.path.start)).max(axis=1) > 25
        self.moves_s = (
            float(record.time_ms[record.time_ms >= self.began_ms][far][0]) / 1e3 if far.any() else np.inf
        )
        curve = self.path.at(np.arange(0.0, self.path.duration_s + 1e-3, 1e-3))
        self.off_deg = off_path_deg(unit, moved, curve) if len(moved) else 0.0

    @property
    def segments_s(self) -> list[float]:
        """When each segment was sent; the first that looks like one is the dwell, whose end goes by itself."""
        return [at for at, data in self.lines if SEGMENT.match(data)][1:]


@pytest.mark.parametrize("latency_s", [0.0, 0.1])
def test_everything_is_sent_before_the_arm_moves(unit: Unit, clock: SteppedClock, latency_s: float) -> None:
    loaded = Loaded(unit, clock, latency_s=latency_s)
    assert loaded.error is None
    assert len(loaded.segments_s) == 20
    assert max(loaded.segments_s) + 2 * latency_s < loaded.moves_s
    assert loaded.off_deg < OFF_DEG
    assert loaded.told == []


@pytest.mark.few(3)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("nth", [pytest.param(1, marks=pytest.mark.slow), 19])
def test_a_damaged_motion_is_sent_again_and_ends_where_it_should(
    unit: Unit, clock: SteppedClock, kind: Any, nth: int
) -> None:
    damage = Damage(kind, nth, seed=nth)
    loaded = Loaded(unit, clock, there=damage)
    assert damage.at_s is not None
    assert damage.at_s < loaded.moves_s
    assert loaded.error is None
    assert loaded.sent is not None
    assert loaded.sent.end_counts == loaded.path.end
    assert loaded.off_deg < OFF_DEG
    assert len([t for t in loaded.told if "sent again" in t]) == 1


def test_a_line_that_damages_every_time_is_given_up_and_nothing_has_moved(
    unit: Unit, clock: SteppedClock
) -> None:
    def there(now_s: float, data: bytes) -> bytes:
        return data.replace(b"2", b"3", 1) if SEGMENT.match(data) and b",3,0,0,0" not in data else data

    loaded = Loaded(unit, clock, there=there)
    assert loaded.error is not None
    assert loaded.error.data["reason"] == "line"
    assert loaded.error.data["attempts"] == PRELOADS
    assert loaded.error.data["state"]["at_rest"]
    assert loaded.moves_s == np.inf
    assert len([t for t in loaded.told if "sent again" in t]) == PRELOADS - 1


def test_of_a_motion_that_the_unit_cannot_hold_the_first_part_is_loaded_and_it_is_told(
    unit: Unit, clock: SteppedClock
) -> None:
    loaded = Loaded(unit, clock, segments=40, queue=21)
    assert loaded.error is None
    assert loaded.off_deg < OFF_DEG
    assert len([at for at in loaded.segments_s if at < loaded.moves_s]) == 20
    assert loaded.told == [
        "the motion has 40 segments: 20 fit into the unit and are verified before the arm moves, each of the others "
        "before it begins"
    ]
    assert StreamOptions().queue < EmulatorOptions().queue


def test_damage_behind_what_was_loaded_stops_the_arm_before_it_begins(
    unit: Unit, clock: SteppedClock
) -> None:
    loaded = Loaded(unit, clock, segments=40, queue=21, there=Damage("lost", 31, seed=1))
    assert loaded.error is not None
    assert loaded.error.data["reason"] == "line"
    assert loaded.off_deg < OFF_DEG


def test_a_unit_that_does_not_echo_cannot_be_preloaded(unit: Unit, clock: SteppedClock) -> None:
    loaded = Loaded(unit, clock, echo="none")
    assert isinstance(loaded.error, ImpossibleError)
    assert "preload" in str(loaded.error)
    assert loaded.segments_s == []
    assert loaded.moves_s == np.inf


def test_a_pause_while_it_is_loaded_loses_nothing(unit: Unit, clock: SteppedClock) -> None:
    def script(progress: Any, control: Control) -> None:
        if progress.done == 0 and not control.paused and not asked:
            asked.append(clock.now())
            control.pause()
            clock.call_after(8.0, control.go_on)

    asked: list[float] = []
    loaded = Loaded(unit, clock, script=script)
    assert asked
    assert loaded.error is None
    assert loaded.sent is not None
    assert loaded.sent.end_counts == loaded.path.end
    assert loaded.off_deg < OFF_DEG


@pytest.mark.parametrize("parse_ms", [60.0, 70.0])
def test_a_unit_that_is_slower_than_its_line_leaves_the_path_no_more_than_any_other(
    unit: Unit, clock: SteppedClock, parse_ms: float
) -> None:
    loaded = Loaded(unit, clock, parse_ms=parse_ms, input_buffer=300)
    assert loaded.off_deg < OFF_DEG
    assert loaded.error is not None or max(loaded.segments_s) < loaded.moves_s
    assert loaded.error is None or loaded.error.data["state"]["at_rest"]


def test_a_host_that_sleeps_while_it_loads_begins_again(unit: Unit, clock: SteppedClock) -> None:
    stands_until: list[float] = []

    def there(now_s: float, data: bytes) -> bytes:
        if found := re.match(rb"COORDSPLINET:(\d+),3,0,0,0", data):
            stands_until.append(now_s + int(found[1]) / 1e3)
        return data

    def script(progress: Any, control: Control) -> None:
        if stands_until and not slept:
            slept.append(clock.now())
            clock.sleep(stands_until[-1] - 0.02 - clock.now())

    slept: list[float] = []
    loaded = Loaded(unit, clock, there=there, script=script)
    assert slept
    assert loaded.error is None
    assert len([t for t in loaded.told if "loaded in time" in t]) == 1
    assert max(loaded.segments_s) < loaded.moves_s
    assert loaded.off_deg < OFF_DEG


@pytest.mark.parametrize(
    ("at_rest", "counts", "again"),
    [(True, 0, True), (True, 25, True), (True, 26, False), (False, 0, False), (True, None, False)],
)
def test_a_motion_is_sent_again_only_by_an_arm_that_stands_where_it_stood(
    at_rest: bool, counts: int | None, again: bool
) -> None:
    tried: list[float] = []

    def begin(slower: float) -> Any:
        tried.append(slower)
        return SimpleNamespace(at_once=(1, 1), stands=True, run=run)

    def run() -> str:
        if len(tried) == 1:
            raise LineDamaged("damaged", reason="line")
        return "sent"

    path = quintic((0,) * 6, 4)
    there = None if counts is None else (path.start[0] + counts, *path.start[1:])
    mars: Any = SimpleNamespace(
        stop=lambda: RestState(at_rest, there, None),
        unit=SimpleNamespace(rest_tolerance=25),
        note=lambda *_, **__: None,
        anchor=lambda start: None,
    )
    if again:
        assert preloaded(mars, begin, path, Control()) == "sent"
        return
    with pytest.raises(LineDamaged, match="damaged"):
        preloaded(mars, begin, path, Control())
    assert len(tried) == 1
