"""A small scripted controller in stepped time. It behaves unless told to misbehave; the emulator never does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest

from arm.controller.unit import Unit, load_unit
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.line.memory import MemoryLine
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from emulated.near_marks import near_marks

Hook = Callable[[str], "list[str] | None"]


class FakeUnit:
    """Reads lines, answers like a MARS-8, executes queued segments by the clock (no dynamics at all).

    Attributes:
        line: to it, for a `Link` or `Mars`.
        lines, times: everything received, in order, and when.
        hooks: name of a command -> function of the line; its answers replace the normal treatment, None keeps it.
        status_bits: OR-ed into ST.
        offset: added to the positions that are told, counts.
        mute: answer nothing.
    """

    def __init__(self, clock: SteppedClock, axes: int = 6) -> None:
        self.clock = clock
        self.lines: list[str] = []
        self.times: list[float] = []
        self.hooks: dict[str, Hook] = {}
        self.status_bits = 0
        self.offset = [0] * axes
        self.mute = False
        self.echo = True
        self.counts = [0] * axes
        self.gripper_at = 840
        self.gripper_stop: int | None = None
        self.sequence = 40
        self.queue: list[tuple[float, float, list[int], list[int]]] = []  # begin, end, from, to
        self.waits: list[str] = []
        self.partial = b""
        self.line = MemoryLine(clock)
        clock.add(self)

    def next_at(self) -> float:
        if self.line.waiting():
            return self.clock.now()
        return self.queue[-1][1] if self.waits and self.queue else math.inf

    def step(self) -> None:
        if self.line.waiting():
            data = self.line.read(4096)
            if self.echo:
                self.write(data)
            *lines, self.partial = (self.partial + data).split(b"\n")
            for line in lines:
                self.take(line.decode("latin-1"))
        self.advance()

    def write(self, data: bytes) -> None:
        if not self.mute:
            self.line.reply(data)

    def advance(self) -> None:
        now = self.clock.now()
        while self.queue and self.queue[0][1] <= now:
            self.counts = list(self.queue.pop(0)[3])
        if not self.queue:
            for wait in self.waits:
                self.write(f"R{wait}!\r\n".encode())
            self.waits.clear()

    def at(self) -> list[int]:
        self.advance()
        if not self.queue:
            return [c + o for c, o in zip(self.counts, self.offset, strict=True)]
        begin, end, start, stop = self.queue[0]
        u = min(max((self.clock.now() - begin) / max(end - begin, 1e-9), 0.0), 1.0)
        return [round(a + u * (b - a)) + o for a, b, o in zip(start, stop, self.offset, strict=True)]

    def append(self, seconds: float, target: list[int]) -> None:
        begin = max(self.clock.now(), self.queue[-1][1]) if self.queue else self.clock.now()
        start = self.queue[-1][3] if self.queue else self.counts
        self.queue.append((begin, begin + seconds, list(start), target))
        self.sequence += 1

    def take(self, line: str) -> None:
        self.lines.append(line)
        self.times.append(self.clock.now())
        name = line.split(":")[0].rstrip("?")
        for key, hook in self.hooks.items():
            if name == key or name[:-1] == key:
                answers = hook(line)
                if answers is not None:
                    for answer in answers:
                        self.write(f"{answer}\r\n".encode("latin-1"))
                    return
        answer = self.obey(line)
        if answer is not None:
            self.write(f"{answer}\r\n".encode())

    def obey(self, line: str) -> str | None:
        self.advance()
        name, _, rest = line.partition(":")
        values = [int(v) for v in rest.split(",") if v.lstrip("-").isdigit()]
        match name:
            case "ECHO":
                self.echo = values == [1]
            case "STAMP":
                return f"STAMP={rest}"
            case "VER?":
                return "VER=MARS8 v1.0 build Pi Oct  2 2017 11:06:45"
            case "ST?":
                return f"ST={(0x10 if self.queue else 0) | self.status_bits}"
            case "COORDAP?":
                at = self.at()
                sequence = self.sequence - max(len(self.queue) - 1, 0)
                ms = int(self.clock.now() * 1e3) % 65536
                return "COORDAP=" + ",".join(str(v) for v in (ms, sequence % 32768, 0, *at))
            case "COORDMV":
                self.append(0.2, values)
            case "COORDMVT":
                self.append(values[0] / 1e3, values[1:])
            case "COORDSPLINET":
                end = list(self.queue[-1][3] if self.queue else self.counts)
                order = values[1]
                for axis in range(len(end)):
                    end[axis] += sum(values[2 + axis * order : 2 + (axis + 1) * order])
                self.append(values[0] / 1e3, end)
            case "STOP":
                self.counts = [a - o for a, o in zip(self.at(), self.offset, strict=True)]
                self.queue.clear()
            case "R":
                if self.status_bits:
                    return "FAIL!"
                self.waits.append("")
            case "RG":
                self.waits.append("G")
            case "GG":
                self.gripper_at = (
                    values[0] if self.gripper_stop is None else max(values[0], self.gripper_stop)
                )
            case _ if name[:2] == "AP" and name[2:3] in "ABCDEF" and name.endswith("?"):
                return f"{name[:-1]}={self.at()['ABCDEF'.index(name[2])]}"
            case _ if name.startswith("AP") and name[2:] in ("A?", "B?", "C?", "D?", "E?", "F?"):
                return f"{name[:3]}={self.at()['ABCDEF'.index(name[2])]}"
            case "APG?":
                return f"APG={self.gripper_at}"
            case _ if name.startswith("HH"):
                self.counts["ABCDEF".index(name[2])] = 0
        return None

    def since(self, line: str) -> list[str]:
        """What came after the first such line."""
        return self.lines[self.lines.index(line) + 1 :]

    def unplug(self) -> None:
        """The port goes away."""
        self.line.hang_up()


@pytest.fixture
def clock() -> SteppedClock:
    return SteppedClock()


@pytest.fixture(scope="session")
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture
def fake(clock: SteppedClock) -> FakeUnit:
    return FakeUnit(clock)


@pytest.fixture
def emulator(unit: Unit, clock: SteppedClock) -> Iterator[Emulator]:
    """An emulated unit, close to its marks."""
    with Emulator(unit, clock, options=EmulatorOptions(power_up_deg=near_marks(unit))) as emulator:
        yield emulator


@pytest.fixture
def emulated_mars(emulator: Emulator, unit: Unit, clock: SteppedClock) -> Iterator[Mars]:
    """The emulated unit, homed and at its soft home."""
    with Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        mars.initialise()
        yield mars


@pytest.fixture
def mars(fake: FakeUnit, unit: Unit, clock: SteppedClock) -> Iterator[Mars]:
    """The scripted unit, homed and taken into use."""
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        mars.initialise()
        yield mars
