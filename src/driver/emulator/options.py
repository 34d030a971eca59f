"""Options of the emulated unit: everything that is not known of the real one, and scripted faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from arm.errors import InputError
from driver.emulator.faults.model import Fault


@dataclass(frozen=True)
class EmulatorOptions:
    """How the emulated unit behaves.

    Attributes:
        power_up_deg: joint positions at power-up, which the unit does not know until it is homed. By default the arm
            is clear of the table and out of the camera's view.
        version: answer to VER.
        noise: bytes sent when a client's first byte arrives, as some units do after power-up.
        unknown: answer to a line that is not understood; silence is what the public clients' history shows
            (docs/sources.md, "Public clients").
        echo: after ``ECHO:1``, echo each line once it is complete, each byte as it arrives, or nothing; which of these
            the real unit does is unknown.
        echo_end: echo of a line feed.
        echo_order: a line's echo comes before or after its answers (line echo), or bytes of echoes and answers
            alternate (``mixed``, byte echo).
        adapter_echo: a device between host and unit echoes everything at once.
        input_buffer: bytes that the unit holds before it executes them; 0 is unlimited.
        input_full: effect of a full input buffer: block the host, or drop bytes.
        parse_ms: execution time of each line.
        registers_readable: whether ``REGMSA?`` and the like are answered; unknown for the real unit.
        vertex_steps: COORDDISCONT after power-up; unknown for the real unit, 0 stops at every vertex.
        queue: number of segments that fit into the queue.
        overflow: answer to a segment beyond the queue: silently dropped, or FAIL!.
        homing_speed: fraction of REGMS.
        static_error: largest error of an axis at rest, counts, drawn with `seed`; 0 is exact.
        paced: whether bytes take their time at 19200 baud.
        reply_delay_ms: delay of each answer.
        seed: of all random choices except those of the faults, which have their own.
        faults: scripted faults, in any order.
        keep_lines: number of latest lines, faults and violations kept; None keeps all.
        keep_ms: latest ms of motion recorded; the default is 30 min, 60 MB. None records all.
    """

    power_up_deg: tuple[float, ...] = (-60.0, -20.0, -60.0, 0.0, -60.0, 0.0)
    version: str = "MARS8 v1.0 build Pi Oct  2 2017 11:06:45"
    noise: bytes = b""
    unknown: Literal["silent", "fail"] = "silent"
    echo: Literal["line", "byte", "none"] = "line"
    echo_end: Literal["LF", "CRLF", "CR"] = "LF"
    echo_order: Literal["before", "after", "mixed"] = "before"
    adapter_echo: bool = False
    input_buffer: int = 0
    input_full: Literal["block", "drop"] = "block"
    parse_ms: float = 0.0
    registers_readable: bool = False
    vertex_steps: int = 1
    queue: int = 200
    overflow: Literal["drop", "fail"] = "drop"
    homing_speed: float = 0.5
    static_error: int = 0
    paced: bool = True
    reply_delay_ms: float = 0.0
    seed: int = 0
    faults: tuple[Fault, ...] = ()
    keep_lines: int | None = 100_000
    keep_ms: int | None = 1_800_000

    def __post_init__(self) -> None:
        if self.echo_order == "mixed" and self.echo != "byte":
            why = "echo_order = 'mixed': must have echo = 'byte', as only bytes can be mixed"
            raise InputError(why, key="echo_order")
        if self.echo_order == "after" and self.echo == "byte":
            why = "echo_order = 'after': must not have echo = 'byte', which echoes at once"
            raise InputError(why, key="echo_order")

    @property
    def echoed_end(self) -> bytes:
        """Echo of a line feed."""
        return {"LF": b"\n", "CRLF": b"\r\n", "CR": b"\r"}[self.echo_end]
