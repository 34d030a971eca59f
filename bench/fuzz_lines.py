"""Random and damaged lines through everything that reads them: the driver's parser and the emulated unit's.

python bench/fuzz_lines.py --lines 1000000

Half of the lines are valid ones with bytes lost, changed, doubled or cut; the others are random bytes. Only documented
errors may be raised, and memory must not grow with the number of lines.
"""

from __future__ import annotations

import argparse
import platform
import resource
import time
from collections import Counter

import numpy as np

from arm.controller.unit import load_unit
from driver.emulator import EmulatorOptions
from driver.emulator.commands import Interpreter
from driver.emulator.unit.machine import Machine
from driver.line.protocol import (
    Answer,
    MalformedAnswer,
    parse_integer,
    parse_position,
    parse_reply,
    parse_status,
)

REPLIES = (
    b"VER=MARS8 v1.0 build Pi Oct  2 2017 11:06:45", b"STAMP=12345", b"ST=16", b"ST=131096", b"R!", b"RG!", b"FAIL!",
    b"COORDAP=65535,1,32767,-181650,-349,-12200,99200,33300,-96500", b"APG=840", b"REGMSA=7680", b"COORDDISCONT=5",
)  # fmt: skip
COMMANDS = (
    b"ECHO:0", b"STAMP:7", b"ST?", b"R:", b"RG:", b"STOP:", b"PURGE:", b"COORDGRP:A,B,C,D,E,F", b"COORDDISCONT:5",
    b"COORDMV:-181650,-349,-12200,99200,33300,-96500", b"COORDMVT:60,1,2,3,4,5,6", b"REGMSA:7680.0", b"GG:471.5",
    b"COORDSPLINET:100,3,1,2,-1,2,3,-2,3,4,-3,4,5,-4,5,6,-5,6,7,-6", b"HHA:", b"SPDTB:0,300", b"COORDAP?", b"RELEASEG:",
)  # fmt: skip


def main() -> None:
    """Draw lines, feed them, print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lines", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(f"Python {platform.python_version()}; {options.lines} lines for each reader; seed {options.seed}")
    for name, feed in (("driver", Driver()), ("emulated unit", Unit())):
        rng = np.random.default_rng([options.seed, len(name)])
        began, first, kinds = time.process_time(), 0, Counter[str]()
        for count in range(options.lines):
            kinds[feed.take(drawn(rng, feed.valid))] += 1
            if count == options.lines // 10:
                first = memory_kib()
        grown = memory_kib() - first
        print(
            f"{name}: no crash, {time.process_time() - began:.0f} s of CPU, memory grew by {grown} KiB after a tenth"
        )
        print("  " + ", ".join(f"{kind} {count}" for kind, count in kinds.most_common()))


def memory_kib() -> int:
    """Largest resident size so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def drawn(rng: np.random.Generator, valid: tuple[bytes, ...]) -> bytes:
    """A damaged line, or random bytes."""
    if rng.random() < 0.5:
        return rng.integers(0, 256, int(rng.integers(0, 80)), dtype=np.uint8).tobytes().replace(b"\n", b"")
    line = bytearray(valid[int(rng.integers(len(valid)))])
    for _ in range(int(rng.integers(0, 4))):
        if not line:
            break
        at = int(rng.integers(len(line)))
        match int(rng.integers(4)):
            case 0:
                del line[at]
            case 1:
                line[at] = int(rng.integers(256))
            case 2:
                line[at:at] = line[: int(rng.integers(1, 12))]
            case _:
                del line[at:]
    return bytes(line).replace(b"\n", b"")


class Driver:
    """The driver's side: a reply, and its value by what it claims to be."""

    valid = REPLIES

    def take(self, line: bytes) -> str:
        """What came of one line."""
        reply = parse_reply(line.rstrip(b"\r").decode("latin-1"))
        if not isinstance(reply, Answer):
            return type(reply).__name__
        try:
            match reply.key:
                case "ST":
                    parse_status(reply.text)
                case "COORDAP":
                    parse_position(reply.text, 6)
                case "VER":
                    pass
                case _:
                    parse_integer(reply.text)
        except MalformedAnswer:
            return "malformed"
        return "sound"


class Unit:
    """The emulated unit's side; a little time passes now and then."""

    valid = COMMANDS

    def __init__(self) -> None:
        self.machine = Machine(load_unit("crs93"), None, EmulatorOptions(keep_lines=1000, keep_ms=10_000))
        self.interpreter = Interpreter(self.machine)
        self.count = 0

    def take(self, line: bytes) -> str:
        """What came of one line."""
        answers = self.interpreter.take(line.decode("latin-1"))
        self.count += 1
        if self.count % 100 == 0:
            self.machine.run(5)
            self.interpreter.ready()
        return "answered" if answers else "silent"


if __name__ == "__main__":
    main()
