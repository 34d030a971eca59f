"""What the bytes of a terminal mean while jogging."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

JOINTS = ("J1", "J2", "J3", "J4", "J5", "J6")
TOOL = ("x", "y", "z", "along")
HELP = (
    "keys: 1 to 6 choose a joint; x y z the tool along the axes of the base frame; a the tool along its own z axis",
    "      up + one step, down - one step back, held: it goes on; , . half or double the step; Esc, space STOP; q end",
)
Act = Literal["choose", "move", "scale", "stop", "end"]
_SEQUENCES = {
    b"\x1b[A": 1,
    b"\x1b[B": -1,
    b"\x1bOA": 1,
    b"\x1bOB": -1,
}  # arrow keys, in both modes of terminals
_MOVES = {b"+": 1, b"=": 1, b"-": -1, b"_": -1}
_SCALES = {b",": -1, b"<": -1, b".": 1, b">": 1}


@dataclass(frozen=True)
class Press:
    """One key.

    Attributes:
        act: what it asks for.
        sign: +1 or -1 of a move; of a scale, whether the step is doubled or halved.
        axis: that is chosen, of `JOINTS` or `TOOL`.
    """

    act: Act
    sign: int = 0
    axis: str = ""


def presses(data: bytes) -> list[Press]:
    """Return the keys in what a terminal delivered at once. A key that is not known does nothing.

    A lone escape character, or the rest of a sequence that is not known, is a stop; so is the end of the terminal (no
    bytes).
    """
    if not data:
        return [Press("stop")]
    found: list[Press] = []
    while data:
        for sequence, sign in _SEQUENCES.items():
            if data.startswith(sequence):
                found.append(Press("move", sign))
                data = data[len(sequence) :]
                break
        else:
            byte, data = data[:1], data[1:]
            if byte == b"\x1b":
                return [*found, Press("stop")]
            found += _press(byte)
    return found


def _press(byte: bytes) -> list[Press]:
    if byte in _MOVES:
        return [Press("move", _MOVES[byte])]
    if byte in _SCALES:
        return [Press("scale", _SCALES[byte])]
    if byte in b"123456":
        return [Press("choose", axis=JOINTS[int(byte) - 1])]
    if byte.lower() in (b"x", b"y", b"z", b"a"):
        letter = byte.lower().decode()
        return [Press("choose", axis="along" if letter == "a" else letter)]
    if byte == b" ":
        return [Press("stop")]
    return [Press("end")] if byte in (b"q", b"Q", b"\x04") else []
