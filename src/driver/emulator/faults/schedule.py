"""Schedule of faults: by emulated time, by lines received, by segments begun."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable

from driver.emulator.faults.model import AXES, Fault


class Schedule:
    """Faults that wait for their trigger or their time. Times are emulated ms.

    Args:
        faults: scripted faults; those without a command or a segment wait for the first byte of a client.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._unstarted: list[Fault] = []
        self._by_line: list[tuple[Fault, list[int]]] = []  # fault, and lines until its trigger
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
        """Add a fault. Without a command or a segment it is triggered now."""
        if fault.when.command or fault.when.segment:
            self._add(fault)
        else:
            self.put(now_ms + fault.when.after_ms, fault)

    def put(self, at_ms: float, fault: Fault, over: bool = False) -> None:
        """Schedule the beginning or the end of a fault."""
        self._order += 1
        heapq.heappush(self._due, (at_ms, self._order, fault, over))

    def first_byte(self, now_ms: float) -> None:
        """Trigger the faults that wait for a client's first byte."""
        for fault in self._unstarted:
            self.put(now_ms + fault.when.after_ms, fault)
        self._unstarted.clear()

    def line(self, text: str, now_ms: float) -> None:
        """Trigger the faults that wait for this line, which is complete but not yet executed."""
        if not self._by_line:
            return
        name = text.strip().split(":")[0].rstrip("?")
        still = []
        for fault, left in self._by_line:
            wanted = fault.when.command
            if name == wanted or (name[:-1] == wanted and name[-1] in AXES):
                left[0] -= 1
            if left[0] > 0:
                still.append((fault, left))
            else:
                self.put(now_ms + fault.when.after_ms, fault)
        self._by_line = still

    def segments(self, begun: int, now_ms: float) -> None:
        """Trigger the faults that wait for `begun` segments to have begun."""
        for fault in [f for f in self._by_segment if f.when.segment <= begun]:
            self._by_segment.remove(fault)
            self.put(now_ms + fault.when.after_ms, fault)

    def next_segment(self) -> float:
        """Return the next number of begun segments that triggers a fault; infinite if there is none."""
        return min((f.when.segment for f in self._by_segment), default=math.inf)

    def next_at(self) -> float:
        """Return the time of the next fault; infinite if there is none."""
        return self._due[0][0] if self._due else math.inf

    def take(self) -> tuple[Fault, bool]:
        """Remove and return the next fault, and whether it ends."""
        _, _, fault, over = heapq.heappop(self._due)
        return fault, over
