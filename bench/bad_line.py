"""One damaged line in a motion: is it detected, and does the arm stop before the damaged part begins?

python bench/bad_line.py --there 400 --back 100 --answers 50 --sound 200
python bench/bad_line.py --there 400 --back 0 --answers 100 --sound 50 --echo none
python bench/bad_line.py --there 0 --back 0 --answers 0 --sound 0 --noise 1e-5 1e-4 1e-3 --streams 200
python bench/bad_line.py --there 120 --back 0 --answers 0 --sound 0 --asleep 2
python bench/bad_line.py --there 400 --back 0 --answers 0 --sound 200 --echo byte --end CRLF --order mixed

Driver and emulated units run in stepped time with a one-way latency of 0, 16 and 100 ms (undamaged streams also 200
ms). A third of the damage is in segments 1 to 8; in every tenth case a STOP is also lost. The verdict uses the unit's
own record, every ms: the largest distance of the arm from the certified path (0.02 deg are allowed for rounding).
Motions move all joints for 5 to 8 s, 100 ms a segment, at 0.9 of the speed and 0.5 of the acceleration of the
registers. `--noise` flips random bits in both directions and counts stops per time of motion. `--asleep` pauses the
host after the damaged line is sent. With `--echo byte`, nothing is damaged on the way back.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, Unit, load_unit
from arm.errors import ExecutionStopped
from arm.robot.model import Robot, load_a465
from arm.se3 import Array
from arms.blended_paths import time_blended
from arms.count_paths import departures
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.line.memory import MemoryLine
from driver.execution.progress import StreamOptions
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from plan.trajectory.integer_segments import to_segments
from wire.line_damage import ANSWER, KINDS, SEGMENT, BitErrors, Damage, Kind

UNITS = ("crs93", "crs97")
LATENCIES_S = (0.0, 0.016, 0.1)
ALLOWED_DEG = 0.02
EACH_MS = 3  # of the record
ECHO = ("line", "byte", "none")


@dataclass(frozen=True)
class Case:
    """One stream.

    Attributes:
        way: of the damage: there, back, answers; noise, in both directions; or sound.
        stops: STOPs that are lost too.
        rate: of bytes with a bit turned round, of noise.
        echo, end, order: of the unit, see `driver.emulator.EmulatorOptions`.
        asleep_s: for how long the host sleeps once the damaged line has left.
    """

    way: str
    unit: str
    latency_s: float
    kind: Kind | Literal[""]
    nth: int
    stops: int
    seed: int
    echo: Literal["line", "byte", "none"] = "line"
    rate: float = 0.0
    preload: bool = False
    end: Literal["LF", "CRLF", "CR"] = "LF"
    order: Literal["before", "after", "mixed"] = "before"
    asleep_s: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """How it ended.

    Attributes:
        happened: the damage.
        stopped: by an error, with its reason, at rest or not, message.
        off_deg, off_mm: farthest from the certified path, at any ms; the same of the tool.
        off_s: for how long the arm moved beyond ALLOWED_DEG.
        took_s, dwell_and_took_s: of the motion, without and with what goes before and after it.
    """

    case: Case
    happened: bool
    stopped: bool
    reason: str
    at_rest: bool
    message: str
    off_deg: float
    off_mm: float
    off_s: float
    took_s: float
    whole_s: float
    planned_s: float


def motion(unit: Unit, seed: int) -> CountPath:
    """Three way-points of all joints, from the marks inwards."""
    rng = np.random.default_rng(seed)
    sent = unit.limits()
    limits = Limits(sent.lower, sent.upper, 0.9 * sent.velocity, 0.5 * sent.acceleration)
    begin = unit.positions(np.zeros(6))
    share = np.array([0.0, rng.uniform(0.2, 0.4), rng.uniform(0.6, 0.9)])
    q = begin + np.outer(share, unit.soft_home - begin)
    q[1] += np.radians(rng.uniform(-4.0, 4.0, 6))
    q[-1] = unit.positions(unit.counts(q[-1]))
    return to_segments(time_blended(q, limits), unit, 100, limits=sent)


@cache
def arm() -> Robot:
    """For distances of the tool."""
    return load_a465(0.134112, 0.05)


def off_mm(unit: Unit, counts: Array, nearest: Array) -> float:
    """Between the tool at counts and at the nearest ones of the path, (6,) each."""
    a, b = (arm().T_base_tool(unit.positions(c))[:3, 3] for c in (counts, nearest))
    return float(1e3 * np.linalg.norm(a - b))


def taps(case: Case, segments: int) -> list[Damage | BitErrors]:
    """Of a case: to the unit and to the host, or one of them."""
    if case.way == "noise":
        return [BitErrors(case.rate, 2 * case.seed + k) for k in (0, 1)]
    if not case.kind:  # a sound line
        return []
    what = ANSWER if case.way == "answers" else SEGMENT
    return [Damage(case.kind, min(case.nth, segments), case.seed, case.stops, what)]


def asleep(line: MemoryLine, tapped: list[Damage | BitErrors], case: Case) -> MemoryLine:
    """The line of a host that falls asleep once, when the damaged line has left."""
    if case.asleep_s > 0.0:
        write, slept = line.write, [False]

        def written(data: bytes) -> None:
            write(data)
            if not slept[0] and any(isinstance(tap, Damage) and tap.at_s is not None for tap in tapped):
                slept[0] = True
                line.clock.sleep(case.asleep_s)

        line.write = written  # type: ignore[method-assign]  # of this line alone
    return line


def run(case: Case) -> Outcome:
    """One stream."""
    unit, clock = load_unit(case.unit), SteppedClock()
    path = motion(unit, case.seed)
    near = tuple(float(d) for d in np.degrees(unit.positions(np.ones(6))))
    tapped = taps(case, len(path.segments))
    there, back = (tapped[0], tapped[-1]) if tapped else (None, None)
    if case.way != "noise":
        there, back = (there, None) if case.way == "there" else (None, back)
    error: ExecutionStopped | None = None
    took = 0.0
    options = EmulatorOptions(
        power_up_deg=near,
        echo=case.echo,
        echo_end=case.end,
        echo_order=case.order,
    )
    with (
        Emulator(unit, clock, options=options) as emulator,
        Mars(asleep(emulator.open_line(case.latency_s, there, back), tapped, case), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise(soft_home=False)
        mars.anchor(path.start)
        for tap in tapped:
            tap.armed = True
        begin, began_ms = clock.now(), emulator.now_ms()
        try:
            took = stream(mars, path, options=StreamOptions(preload=case.preload)).duration_s
        except ExecutionStopped as stopped:
            error = stopped
        whole = clock.now() - begin
        clock.sleep(2.0)
        record = emulator.record()
    counts = record.counts[record.time_ms >= began_ms][::EACH_MS]
    curve = path.at(np.arange(0.0, path.duration_s + 1e-3, 1e-3))
    found = departures(unit, counts, curve)
    worst = max(range(len(found)), key=lambda k: found[k][0], default=None)
    state = error.data.get("state", {}) if error is not None else {}
    return Outcome(
        case,
        any(tap.errors > 0 if isinstance(tap, BitErrors) else tap.at_s is not None for tap in tapped),
        error is not None,
        str(error.data.get("reason", "")) if error is not None else "",
        bool(state.get("at_rest")),
        str(error or "")[:400],
        found[worst][0] if worst is not None else 0.0,
        off_mm(unit, counts[worst], found[worst][1]) if worst is not None else 0.0,
        EACH_MS * sum(deg > ALLOWED_DEG for deg, _ in found) / 1e3,
        took,
        whole,
        path.duration_s,
    )


def cases(options: argparse.Namespace) -> list[Case]:
    """All cases, drawn from the seed."""
    rng = np.random.default_rng(options.seed)
    places = list(product(UNITS, LATENCIES_S))
    found = []
    for way, count in (("there", options.there), ("back", options.back), ("answers", options.answers)):
        for i in range(count):
            unit, latency_s = places[i % len(places)]
            kind = KINDS[(i // len(places)) % (6 if way == "answers" else len(KINDS))]
            nth = int(rng.integers(1, 9)) if i % 3 == 0 else int(rng.integers(9, 50))
            stops = int(rng.integers(1, 3)) if way == "there" and i % 10 == 5 else 0
            found.append(Case(way, unit, latency_s, kind, nth, stops, options.seed + i, options.echo))
    for latency_s in (*LATENCIES_S, 0.2):
        found += [
            Case("sound", UNITS[i % 2], latency_s, "", 0, 0, options.seed + i, options.echo)
            for i in range(options.sound)
        ]
    found = [replace(c, end=options.end, order=options.order, asleep_s=options.asleep) for c in found]
    for rate in options.noise:
        for i in range(options.streams):
            unit, latency_s = places[i % len(places)]
            seed = options.seed + i
            found.append(Case("noise", unit, latency_s, "", 0, 0, seed, options.echo, rate, options.preload))
    return found


def commit() -> str:
    """What was measured."""
    here = Path(__file__).parent
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=here, capture_output=True, text=True, check=False
    )
    return said.stdout.strip() or "unknown"


def report(done: list[Outcome]) -> None:
    """The table."""
    print(
        f"{'way':8s}{'one way':>8s}{'n':>5s}{'noticed':>9s}{'at rest':>9s}{'off path':>9s}{'worst deg':>10s}"
        f"{'stops':>7s}{'longer':>8s}{'whole':>8s}"
    )
    for way, latency_s in dict.fromkeys((o.case.way, o.case.latency_s) for o in done):
        own = [o for o in done if (o.case.way, o.case.latency_s) == (way, latency_s)]
        ended = [o for o in own if not o.stopped]
        longer = np.median([o.took_s / o.planned_s for o in ended]) if ended else float("nan")
        whole = np.median([o.whole_s - o.planned_s for o in ended]) if ended else float("nan")
        print(
            f"{way:8s}{1e3 * latency_s:5.0f} ms{len(own):5d}{sum(o.stopped and o.happened for o in own):9d}"
            f"{sum(o.at_rest for o in own):9d}{sum(o.off_deg > ALLOWED_DEG for o in own):9d}"
            f"{max(o.off_deg for o in own):10.4f}{sum(o.stopped for o in own):7d}{longer:8.3f}{whole:7.2f}s"
        )
    damaged = [o for o in done if o.case.way == "there" and o.happened]
    if damaged:
        print(
            f"{'there':10s}{'n':>5s}{'on the path':>12s}{'of these unnoticed':>19s}{'off it':>8s}"
            f"{'stopped moving':>15s}"
            f"{'at the end':>11s}{'never':>6s}{'median s off':>13s}{'worst deg':>10s}{'worst mm':>9s}"
        )
    for kind in (*KINDS, "all"):
        own = [o for o in damaged if kind in (o.case.kind, "all")]
        off = [o for o in own if o.off_deg > ALLOWED_DEG]
        if own:
            ends = sum(o.reason == "position" for o in off)
            print(
                f"{kind:10s}{len(own):5d}{len(own) - len(off):12d}"
                f"{sum(not o.stopped for o in own if o.off_deg <= ALLOWED_DEG):19d}{len(off):8d}"
                f"{sum(o.stopped for o in off) - ends:15d}{ends:11d}{sum(not o.stopped for o in off):6d}"
                f"{np.median([o.off_s for o in off]) if off else 0.0:13.2f}{max(o.off_deg for o in own):10.3f}"
                f"{max(o.off_mm for o in own):9.1f}"
            )
    for rate in dict.fromkeys(o.case.rate for o in done if o.case.way == "noise"):
        own = [o for o in done if o.case.rate == rate]
        hours = sum(o.whole_s for o in own) / 3600.0
        stops = sum(o.stopped for o in own)
        print(
            f"noise {rate:.0e} of bytes: {len(own)} streams, {hours:.3f} h, {stops} stops, {stops / hours:.3g} an "
            f"hour, "
            f"{sum(not o.at_rest for o in own if o.stopped)} not seen at rest, "
            f"{sum(o.off_deg > ALLOWED_DEG for o in own)} off the path, worst {max(o.off_deg for o in own):.3f} deg, "
            f"reasons {dict(Counter(o.reason for o in own if o.stopped))}"
        )
    print("reasons:", dict(Counter(o.reason for o in done if o.stopped)))


def main() -> None:
    """Draw, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--there", type=int, default=400)
    parser.add_argument("--back", type=int, default=100)
    parser.add_argument("--answers", type=int, default=50)
    parser.add_argument("--sound", type=int, default=200, help="at each latency")
    parser.add_argument(
        "--noise", type=float, nargs="*", default=[], help="fractions of bytes with a flipped bit"
    )
    parser.add_argument("--streams", type=int, default=100, help="per fraction of --noise")
    parser.add_argument("--preload", action="store_true", help="with --noise")
    parser.add_argument("--echo", choices=ECHO, default="line")
    parser.add_argument("--end", choices=("LF", "CRLF", "CR"), default="LF")
    parser.add_argument("--order", choices=("before", "after", "mixed"), default="before")
    parser.add_argument(
        "--asleep", type=float, default=0.0, help="pause of the host after the damaged line, s"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    drawn = cases(options)
    print(
        f"Python {platform.python_version()}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; stepped "
        f"time; {len(drawn)} streams, echo {options.echo} {options.end} {options.order}, host asleep "
        f"{options.asleep:g} s, seed {options.seed}; {time.strftime('%Y-%m-%d')}, "
        f"commit {commit()}",
        flush=True,
    )
    began = time.monotonic()
    done: list[Outcome] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for outcome in pool.map(run, drawn):
            done.append(outcome)
            case = outcome.case
            wrong = outcome.off_deg > ALLOWED_DEG
            if case.way != "noise":
                wrong |= outcome.stopped != (outcome.happened and case.way in ("there", "back"))
            wrong |= outcome.stopped and not outcome.at_rest
            if wrong and options.echo != "none":
                print(f"NOT AS IT SHOULD BE: {outcome}", flush=True)
    report(done)
    print(f"{time.monotonic() - began:.0f} s")
    if options.json:
        options.json.write_text(json.dumps([asdict(o) for o in done], indent=1) + "\n")


if __name__ == "__main__":
    main()
