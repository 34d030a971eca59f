"""Mutants written by hand of `driver`; see `mutants_bench.by_hand`."""

from __future__ import annotations

ROWS: tuple[tuple[str, str, str, str, str, tuple[str, ...]], ...] = (
    # name, file, old, new, what, tests
    (
        "rest-while-moving",
        "driver/mars/stopping.py",
        "        still = at is None or before is None or farthest(before, at) <= STILL_COUNTS\n",
        "        still = True\n",
        "at rest while counts change",
        (
            "driver/mars/test_stopping.py",
            "driver/mars/test_mars_stopping.py",
        ),
    ),
    (
        "rest-while-busy",
        "driver/mars/stopping.py",
        "        quiet = self._fresh is not None and (not self._fresh.busy or self._fresh.fault)\n",
        "        quiet = self._fresh is not None\n",
        "at rest while busy",
        (
            "driver/mars/test_stopping.py",
            "driver/mars/test_mars_stopping.py",
        ),
    ),
    (
        "rest-not-obeyed",
        "driver/mars/stopping.py",
        "        executed = self.link.echo.stops > 0 or not self.link.echoes\n",
        "        executed = True\n",
        "at rest though STOP was not echoed",
        (
            "driver/mars/test_stopping.py",
            "driver/mars/test_mars_stopping.py",
        ),
    ),
    (
        "link-endless-line",
        "driver/line/splitter.py",
        "        if len(self._rest) > self._longest:\n",
        "        if False:\n",
        "a line without an end is kept",
        ("driver/line/test_link.py",),
    ),
    (
        "link-flood",
        "driver/line/transport.py",
        "        if self._inbox.qsize() > UNREAD_ANSWERS:\n",
        "        if False:\n",
        "lines that nobody asked for fill the memory",
        ("driver/line/test_link.py",),
    ),
    (
        "link-identified",
        "driver/line/transport.py",
        "        if line and not self.identified and (name is None or name[0] not in HARMLESS):\n",
        "        if False:\n",
        "anything is sent to a unit that is not identified",
        (
            "driver/line/test_link.py",
            "driver/mars/test_mars.py",
        ),
    ),
    (
        "echo-mismatch",
        "driver/line/echo.py",
        "            self.mismatch = Mismatch(line.text, received)\n",
        "            pass\n",
        "a damaged segment is no mismatch",
        (
            "driver/line/test_echo.py",
            "driver/execution/test_stream.py",
        ),
    ),
    (
        "echo-twice",
        "driver/line/echo.py",
        '            self.mismatch = Mismatch("", line)',
        "            pass",
        "a segment that is obeyed twice is no mismatch",
        (
            "driver/line/test_echo.py",
            "driver/execution/test_stream.py",
        ),
    ),
    (
        "echo-register",
        "driver/line/echo.py",
        "            self.lost.append(Mismatch(line.text, received))\n",
        "            pass\n",
        "a damaged register line is no matter",
        (
            "driver/line/test_echo.py",
            "driver/mars/test_mars_startup.py",
        ),
    ),
    (
        "echo-verified",
        "driver/line/echo.py",
        "        if self.mismatch is None:\n            self.verified = line.number\n\n    def _interrupts",
        "        self.verified = line.number\n\n    def _interrupts",
        "a damaged segment counts as verified",
        (
            "driver/line/test_echo.py",
            "driver/execution/test_stream.py",
        ),
    ),
    (
        "pathwatch-astray",
        "driver/execution/path_watch.py",
        "        if self._astray >= ASTRAY:\n",
        "        if False:\n",
        "an arm off its path is not stopped",
        ("driver/execution/test_stream.py",),
    ),
    (
        "lookahead-braking",
        "driver/mars/lookahead.py",
        "    return max(v / a for v, a in zip(speed, acceleration, strict=True)) / 1e3\n",
        "    return min(v / a for v, a in zip(speed, acceleration, strict=True)) / 1e3\n",
        "the fastest axis' braking time for the slowest",
        ("driver/mars/test_lookahead.py",),
    ),
    (
        "interrupt-burst",
        "driver/line/signals.py",
        "    if now - _heard_at >= QUIET_S and now >= _deaf_until:\n",
        "    if now - _heard_at >= QUIET_S:\n",
        "a second signal cuts off what the first set going",
        ("driver/line/test_signals.py",),
    ),
    (
        "identity-contradiction",
        "driver/mars/identity.py",
        "    if others and not _has_gripper(answers.get(own)):\n",
        "    if False:\n",
        "another unit's arm gets this one's registers",
        ("driver/mars/test_mars_startup.py",),
    ),
)
