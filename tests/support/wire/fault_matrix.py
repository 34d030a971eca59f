"""Faults by moments: what is expected of each, written down first, and one case run at the wire.

Outcomes:

finishes   nothing is lost: the motion ends at its target, to the count.
told       the same, and the result says what is wrong (a grasp that missed).
stops      `ExecutionStopped` with a reason; the arm was seen to stand, and stays there.
unknown    `ExecutionStopped`; the link is gone, so nobody knows; the arm plays out no more than the look-ahead.
refuses    before anything moves: `ImpossibleError` or `ExecutionStopped`; the arm never moved.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, load_unit
from arm.errors import A465Error, ExecutionStopped, ImpossibleError
from arm.se3 import Array
from arms.blended_paths import time_blended
from arms.count_paths import off_path_deg
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from plan.trajectory.integer_segments import to_segments

MOMENTS = ("idle", "homing", "streaming", "gripping", "waiting")
F, T, S, U, R = "finishes", "told", "stops", "unknown", "refuses"
FS = frozenset((F, S))  # the seed decides what is hit, or when
# Per fault: what is expected at each of MOMENTS.
EXPECTED: dict[str, tuple[frozenset[str] | str, ...]] = {
    "arm power off": (R, S, S, S, S),
    "motion stop": (R, S, S, S, S),
    "axis error": (R, S, S, S, S),
    "FAIL! to a wait": (S, S, S, S, S),
    "answer lost": (F, F, FS, F, F),  # an echo is one of the lines that come back
    # Three of ten; that of a query is asked for again. Too many in a row, and nothing is known of the jaws.
    "echo garbled": (frozenset((R, S)), S, S, FS | {U}, FS),
    "answers delayed": (FS, F, FS, F, F),  # an echo beyond the measured round trip is late
    "bytes split": (F, F, F, F, F),
    "noise": (F, F, FS, F, F),
    "stray R!": (F, F, F, F, F),
    "stray FAIL!": (F, FS, S, FS, S),
    "line lost": (FS, FS, FS, FS, FS),  # it may be a query
    "port gone": (R, U, U, U, U),
    "port gone and back": (R, U, U, U, U),
    "axis stuck": (S, S, S, F, S),
    "axis drifts": (R, FS, S, F, S),
    "arm lags": (F, F, F, F, F),
    "grasp missed": (F, F, F, T, F),
    "queue overflows": (S, F, FS, F, FS),
    "R! early": (F, F, F, F, F),
    "unit switched off and on": (R, S, S, S, S),
}
NAMES = tuple(EXPECTED)
# Where the arm may leave the certified path. Mechanics: the arm does not do what the unit tells it. Unseen: the unit
# drops what came back right.
MECHANICS = ("axis stuck", "axis drifts", "arm lags")
UNSEEN = ("queue overflows",)
OFF_DEG = 0.02  # rounding


@dataclass(frozen=True)
class Outcome:
    """How a case ended.

    Attributes:
        name, moment, seed: of the case.
        seen: of the outcomes above, or what else came (a traceback is a defect).
        message: of the error, or "".
        after_s: controller seconds from the fault to the end; 0 where it never happened.
        moved_after: most counts that an axis moved after the driver was told that the arm stands.
        played_s: controller seconds for which the arm went on after a lost link.
        off_deg: farthest that the arm was from the certified path, from when it begins to after its end.
        log_whole: every record of the wire log is one sound line.
    """

    name: str
    moment: str
    seed: int
    seen: str
    message: str
    after_s: float
    moved_after: int
    played_s: float
    off_deg: float
    log_whole: bool

    @property
    def expected(self) -> frozenset[str]:
        """What is allowed."""
        wanted = EXPECTED[self.name][MOMENTS.index(self.moment)]
        return wanted if isinstance(wanted, frozenset) else frozenset((wanted,))

    @property
    def as_expected(self) -> bool:
        """Whether the outcome is, and the certificate held, nothing moved after a stop, and the log is whole."""
        still = self.moved_after <= 2 or "drift" in self.name or "lag" in self.name
        return self.seen in self.expected and self.certified and still and self.log_whole

    @property
    def certified(self) -> bool:
        """Whether the arm was on its certified path all the time, or may have left it."""
        return self.off_deg <= OFF_DEG or self.name in (*MECHANICS, *UNSEEN)


def fault_of(name: str, moment: str, when: When, rng: np.random.Generator) -> Fault:
    """The fault of a case; what is free is drawn."""
    axis = "ABCDEF"[int(rng.integers(6))]
    match name:
        case "arm power off":
            return Fault("power_off", when)
        case "motion stop":
            return Fault("motion_stop", when)
        case "axis error":
            return Fault("axis_error", when, axis=axis)
        case "FAIL! to a wait":
            return Fault("fail_reply", when)
        case "answer lost":
            return Fault("lost_bytes", when, direction="to_host", line=1)
        case "echo garbled":
            return Fault(
                "garbled_bytes", when, direction="echo", probability=0.3, seed=int(rng.integers(1000))
            )
        case "answers delayed":
            delay = float(rng.uniform(20.0, 300.0))
            return Fault("delayed_bytes", when, direction="to_host", delay_ms=delay, for_ms=2000.0)
        case "bytes split":
            return Fault("split_bytes", when, direction="both", delay_ms=float(rng.uniform(0.0, 20.0)))
        case "noise":
            return Fault("noise", when, count=int(rng.integers(1, 200)), seed=int(rng.integers(1000)))
        case "stray R!":
            return Fault("stray_line", when, text="R!")
        case "stray FAIL!":
            return Fault("stray_line", when, text="FAIL!")
        case "line lost":
            return Fault("lost_bytes", when, direction="to_unit", line=1)
        case "port gone":
            return Fault("port_gone", when)
        case "port gone and back":
            return Fault("port_gone", when, back_after_s=float(rng.uniform(0.1, 1.0)))
        case "axis stuck":
            return Fault("stuck_axis", when, axis="B" if moment == "homing" else axis)
        case "axis drifts":
            return Fault("drift", when, axis=axis, counts_per_s=20_000.0, most_counts=6000)
        case "arm lags":
            return Fault("lag", when, lag_ms=float(rng.uniform(10.0, 60.0)))
        case "grasp missed":
            return Fault("missed_grasp", when)
        case "queue overflows":
            return Fault("queue_overflow", when, queue=int(rng.integers(3, 6)))
        case "R! early":
            return Fault("early_ready", when)
    return Fault("power_cycle", when, for_ms=float(rng.uniform(0.0, 500.0)), seed=int(rng.integers(1000)))


def when_of(name: str, moment: str, rng: np.random.Generator) -> When:
    """When it happens, at that moment."""
    late = float(rng.uniform(0.0, 60.0))
    match moment:
        case "homing":
            return When(
                after_ms=late, command="HH", nth=1 if name == "axis stuck" else int(rng.integers(1, 5))
            )
        case "streaming" if name == "line lost":
            return When(command="COORDSPLINET", nth=int(rng.integers(4, 12)))
        case "streaming":
            return When(after_ms=late, segment=int(rng.integers(3, 12)))
        case "gripping":
            return When(after_ms=0.0 if name in ("R! early", "grasp missed") else late, command="G")
        case "waiting":
            return When(after_ms=0.0 if name == "R! early" else late, command="R")
    return When(after_ms=late)


class Object:
    """Something between the jaws: they stop at half their stroke."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        middle = 471
        return max(to_adc, middle) if to_adc < from_adc else to_adc


