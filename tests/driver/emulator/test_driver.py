"""The real driver on the emulated unit: what a session does, end to end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import ExecutionStopped, ImpossibleError
from arms.count_paths import DISTANCE, quintic
from driver.emulator import Emulator, EmulatorOptions
from driver.execution.progress import Progress
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from emulated.near_marks import near_marks


class Object:
    """Something between the jaws that stops them at an ADC position."""

    def __init__(self, at: int) -> None:
        self.at = at
        self.calls: list[tuple[tuple[int, ...], int, int]] = []

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        self.calls.append((counts, from_adc, to_adc))
        return max(to_adc, self.at)


@pytest.fixture
def emulator(unit: Unit, clock: SteppedClock) -> Iterator[Emulator]:
    with Emulator(unit, clock, Object(471), EmulatorOptions(power_up_deg=near_marks(unit))) as emulator:
        yield emulator


@pytest.fixture
def mars(emulated_mars: Mars) -> Mars:
    return emulated_mars


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["crs93", "crs97"])
def test_home_from_power_up_to_soft_home(name: str, clock: SteppedClock) -> None:
    unit = load_unit(name)
    options = EmulatorOptions()
    with Emulator(unit, clock, options=options) as emulator, Mars(emulator.open_line(), unit, clock) as mars:
        stood = unit.counts(np.radians(options.power_up_deg))
        assert emulator.counts() == tuple(stood)
        mars.identify()
        mars.initialise()
        soft = tuple(int(c) for c in unit.counts(unit.soft_home))
        assert mars.counts() == emulator.counts() == soft
        assert emulator.violations == ()
        record = emulator.record()
        assert tuple(record.counts[-1]) == soft
        cap = np.array(unit.speed_registers) / 256.0
        velocity = np.diff(record.counts, axis=0)[np.diff(record.time_ms) == 1]  # within a motion, counts/ms
        assert np.all(np.abs(velocity) <= cap + 1)


def test_a_stream_is_followed_to_the_count(mars: Mars, emulator: Emulator) -> None:
    path = quintic(mars.counts(), 40, DISTANCE)
    before = len(emulator.record().time_ms)
    sent = stream(mars, path)
    assert sent.end_counts == path.end == emulator.counts()
    assert path.duration_s <= sent.duration_s <= 1.01 * path.duration_s + 0.05
    executed = emulator.record().counts[before:]
    planned = path.sample(1e-3)
    for row in executed[::97]:  # on the path, whatever the time
        assert np.min(np.max(np.abs(planned - row), axis=1)) <= 10.0
    assert emulator.violations == ()


def test_an_object_stops_the_jaws(mars: Mars, emulator: Emulator) -> None:
    closed = mars.gripper(1.0)
    assert (closed.adc, closed.stalled) == (471, True)
    opened = mars.gripper(0.0)
    assert (opened.adc, opened.stalled) == (840, False)
    plant = emulator.machine.plant
    assert isinstance(plant, Object)
    assert plant.calls == [(emulator.counts(), 840, 103), (emulator.counts(), 471, 840)]


def test_positions_survive_a_new_client(
    mars: Mars, emulator: Emulator, unit: Unit, clock: SteppedClock
) -> None:
    here = mars.counts()
    with Mars(emulator.open_line(), unit, clock) as again:
        again.identify()
        again.initialise(home=False)
        assert again.counts() == here
        again.move_to([c + 500 for c in here])


def test_an_unhomed_unit_is_noticed(emulator: Emulator, unit: Unit, clock: SteppedClock) -> None:
    with Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        with pytest.raises(ImpossibleError, match="must be homed"):
            mars.initialise(home=False)


def test_a_stop_in_a_stream_leaves_the_arm_at_rest_on_the_path(mars: Mars, emulator: Emulator) -> None:
    path = quintic(mars.counts(), 40, DISTANCE)

    def give_up(progress: Progress) -> None:
        if progress.done >= 12:
            raise KeyboardInterrupt

    with pytest.raises(ExecutionStopped, match="interrupted"):
        stream(mars, path, give_up)
    at = np.array(emulator.counts())
    assert np.min(np.max(np.abs(path.sample(1e-3) - at), axis=1)) <= 10.0
    assert 0 < abs(at[0] - path.start[0]) < abs(DISTANCE[0])
    assert tuple(at) == mars.counts()


@pytest.mark.parametrize("fault", ["power", "stop", "axis"])
def test_a_fault_in_a_stream_ends_it(mars: Mars, emulator: Emulator, fault: str) -> None:
    path = quintic(mars.counts(), 40, DISTANCE)

    def break_it(progress: Progress) -> None:
        if progress.done >= 8:
            match fault:
                case "power":
                    emulator.set_power(False)
                case "stop":
                    emulator.set_motion_stop(True)
                case _:
                    emulator.fail_axis("C")

    with pytest.raises(ExecutionStopped) as stopped:
        stream(mars, path, break_it)
    assert stopped.value.data["state"]["at_rest"]
    assert emulator.counts() != path.end


def test_static_error_is_accepted_by_the_driver(unit: Unit, clock: SteppedClock) -> None:
    options = EmulatorOptions(static_error=15, seed=3, power_up_deg=near_marks(unit))
    with Emulator(unit, clock, options=options) as emulator, Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        mars.initialise()
        path = quintic(tuple(int(c) for c in unit.counts(unit.soft_home)), 10, [d // 10 for d in DISTANCE])
        sent = stream(mars, path)
        error = np.abs(np.array(sent.end_counts) - path.end)
        assert 0 < np.max(error) <= 15


@pytest.mark.slow
@pytest.mark.parametrize("port", ["pty", "tcp"])
def test_over_a_port_of_the_host(unit: Unit, port: str) -> None:
    """The same in wall time, as against hardware: nothing here may say how soon."""
    clock = Clock(4.0)
    with Emulator(unit, clock, options=EmulatorOptions(power_up_deg=near_marks(unit))) as emulator:
        url = emulator.open_tcp() if port == "tcp" else emulator.open_pty()
        with Mars(url, unit, clock) as mars:
            assert mars.identify().startswith("MARS8")
            mars.initialise(soft_home=False)
            path = quintic(mars.counts(), 20, tuple(int(c) // 8 for c in unit.counts(unit.soft_home)))
            sent = stream(mars, path)
            assert sent.end_counts == path.end == emulator.counts()
            assert sent.duration_s >= path.duration_s
        assert emulator.violations == ()
