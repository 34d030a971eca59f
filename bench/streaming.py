"""Random motions through the driver and the emulated unit at 19200 baud; and random plans against every limit.

python bench/streaming.py --streams 1000 --plans 10000

Streams: motions of all joints are planned (TOPP-RA at the given fractions of the registers, integer cubics), streamed
by the driver over a line in memory with that latency, in stepped time, and compared with what the emulated unit did at
every ms. Starved means that the arm stopped before the last segment.
Plans: segments are encoded, decoded as the unit does, and compared with the plan to the count: positions, velocities
and accelerations at their extremes inside segments, joins by the unit's rule for vertices.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, Unit, load_unit
from arm.se3 import Array
from arms.blended_paths import time_blended
from arms.count_paths import off_path_deg
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.commands import Interpreter
from driver.emulator.unit.machine import Machine
from driver.line.protocol import VERTEX_STEPS, encode, encode_segment
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.integer_segments import to_segments
from plan.trajectory.timing import time_path

ROOM = np.radians(2.0)  # that way-points keep from the joints' limits
CHUNK = 50  # streams of one emulated unit, plans of one task


@dataclass(frozen=True)
class Streamed:
    """One streamed motion.

    Attributes:
        planned_s, took_s: without the dwell.
        off_deg: farthest that any axis was from the nearest point of the planned path.
        starved_ms: time that the arm stood while segments were still to come.
        ahead_s: most motion that the unit held.
    """

    planned_s: float
    took_s: float
    off_deg: float
    starved_ms: int
    ahead_s: float


def main() -> None:
    """Draw, stream, compare, print."""
    options = _options()
    print(
        f"Python {platform.python_version()}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; unit "
        f"{options.unit}; fractions {options.velocity:g} of velocity, {options.acceleration:g} of acceleration; "
        f"segments of {options.segment_ms} ms; stepped time, one-way latency {1e3 * options.latency_s:g} ms; "
        f"seed {options.seed}",
        flush=True,
    )
    began = time.monotonic()
    report: dict[str, object] = {}
    if options.streams:
        report["streams"] = streams(options)
    if options.plans:
        report["plans"] = plans(options)
    print(f"{time.monotonic() - began:.0f} s")
    if options.json:
        options.json.write_text(json.dumps(report, indent=1) + "\n")


def streams(options: argparse.Namespace) -> dict[str, float]:
    """Stream random motions; the table's figures."""
    done: list[Streamed] = []
    for first in range(0, options.streams, CHUNK):
        seeds = range(options.seed + first, options.seed + min(first + CHUNK, options.streams))
        done += streamed(options, list(seeds))
        print(f"{len(done)} streamed, {sum(s.starved_ms > 0 for s in done)} starved", flush=True)
    longer = np.array([s.took_s / s.planned_s for s in done])
    off = np.array([s.off_deg for s in done])
    figures = {
        "streams": len(done),
        "planned_s_median": float(np.median([s.planned_s for s in done])),
        "longer_median": float(np.median(longer)),
        "longer_p99": float(np.percentile(longer, 99)),
        "longer_max": float(longer.max()),
        "off_deg_max": float(off.max()),
        "starved": sum(s.starved_ms > 0 for s in done),
        "ahead_s_max": max(s.ahead_s for s in done),
    }
    _table("streams", figures)
    return figures