@lru_cache(maxsize=1)
def motion() -> CountPath:
    """About three seconds of all joints, from the marks inwards, rest to rest."""
    unit = load_unit("crs93")
    sent = unit.limits()
    limits = Limits(sent.lower, sent.upper, 0.9 * sent.velocity, 0.5 * sent.acceleration)
    inwards = np.sign(unit.counts(unit.soft_home)) * np.sign(unit.counts_per_rad)
    q: Array = unit.positions(np.zeros(6)) + np.outer([0.0, 0.6, 1.5], inwards * sent.velocity * 1.2)
    q[1] += 0.1 * sent.velocity
    q[-1] = unit.positions(unit.counts(q[-1]))
    return to_segments(time_blended(q, limits), unit, 100, limits=sent)


def run_case(name: str, moment: str, seed: int, folder: Path) -> Outcome:
    """One fault at one moment, at the wire, in stepped time."""
    rng = np.random.default_rng([seed, NAMES.index(name), MOMENTS.index(moment)])
    unit = load_unit("crs93")
    near_marks = np.degrees(unit.positions(np.zeros(6))) + rng.uniform(-1.0, 1.0, 6)
    clock = SteppedClock()
    options = EmulatorOptions(power_up_deg=tuple(float(d) for d in near_marks), seed=seed)
    fault = fault_of(name, moment, when_of(name, moment, rng), rng)
    log = folder / f"{seed}-{NAMES.index(name)}-{moment}.jsonl"
    message, stood = "", None
    began_ms: list[int] = []
    with Emulator(unit, clock, plant=Object(), options=options) as emulator:
        try:
            with WireLog(log, clock) as wire, Mars(emulator.open_line(), unit, clock, wire) as mars:
                mars.identify()
                seen = _act(moment, mars, emulator, fault, began_ms)
        except ImpossibleError as error:
            seen, message, stood = R, str(error), emulator.counts()
        except ExecutionStopped as error:
            state = error.data.get("state")
            at_rest = isinstance(state, dict) and bool(state["at_rest"])
            seen, message, stood = S if at_rest else U, str(error), emulator.counts()
        except A465Error as error:
            seen, message = type(error).__name__, str(error)
        ended = emulator.now_ms()
        happened = [event.time_ms for event in emulator.faults if not event.over]
        at = happened[0] if happened else ended
        clock.sleep(4.0 if seen == U else 0.5)
        moved = 0 if stood is None else max(abs(a - b) for a, b in zip(stood, emulator.counts(), strict=True))
        record = emulator.record()
        last = int(record.time_ms[-1]) if len(record.time_ms) else 0
        off_deg = 0.0
        if began_ms and (moving := record.time_ms >= began_ms[0]).any():
            curve = motion().at(np.arange(0.0, motion().duration_s + 1e-3, 1e-3))
            off_deg = off_path_deg(unit, record.counts[moving], curve)
    if moment == "idle" and seen in (S, U) and last <= at:
        seen = R
    return Outcome(
        name=name,
        moment=moment,
        seed=seed,
        seen=seen,
        message=message,
        after_s=(ended - at) / 1e3,
        moved_after=0 if seen == U else moved,
        played_s=max(last - at, 0) / 1e3 if seen == U else 0.0,
        off_deg=off_deg,
        log_whole=_whole(log),
    )


