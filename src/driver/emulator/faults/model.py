"""Faults of an emulated unit or its line as data: kind, trigger and duration.

The kinds are those that a driver must survive: of power, of an axis, of the line, of the gripper and of the queue. The
unit behaves as docs/sources.md says: "Status word and recovery", "Coordinated motion", "What is not known of the
controller". Each fault draws its random choices from its own seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Literal, get_args

from arm.errors import InputError
from driver.line.protocol import COMMANDS

Kind = Literal[
    "power_off", "motion_stop", "axis_error", "fail_reply", "lost_bytes", "garbled_bytes", "delayed_bytes",
    "split_bytes", "noise", "stray_line", "port_gone", "stuck_axis", "drift", "lag", "missed_grasp",
    "queue_overflow", "early_ready", "power_cycle",
]  # fmt: skip
Direction = Literal["to_unit", "to_host", "both", "echo", "parser"]

KINDS: tuple[Kind, ...] = get_args(Kind)
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)
LINE_KINDS = ("lost_bytes", "garbled_bytes", "delayed_bytes", "split_bytes")
AXES = "ABCDEFGH"

_BYTES = ("direction", "probability", "byte", "line", "seed", "for_ms")
USED: dict[Kind, tuple[str, ...]] = {  # fields of each kind, besides kind and when
    "power_off": ("for_ms",),
    "motion_stop": ("for_ms",),
    "axis_error": ("axis",),
    "fail_reply": ("count",),
    "lost_bytes": _BYTES,
    "garbled_bytes": _BYTES,
    "delayed_bytes": ("direction", "probability", "line", "seed", "for_ms", "delay_ms"),
    "split_bytes": ("direction", "probability", "line", "seed", "for_ms", "delay_ms"),
    "noise": ("count", "seed"),
    "stray_line": ("text",),
    "port_gone": ("back_after_s",),
    "stuck_axis": ("axis", "for_ms"),
    "drift": ("axis", "for_ms", "counts_per_s", "most_counts"),
    "lag": ("lag_ms", "for_ms"),
    "missed_grasp": ("count",),
    "queue_overflow": ("queue", "count", "for_ms"),
    "early_ready": ("count",),
    "power_cycle": ("for_ms", "seed"),
}
NEEDED: dict[Kind, tuple[str, ...]] = {
    "axis_error": ("axis",),
    "stuck_axis": ("axis",),
    "drift": ("axis", "counts_per_s"),
    "lag": ("lag_ms",),
    "delayed_bytes": ("delay_ms",),
    "stray_line": ("text",),
}


# Names of lines that can trigger a fault: the driver's, and that of another client.
KNOWN = (*COMMANDS, "COORDRELMVT")


@dataclass(frozen=True)
class When:
    """Trigger of a fault. By default the first byte of a client, or at once if the fault is injected.

    A fault triggered by a line happens before that line is executed. So one triggered by the third ``COORDSPLINET``
    already affects it, and the ``R:`` that triggers `early_ready` is answered early.

    Attributes:
        after_ms: emulated ms from the trigger to the fault.
        command: name of a line, with its axis letter (``HHB``) or without (``HH``: any axis).
        segment: the number of segments (dwells included) begun since power-up that triggers the fault.
        nth: which line of that name, from 1, counted since the fault was scripted or injected.
    """

    after_ms: float = 0.0
    command: str = ""
    segment: int = 0
    nth: int = 1

    def __post_init__(self) -> None:
        name = self.command
        _require(self, "after_ms", 0.0 <= self.after_ms < 1e9, "must be from 0 to 1e9 ms")
        _require(self, "nth", self.nth >= 1, "must be 1 or more")
        _require(self, "segment", self.segment >= 0, "must be 1 or more")
        _require(self, "command", not (name and self.segment), "must be a command or a segment, not both")
        plain = name == "" or (name.isascii() and name.isalnum() and name.isupper())
        _require(
            self, "command", plain, "must be a command's name without marks, such as COORDSPLINET or HHB"
        )
        known = name == "" or name in KNOWN or name[:-1] in KNOWN
        _require(self, "command", known, f"must be one of {', '.join(KNOWN)}, with or without an axis letter")


@dataclass(frozen=True)
class Fault:
    """A fault.

    ================ =====================================================================================
    kind             effect (its fields; ``for_ms`` 0 is unlimited)
    ================ =====================================================================================
    power_off        arm power drops, the brakes hold (``for_ms``)
    motion_stop      the red button is pressed (``for_ms``)
    axis_error       `axis` is in error until PURGE
    fail_reply       `count` waits end in FAIL!: a pending one at once, otherwise the next R: or Rx:
    lost_bytes       bytes are lost: each with `probability`, or the `byte`-th only, or all of the `line`-th line
    garbled_bytes    the same, with one bit of the byte flipped
    delayed_bytes    lines come `delay_ms` late, in order: each with `probability`, or the `line`-th only
    split_bytes      lines come in two pieces, the second `delay_ms` later (0: at once, but in a separate write)
    noise            the unit sends `count` random bytes
    stray_line       the unit sends `text` and a line end, unasked
    port_gone        connection, listener, pseudo-terminal and link vanish; restored after `back_after_s`, 0: never
    stuck_axis       `axis` stays where it is although its reference moves (``for_ms``; it then follows again)
    drift            `axis` drifts from its reference at `counts_per_s`, by up to `most_counts` (``for_ms``)
    lag              the arm follows its reference with a time constant of `lag_ms`: R! comes before it has settled
    missed_grasp     the jaws close `count` times without gripping anything
    queue_overflow   the unit holds only `queue` segments (``for_ms``); with `queue` 0 it drops the next `count`
    early_ready      `count` waits are answered R! at once, even during a motion; ST stays correct
    power_cycle      switched off and on, off for ``for_ms``: every axis reads 0 where it is, no group, registers as
                     at power-up, echo on, noise, waits and motion discarded
    ================ =====================================================================================

    Attributes:
        kind: of `KINDS`.
        when: its trigger.
        axis: letter.
        for_ms: duration, emulated ms.
        direction: of bytes: to the unit, to the host, both, the unit's echo only, or (``parser``) inside the unit
            behind its echo: the echo is right but the executed line is damaged. With a byte echo ``to_unit`` acts there
            too.
        probability: for each byte or line.
        byte, line: which one from then on in each direction, from 1; 0 uses `probability`.
        seed: of its random choices.

    Raises:
        InputError: a field is out of range, missing, or not a field of its kind.
    """

    kind: Kind
    when: When = field(default_factory=When)
    axis: str = ""
    for_ms: float = 0.0
    direction: Direction = "both"
    probability: float = 1.0
    byte: int = 0
    line: int = 0
    delay_ms: float = 0.0
    count: int = 1
    text: str = ""
    back_after_s: float = 0.0
    counts_per_s: float = 0.0
    most_counts: int = 100_000
    lag_ms: float = 0.0
    queue: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        _require(self, "kind", self.kind in KINDS, f"must be one of {', '.join(KINDS)}")
        used = USED[self.kind]
        for each in fields(self):
            if each.name not in ("kind", "when", *used):
                right = getattr(self, each.name) == each.default
                _require(self, each.name, right, f"is not a field of {self.kind}: {', '.join(used)}")
        for name in NEEDED.get(self.kind, ()):
            _require(self, name, bool(getattr(self, name)), f"must be given for {self.kind}")
        _require(self, "axis", self.axis in ("", *AXES), "must be A to H")
        _require(self, "direction", self.direction in DIRECTIONS, f"must be one of {', '.join(DIRECTIONS)}")
        _require(self, "probability", 0.0 < self.probability <= 1.0, "must be above 0 and at most 1")
        _require(self, "line", not (self.byte and self.line), "cannot be given together with byte")
        for name, (low, high) in _RANGES.items():
            _require(self, name, low <= getattr(self, name) <= high, f"must be from {low:g} to {high:g}")
        plain = self.text.isascii() and self.text.isprintable() and len(self.text) <= 200
        _require(self, "text", plain, "must be at most 200 printable ASCII characters")


_RANGES = {
    "for_ms": (0, 1e9), "byte": (0, 1e9), "line": (0, 1e9), "delay_ms": (0, 1e6), "count": (1, 1e6),
    "back_after_s": (0, 1e6), "counts_per_s": (-1e6, 1e6), "most_counts": (1, 2**31), "lag_ms": (0, 1e5),
    "queue": (0, 1e6), "seed": (0, 2**31 - 1),
}  # fmt: skip


@dataclass(frozen=True)
class FaultEvent:
    """Beginning or end of a fault.

    Attributes:
        time_ms: emulated.
        fault: the fault.
        over: whether this is its end.
    """

    time_ms: int
    fault: Fault
    over: bool = False

    @property
    def kind(self) -> Kind:
        """Kind of the fault."""
        return self.fault.kind


def _require(each: Fault | When, name: str, right: bool, rule: str) -> None:
    key, value = f"when.{name}" if isinstance(each, When) else name, getattr(each, name)
    if not right or (isinstance(value, float) and not math.isfinite(value)):
        raise InputError(f"fault: {key} = {value!r}: {rule}", key=key, value=value, rule=rule)
