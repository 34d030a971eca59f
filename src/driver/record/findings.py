"""What a recording tells of a unit, a function for each thing that the code assumes.

A finding is a text, and whether it agrees: None if the recording does not tell. A function that returns None says that
the assumption cannot apply to this unit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from statistics import median

from arm.controller.unit import Unit
from driver.execution.rest import STILL_COUNTS
from driver.line.link import ANSWER_S
from driver.line.protocol import (
    CLOCK_RANGE_MS,
    Answer,
    MalformedAnswer,
    Status,
    parse_integer,
    parse_position,
    parse_reply,
    parse_status,
)
from driver.line.unit_time import DRIFT, LARGEST_RATE
from driver.mars.gripper import STILL_ADC
from driver.mars.identity import GRIPPER_AXES, axis_of_gripper
from driver.record.exchanges import Exchange, StampForm, exchanges, form_of, heard_in, lines_in
from driver.record.questions import AXES, UNKNOWN, register_kinds
from driver.record.tape import STEP
from driver.record.unit_record import UnitRecord

_24_BITS = 2**23
_SHOWN = 60  # characters of what was found

Finding = tuple[str, bool | None]
NOTHING: Finding = ("not recorded", None)


class Found:
    """What a recording tells, by the question."""

    def __init__(self, record: UnitRecord, unit: Unit) -> None:
        self.record, self.unit = record, unit
        self.exchanges = exchanges(record.events)

    def reached(self, step: str) -> bool:
        """Whether a step was begun."""
        return any(event.kind == STEP and event.data == step for event in self.record.events)

    def of(self, step: str, begins: str = "") -> list[Exchange]:
        """The exchanges of a step whose lines begin so."""
        return [e for e in self.exchanges if e.step == step and e.line.startswith(begins)]

    def asked(self, line: str) -> Exchange | None:
        """The exchange of a question that is asked once, if it was."""
        return next((e for e in self.of("questions") if e.line == line), None)

    @cached_property
    def _answers(self) -> dict[str, str]:
        lines = lines_in(self.record.events, "questions")
        replies = [reply for _, line in lines if isinstance(reply := parse_reply(line), Answer)]
        return {reply.key: reply.text for reply in replies}

    def answer(self, key: str) -> str | None:
        """The answer to a question; a late one may have come behind the stamp that follows it."""
        return self._answers.get(key)

    def forms(self, on: bool) -> list[StampForm]:
        """How stamps were answered with the echo on or off."""
        return [form_of(e) for e in self.of(f"echo {'on' if on else 'off'}", "STAMP:")]

    @cached_property
    def rest(self) -> dict[str, list[tuple[float, str]]]:
        """Answers at rest by their keys, with their times."""
        series: dict[str, list[tuple[float, str]]] = {}
        for time_s, line in lines_in(self.record.events, "rest"):
            if isinstance(reply := parse_reply(line), Answer):
                series.setdefault(reply.key, []).append((time_s, reply.text))
        return series

    def counts(self, key: str) -> list[int]:
        """Whole numbers among the answers at rest to a key."""
        return [int(text) for _, text in self.rest.get(key, []) if _whole(text)]


def _whole(text: str) -> bool:
    try:
        return -_24_BITS <= parse_integer(text) < _24_BITS
    except MalformedAnswer:
        return False


def _shown(text: str) -> str:
    said = repr(text)
    return said if len(said) <= _SHOWN else f"{said[: _SHOWN - 3]}..."


def _most(forms: list[StampForm]) -> StampForm:
    """The form that most stamps have, as one may be damaged."""
    kind = Counter((f.echo, f.answered) for f in forms).most_common(1)[0][0]
    return next(f for f in forms if (f.echo, f.answered) == kind)


# -- one finding each; None: the assumption cannot apply


def unasked(found: Found) -> Finding:
    if not found.reached("as found"):
        return NOTHING
    heard = "".join(text for _, text in heard_in(found.record.events, "before"))
    return (_shown(heard), False) if heard else ("nothing", True)


def in_time(found: Found) -> Finding:
    stamps = [e for step in ("echo off", "answer times") for e in found.of(step, "STAMP:")]
    if not stamps:
        return NOTHING
    times = [took for e in stamps if (took := e.answered_s()) is not None]
    if not times:
        return f"none of {len(stamps)} stamps answered", False
    said = f"median {1e3 * median(times):.0f} ms, longest {1e3 * max(times):.0f} ms, of {len(times)}"
    late = len(stamps) - len(times)
    return (f"{said}; {late} not answered", False) if late else (said, max(times) <= ANSWER_S)


def column(found: Found) -> Finding:
    if not (forms := found.forms(False)):
        return NOTHING
    form = _most(forms)
    if form.prompt:
        return f"other text: {_shown(form.prompt)}", False
    return ("no other text", True) if form.answered and form.echo != "odd" else (_shown(form.text), False)


def line_end(found: Found) -> Finding:
    if not (forms := found.forms(False)):
        return NOTHING
    end = _most(forms).answer_end
    return end or "not found", end == "CR LF" if end else None


def in_order(found: Found) -> Finding:
    sent = [e.line for e in found.of("burst, echo off")]
    if not sent:
        return NOTHING
    lines = [line for _, line in lines_in(found.record.events, "burst, echo off")]
    wanted = [line.replace(":", "=") for line in sent]
    came = [line for line in lines if line in wanted]
    return (
        (f"{len(came)} of {len(sent)} sent together, in order", True)
        if came == wanted
        else (_shown(str(lines)), False)
    )


def silent_command(found: Found) -> Finding:
    commands = found.of("echo off", "ECHO:0")
    if not commands:
        return NOTHING
    # the echo of its own line may be cut off where it takes effect
    lines = [line for line in commands[0].text.splitlines() if not "ECHO:0".startswith(line)]
    return (_shown(commands[0].text), False) if lines else ("no answer", True)


def identification(found: Found) -> Finding:
    asked = [e for step in ("echo on", "echo off") for e in found.of(step, "VER?")]
    if not asked:
        return NOTHING
    texts = [e.answer for e in asked if e.answer is not None]
    if not texts:
        return _shown(asked[-1].text), False
    return _shown(texts[-1]), texts[-1].split()[:1] == [found.unit.firmware]


def no_echo(found: Found) -> Finding:
    if not (forms := found.forms(False)):
        return NOTHING
    form = _most(forms)
    return ("no echo", True) if form.echo == "none" else (f"{form.echo}: {_shown(form.text)}", False)


def echo(found: Found) -> Finding:
    if not (forms := found.forms(True)):
        return NOTHING
    form = _most(forms)
    whole = sum(f.echo == form.echo for f in forms)
    if form.echo in ("before", "after"):
        said = f"whole, {form.echo} the answer, end {form.echo_end}; {whole} of {len(forms)}"
        return said, whole == len(forms)
    if form.echo == "interleaved":
        said = f"whole, byte by byte between those of the answer; {whole} of {len(forms)}"
        return said, whole == len(forms)
    return ("no echo", False) if form.echo == "none" else (f"odd: {_shown(form.text)}", False)


def measured(found: Found) -> Finding:
    manners = found.record.manners
    on, off = found.forms(True), found.forms(False)
    if manners is None or not on or not off:
        return NOTHING
    adapter = _most(off).echo not in ("none", "odd")
    whole = _most(on).echo in ("before", "after", "interleaved")
    said = "it echoes" if manners["echoes"] else "an adapter echoes" if manners["adapter"] else "no echo"
    mixed = manners["takes_turns"]
    agrees = (manners["echoes"], manners["adapter"]) == (whole and not adapter, adapter)
    return f"{said}{', interleaved with answers' if mixed else ''}", agrees


def unknown_query(found: Found) -> Finding:
    if (exchange := found.asked(UNKNOWN)) is None:
        return NOTHING
    lines = [line for line in exchange.text.splitlines() if line and line != UNKNOWN]
    return (_shown(exchange.text), False) if lines else ("no answer", True)


def status(found: Found) -> Finding:
    if (exchange := found.asked("ST?")) is None:
        return NOTHING
    if (text := found.answer("ST")) is None:
        return _shown(exchange.text), False
    try:
        status = parse_status(text)
    except MalformedAnswer:
        return _shown(text), False
    return ", ".join([str(status.word), *status.faults()]), True


def idle(found: Found) -> Finding:
    words = [int(text) for _, text in found.rest.get("ST", []) if _whole(text)]
    if not words:
        return NOTHING
    busy = sum(Status(word).busy for word in words)
    bits = sorted({bit for word in words for bit in range(18) if word >> bit & 1})
    said = f"bits set: {', '.join(map(str, bits)) or 'none'}"
    return (f"busy in {busy} of {len(words)}; {said}", False) if busy else (said, True)


def axes(found: Found) -> Finding:
    if not any(found.asked(f"AP{axis}?") for axis in AXES):
        return NOTHING
    answers = {axis: found.answer(f"AP{axis}") for axis in AXES}
    answering = [axis for axis in AXES if answers[axis] is not None]
    odd = [f"AP{axis}={text}" for axis, text in answers.items() if text is not None and not _whole(text)]
    said = f"answered: {' '.join(answering) or 'none'}" + (f"; {_shown(', '.join(odd))}" if odd else "")
    return said, not odd and set(found.unit.axes) <= set(answering)


def gripper(found: Found) -> Finding:
    if not all(found.asked(f"AP{axis}?") for axis in GRIPPER_AXES):
        return NOTHING
    answers = {axis: found.answer(f"AP{axis}") for axis in GRIPPER_AXES}
    said = ", ".join(f"AP{a} {'unanswered' if t is None else _shown(t)[1:-1]}" for a, t in answers.items())
    return said, True if axis_of_gripper(answers) is not None else None


def group(found: Found) -> Finding:
    if (exchange := found.asked("COORDAP?")) is None:
        return NOTHING
    if (text := found.answer("COORDAP")) is None:
        odd = exchange.text.replace("COORDAP?", "").strip()
        return (_shown(exchange.text), False) if odd else ("no answer", True)
    try:
        parse_position(text, len(found.unit.axes))
    except MalformedAnswer as error:
        return f"{_shown(text)}: {error}"[:120], False
    return _shown(text), True


def clock(found: Found) -> Finding | None:
    readings = found.rest.get("COORDAP", [])
    if len(readings) < 2:
        return None
    times = [(at, int(head)) for at, text in readings if _whole(head := text.partition(",")[0])]
    steps = [((b[1] - a[1]) % CLOCK_RANGE_MS, b[0] - a[0]) for a, b in pairwise(times)]
    host_s = sum(s for _, s in steps)
    if host_s <= 0.0:
        return NOTHING
    rate = sum(ms for ms, _ in steps) / 1e3 / host_s
    fits = all(0 <= ms < CLOCK_RANGE_MS for _, ms in times)
    return f"{rate:.4f} s of the unit per s of this host", fits and 1.0 - DRIFT <= rate <= LARGEST_RATE


def registers(found: Found) -> Finding:
    names = [f"{kind}{axis}" for kind, axes in register_kinds() for axis in axes]
    asked = [name for name in names if found.asked(f"{name}?") is not None]
    if not asked:
        return NOTHING
    read = {name: text for name in asked if (text := found.answer(name)) is not None}
    if not read:
        return f"none of {len(asked)} asked is answered", True
    said = f"{len(read)} read: " + ", ".join(f"{name}={text}" for name, text in read.items())
    return said[: 2 * _SHOWN], all(_number(text) for text in read.values())


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def still(found: Found) -> Finding:
    return largest_change(found, found.unit.axes, lambda most: most <= STILL_COUNTS)


def jaws(found: Found) -> Finding | None:
    axes = [axis for axis in GRIPPER_AXES if found.counts(f"AP{axis}")]
    return largest_change(found, axes, lambda most: most < STILL_ADC) if axes else None


def largest_change(found: Found, axes: list[str] | tuple[str, ...], good: Callable[[int], bool]) -> Finding:
    """The largest change from reading to reading, and the range over the time, of each axis."""
    series = {axis: values for axis in axes if len(values := found.counts(f"AP{axis}")) > 1}
    if not series:
        return NOTHING
    steps = {axis: max(abs(b - a) for a, b in pairwise(v)) for axis, v in series.items()}
    said = ", ".join(
        f"{axis} {step} ({max(series[axis]) - min(series[axis])})" for axis, step in steps.items()
    )
    return f"{said}; in brackets the range", all(map(good, steps.values()))


def whole_answers(found: Found) -> Finding:
    sent = [e.line for e in found.of("rest")]
    if not sent:
        return NOTHING
    asked = len(sent)
    good = sum(all(map(_whole, text.split(","))) for readings in found.rest.values() for _, text in readings)
    echoes = set(sent)
    odd = sum(line not in echoes for _, line in lines_in(found.record.events, "rest")) - good
    said = f"{good} of {asked} whole" + (f", {odd} other lines" if odd else "")
    return said, good == asked and not odd