def _act(moment: str, mars: Mars, emulator: Emulator, fault: Fault, began_ms: list[int]) -> str:
    """Do what the moment is in, with the fault in it; the outcome if nothing is raised. Notes when a motion begins."""
    if moment == "homing":
        emulator.inject(fault)
        mars.initialise(home=True, soft_home=False)
        return F if max(abs(c) for c in emulator.counts()) <= 25 else "not at its marks"
    mars.initialise(home=True, soft_home=False)
    mars.anchor(motion().start)  # so that the next wait is the stream's
    emulator.inject(fault)
    if moment == "gripping":
        result = mars.gripper(1.0)
        return F if result.stalled else T
    if moment == "idle":
        mars.clock.sleep(0.6)
    path = motion()
    began_ms.append(emulator.now_ms())
    sent = stream(mars, path)
    right = (
        sent.path == path and max(abs(a - b) for a, b in zip(emulator.counts(), path.end, strict=True)) <= 2
    )
    return F if right else "not at its end"


def _whole(log: Path) -> bool:
    """Every record is one sound line."""
    text = log.read_text()
    try:
        records = [json.loads(line) for line in text.splitlines()]
    except json.JSONDecodeError:
        return False
    return text.endswith("\n") and all({"t", "kind"} <= set(record) for record in records)
