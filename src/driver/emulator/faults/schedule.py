"""When scripted faults happen: by emulated time, by lines received, by segments executed."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable

from driver.emulator.faults.model import Fault


class Schedule:
    """Faults that wait for what sets them off, and those that are due. Times are emulated ms.

    Args:
        faults: the script; those without a command or a segment wait for the first byte of a client.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._unstarted: list[Fault] = []
        self._by_line: list[tuple[Fault, list[int]]] = []  # and how many lines it still lets pass
        self._by_segment: list[Fault] = []
        self._due: list[tuple[float, int, Fault, bool]] = []
        self._order = 0
        for fault in faults:
            self._add(fault)

    def _add(self, fault: Fault) -> None:
        if fault.when.command:
            self._by_line.append((fault, [fault.when.nth]))
        elif fault.when.segment:
            self._by_segment.append(fault)
        else:
            self._unstarted.append(fault)

    def inject(self, fault: Fault, now_ms: float) -> None:
        """Add a fault; one without a command or a segment counts from now."""
        if fault.when.command or fault.when.segment:
            self._add(fault)
        else:
            self.put(now_ms + fault.when.after_ms, fault)

    def put(self, at_ms: float, fault: Fault, over: bool = False) -> None:
        """Let a fault happen, or be over, at a time."""
        self._order += 1
        heapq.heappush(self._due, (at_ms, self._order, fault, over))

    def first_byte(self, now_ms: float) -> None:
        """A client has spoken."""
        for fault in self._unstarted:
            self.put(now_ms + fault.when.after_ms, fault)
        self._unstarted.clear()

    def line(self, text: str, now_ms: float) -> None:
        """A line is complete, and not yet obeyed."""
        if not self._by_line:
            return
        name = text.strip().split(":")[0].rstrip("?")
        still = []
        for fault, left in self._by_line:
            wanted = fault.when.command
            if name == wanted or (
                len(name) == len(wanted) + 1 and name[:-1] == wanted and name[-1] in "ABCDEFGH"
            ):
                left[0] -= 1
            if left[0] > 0:
                still.append((fault, left))
            else:
                self.put(now_ms + fault.when.after_ms, fault)
        self._by_line = still

    def segments(self, begun: int, now_ms: float) -> None:
        """So many segments have begun to be executed."""
        for fault in [f for f in self._by_segment if f.when.segment <= begun]:
            self._by_segment.remove(fault)
            self.put(now_ms + fault.when.after_ms, fault)

    def next_segment(self) -> float:
        """The smallest count of begun segments that sets something off; infinite if none does."""
        return min((f.when.segment for f in self._by_segment), default=math.inf)

    def next_at(self) -> float:
        """When the next fault is due; infinite if none is."""
        return self._due[0][0] if self._due else math.inf

    def take(self) -> tuple[Fault, bool]:
        """The next fault, and whether it is over rather than begun."""
        _, _, fault, over = heapq.heappop(self._due)
        return fault, over
