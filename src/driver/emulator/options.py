"""What an emulated unit may be told to be: everything that the real one leaves open, and faults to order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from arm.errors import InputError
from driver.emulator.faults.model import Fault


@dataclass(frozen=True)
class EmulatorOptions:
    """How the emulated unit behaves.

    Attributes:
        power_up_deg: joint positions when it is switched on; the unit does not know them until it is homed. The
            default stands clear of the table and out of the camera's view.
        version: text of VER.
        noise: bytes sent when a client's first byte arrives, as some units do after power-up.
        unknown: answer to a line that it does not understand; silence is what the public clients' history shows
            (fact sheet, section 4.2).
        echo: after ``ECHO:1`` each line comes back once it is whole, each byte as it arrives, or nothing does; which,
            is unknown of the real unit.
        echo_end: what a line feed comes back as.
        echo_order: a line's echo comes before its answers or after them (an echo of lines); the bytes of echoes and
            answers take turns (``mixed``, an echo of bytes).
        adapter_echo: what is between host and unit sends everything back at once, whatever becomes of it.
        input_buffer: bytes that the unit holds before it has obeyed them; 0 is any number.
        input_full: what becomes of more: the host is held back, or they are lost.
        parse_ms: time that each line takes to be obeyed.
        registers_readable: whether ``REGMSA?`` and the like are answered; unknown of the real unit.
        vertex_steps: COORDDISCONT after power-up; unknown, 0 stops at every vertex.
        queue: segments that it holds.
        overflow: what becomes of a segment beyond: dropped in silence, or answered FAIL!.
        homing_speed: fraction of REGMS.
        static_error: most counts that an axis at rest is off its reference, drawn with `seed`; 0 is exact.
        paced: bytes take their time at 19200 baud.
        reply_delay_ms: the unit thinks that long before an answer.
        seed: of everything random but the faults, which have their own.
        faults: what goes wrong, in any order.
        keep_lines: how many lines, faults and violations are remembered, the newest each; None remembers all.
        keep_ms: how many ms of motion are recorded, the newest; the default is 30 min, 60 MB. None records all.
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
            raise InputError(
                "echo_order = 'mixed': only bytes can be mixed; give echo = 'byte'", key="echo_order"
            )
        if self.echo_order == "after" and self.echo == "byte":
            raise InputError("echo_order = 'after': bytes come back as they arrive", key="echo_order")

    @property
    def echoed_end(self) -> bytes:
        """What a line feed comes back as."""
        return {"LF": b"\n", "CRLF": b"\r\n", "CR": b"\r"}[self.echo_end]