def streamed(options: argparse.Namespace, seeds: list[int]) -> list[Streamed]:
    """Motions of these seeds, one after the other on one unit."""
    unit = load_unit(options.unit)
    at_mark = tuple(float(d) for d in np.degrees(unit.positions(np.zeros(6))))
    clock = SteppedClock()
    found = []
    with (
        Emulator(unit, clock, options=EmulatorOptions(power_up_deg=at_mark)) as emulator,
        Mars(emulator.open_line(options.latency_s), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise(home=True)
        for seed in seeds:
            path = planned(unit, seed, mars.counts(), options)
            sent = stream(mars, path)
            record = emulator.record()
            own = record.time_ms > record.time_ms[-1] - int(sent.duration_s * 1e3) - 2000
            counts, times = record.counts[own], record.time_ms[own]
            begin = _first_moved(counts, path)
            # the arm stood where the record has a gap
            gaps = np.diff(times[begin:])
            found.append(
                Streamed(
                    planned_s=path.duration_s,
                    took_s=float(times[-1] - times[begin]) / 1e3,
                    off_deg=off_path_deg(unit, counts[begin:], path.sample()),
                    starved_ms=int(gaps[gaps > 1].sum()),
                    ahead_s=sent.ahead_s,
                )
            )
    return found


def _first_moved(counts: Array, path: CountPath) -> int:
    """Index of the last sample at the start of the path before the arm leaves it."""
    at_start = np.flatnonzero((counts == np.array(path.start)).all(axis=1))
    return int(at_start[-1]) if len(at_start) else 0


def planned(unit: Unit, seed: int, start: tuple[int, ...], options: argparse.Namespace) -> CountPath:
    """A random motion of all joints through a few way-points, from rest to rest."""
    rng = np.random.default_rng([options.seed, seed])
    sent = unit.limits()
    limits = Limits(
        sent.lower, sent.upper, sent.velocity * options.velocity, sent.acceleration * options.acceleration
    )
    q = [unit.positions(start)]
    for _ in range(int(rng.integers(2, 5))):
        step = rng.normal(size=6) * limits.velocity * rng.uniform(0.3, 1.5)
        q.append(np.clip(q[-1] + step, limits.lower + ROOM, limits.upper - ROOM))
    q[-1] = unit.positions(unit.counts(q[-1]))
    timed = time_path if str(rng.choice(["blend", "stop"])) == "stop" else time_blended
    trajectory = timed(np.array(q), limits)
    return to_segments(trajectory, unit, options.segment_ms, limits=sent)


def plans(options: argparse.Namespace) -> dict[str, float]:
    """Compare random plans with every limit; the table's figures."""
    chunks = [(first, min(first + CHUNK, options.plans), options) for first in range(0, options.plans, CHUNK)]
    worst: dict[str, float] = {}
    with ProcessPoolExecutor(options.jobs) as pool:
        for found in pool.map(compared, chunks):
            for name, value in found.items():
                total = name in ("plans", "segments", "differing")
                worst[name] = worst.get(name, 0.0) + value if total else max(worst.get(name, -np.inf), value)
    _table("plans", worst)
    return worst


def compared(chunk: tuple[int, int, argparse.Namespace]) -> dict[str, float]:
    """The worst over plans of some seeds."""
    first, last, options = chunk
    unit = load_unit(options.unit)
    limits = unit.limits()
    start = tuple(int(c) for c in unit.counts(unit.soft_home))
    worst: dict[str, float] = {"plans": 0.0, "segments": 0.0, "differing": 0.0}
    for seed in range(first, last):
        path = planned(unit, seed, start, options)
        extremes = segment_extremes(path, unit)
        vertex = VERTEX_STEPS * 1e-3 * limits.acceleration
        ends = np.stack([path.segments[0].derivative(0.0), path.segments[-1].derivative(1.0)]) / np.abs(
            unit.counts_per_rad
        )
        found = {
            "outside_deg": float(
                np.degrees(
                    max(
                        (limits.lower - extremes.lower).max(),
                        (extremes.upper - limits.upper).max(),
                    )
                )
            ),
            "velocity_over_limit": float((extremes.velocity / limits.velocity).max()),
            "acceleration_over_limit": float((extremes.acceleration / limits.acceleration).max()),
            "joins_over_vertex_rule": float(
                max((extremes.jumps / vertex).max(initial=0.0), (np.abs(ends) / vertex).max())
            ),
        }
        for name, value in found.items():
            worst[name] = max(worst.get(name, -np.inf), value)
        worst["plans"] += 1
        worst["segments"] += len(path.segments)
        worst["differing"] += _differing(unit, path)
    return worst


def _differing(unit: Unit, path: CountPath) -> int:
    """Segments that the unit reads otherwise than they were planned."""
    machine = Machine(unit, None, EmulatorOptions(queue=len(path.segments) + 1))
    machine.path.at = path.start
    interpreter = Interpreter(machine)
    interpreter.take(encode("COORDGRP", *unit.axes))
    knots = path.knots()
    for segment, end in zip(path.segments, knots[1:].tolist(), strict=True):
        interpreter.take(encode_segment(segment, end))
    queued = list(machine.path.queue)
    differing = abs(len(queued) - len(path.segments)) + len(interpreter.ignored)
    for (begin, end), got in zip(pairwise(knots.tolist()), queued, strict=False):
        differing += list(got.start) != begin or list(got.end) != end
    for segment, got in zip(path.segments, queued, strict=False):
        rows = tuple(tuple(reversed(axis)) for axis in zip(*segment.coefficients, strict=True))
        differing += got.poly != rows
    return differing


def _table(title: str, figures: dict[str, float]) -> None:
    print(title)
    for name, value in figures.items():
        print(f"  {name:26s} {value:.6g}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--streams", type=int, default=1000)
    parser.add_argument("--plans", type=int, default=10_000)
    parser.add_argument("--unit", default="crs93")
    parser.add_argument(
        "--velocity", type=float, default=0.9, help="planning speed as a fraction of the registers"
    )
    parser.add_argument("--acceleration", type=float, default=0.5)
    parser.add_argument("--segment-ms", type=int, default=100)
    parser.add_argument("--latency-s", type=float, default=0.0, help="one-way latency of the line")
    parser.add_argument("--jobs", type=int, default=2, help="processes of the plans")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
