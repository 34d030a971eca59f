"""Effect of faults on the bytes of the serial line, in both directions."""

from __future__ import annotations

import random
from dataclasses import dataclass

from driver.emulator.faults.model import Fault

Piece = tuple[float, bytes]  # delay in ms, bytes


@dataclass
class _Active:
    """A present fault in one direction."""

    fault: Fault
    random: random.Random
    bytes_seen: int = 0
    lines_seen: int = 0

    def damage(self, data: bytes) -> bytes:
        """Lose or garble bytes."""
        fault = self.fault
        self.lines_seen += 1
        if fault.line:
            chosen = [fault.line == self.lines_seen] * len(data)
        elif fault.byte:
            chosen = [fault.byte == self.bytes_seen + k for k in range(1, len(data) + 1)]
        else:
            chosen = [self.random.random() < fault.probability for _ in data]
        self.bytes_seen += len(data)
        if fault.kind == "lost_bytes":
            return bytes(b for b, hit in zip(data, chosen, strict=True) if not hit)
        return bytes(
            b ^ 1 << self.random.randrange(8) if hit else b for b, hit in zip(data, chosen, strict=True)
        )

    def hits_line(self) -> bool:
        """Whether the next line is delayed or split."""
        self.lines_seen += 1
        if self.fault.line:
            return self.fault.line == self.lines_seen
        return self.random.random() < self.fault.probability

    def cut(self, data: bytes) -> int:
        """Where to split a line: inside it, if possible."""
        return self.random.randrange(1, len(data)) if len(data) > 1 else len(data)


class LineFaults:
    """The present line faults."""

    def __init__(self) -> None:
        self._active: dict[str, list[_Active]] = {"to_unit": [], "to_host": [], "echo": [], "parser": []}

    def begin(self, fault: Fault) -> None:
        """Begin a fault."""
        directions = ("to_unit", "to_host") if fault.direction == "both" else (fault.direction,)
        for number, direction in enumerate(directions):
            self._active[direction].append(_Active(fault, random.Random(2 * fault.seed + number)))

    def end(self, fault: Fault) -> None:
        """End a fault."""
        for direction, active in self._active.items():
            self._active[direction] = [a for a in active if a.fault is not fault]

    def to_unit(self, data: bytes) -> tuple[float, bytes]:
        """Return the delay, ms, and the bytes of a line that arrive at the unit."""
        late = 0.0
        for active in self._active["to_unit"]:
            if active.fault.kind in ("delayed_bytes", "split_bytes"):
                late += active.fault.delay_ms if active.hits_line() else 0.0
            else:
                data = active.damage(data)
        return late, data

    def to_parser(self, data: bytes) -> bytes:
        """Return the bytes of an echoed line that the parser gets."""
        for active in self._active["parser"]:
            if active.fault.kind not in ("delayed_bytes", "split_bytes"):
                data = active.damage(data)
        return data

    def to_host(self, data: bytes, echo: bool = False) -> list[Piece]:
        """Return the pieces of an answer, or an echo, that are sent to the host, each with its delay."""
        late, pieces = 0.0, [data]
        gap = 0.0
        for active in [*self._active["to_host"], *(self._active["echo"] if echo else ())]:
            match active.fault.kind:
                case "delayed_bytes":
                    late += active.fault.delay_ms if active.hits_line() else 0.0
                case "split_bytes":
                    if active.hits_line() and pieces[0]:
                        cut = active.cut(pieces[0])
                        pieces = [pieces[0][:cut], pieces[0][cut:], *pieces[1:]]
                        gap = max(gap, active.fault.delay_ms)
                case _:
                    pieces = [active.damage(piece) for piece in pieces]
        return [(late + gap * number, piece) for number, piece in enumerate(pieces) if piece]
