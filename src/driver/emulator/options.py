"""What an emulated unit may be told to be: everything that the real one leaves open, and faults to order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from driver.emulator.faults import Fault


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
