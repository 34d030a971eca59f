"""Time that is stepped from event to event: driver and emulated unit in one thread, whatever the host does.

A discrete-event simulation (next-event time advance). Time stands still while anything is computed. When the driver
waits, the clock goes from one event to the next, letting each happen, until what is waited for is there or the time
is over. So a run depends on nothing but its inputs, and takes as long as its computing.
"""

from __future__ import annotations

import heapq
import itertools
import math
import queue
import time
from collections.abc import Callable
from typing import Protocol, TypeVar

from arm.errors import A465Error
from driver.line.clock import Clock
from driver.line.signals import held

_T = TypeVar("_T")

_LEAST_S = 1e-6  # of a wait: what is left of one by rounding would not move the time at all
_SLICE_S = 0.02  # of wall time between two looks at what other threads have sent
_LATE_S = 0.05  # of wall time that is caught up with; after more the pace begins anew
_MOST_EVENTS = 100_000  # at one instant: something asks to be called again without an end


class Actor(Protocol):
    """Something that lives in stepped time, such as an emulated unit."""

    def next_at(self) -> float:
        """The time, s, at which it has something to do; infinite while it only waits for others."""
        ...

    def step(self) -> None:
        """Do what is due now. Must not wait."""
        ...


class SteppedClock(Clock):
    """A clock that its user's waiting moves, from 0 s on. For one thread, but for what others put into a queue.

    Hand it to `driver.emulator.Emulator` and `driver.mars.mars.Mars` alike, and connect them by
    `Emulator.open_line`. What an event raises comes out of the wait that let it happen: a `KeyboardInterrupt` by
    `call_at` strikes the driver where a real one would. A signal waits for the end of the event (`interrupt.held`).

    Args:
        time_scale: most seconds per wall second, for somebody who watches; None: as fast as it can be computed.
    """

    def __init__(self, time_scale: float | None = None) -> None:
        super().__init__(time_scale or 1.0)
        self._paced = time_scale is not None
        self._wall_due = time.monotonic()  # when the wall's time has come for `_now`
        self._now = 0.0
        self._actors: list[Actor] = []
        self._events: list[tuple[float, int, Callable[[], object]]] = []
        self._order = itertools.count()
        self._stepping = False

    def now(self) -> float:
        """Seconds stepped so far."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let everything happen that comes within that many seconds, a microsecond at least."""
        if seconds > 0.0:
            self._run(self._now + max(seconds, _LEAST_S), _never)

    def at_least(self, seconds: float, wall_s: float) -> float:
        """That many seconds: no host is too busy for stepped time."""
        return seconds

    def next_of(self, items: queue.SimpleQueue[_T], until: float) -> _T:
        """The next item; time passes until it is there, or until `until`.

        Raises:
            queue.Empty: none came.
        """
        if items.empty():
            self._run(until, lambda: not items.empty())
        return items.get_nowait()

    def unique_ms(self) -> int:
        """Not unique: runs are to repeat themselves."""
        return int(self._now * 1e3)

    def call_at(self, at: float, action: Callable[[], object]) -> None:
        """Let something happen at that time, or at the next wait if that is over. Equal times keep their order."""
        heapq.heappush(self._events, (at, next(self._order), action))

    def call_after(self, seconds: float, action: Callable[[], object]) -> None:
        """Let something happen in that many seconds."""
        self.call_at(self._now + seconds, action)

    def add(self, actor: Actor) -> None:
        """Let an actor live in this time."""
        self._actors.append(actor)

    def remove(self, actor: Actor) -> None:
        """It lives no more."""
        self._actors.remove(actor)

    def _run(self, until: float, done: Callable[[], bool]) -> None:
        """Event after event, in the order of time, until `done` or the time is over.

        At equal times what was ordered by `call_at` comes before the actors, these in the order of `add`.

        Raises:
            A465Error: called from within an event, or events without an end at one instant.
        """
        if self._stepping:
            raise A465Error("an event of a stepped clock may not wait")
        self._stepping = True
        try:
            here = 0
            while not done():
                event_at = self._events[0][0] if self._events else math.inf
                actor, actor_at = self._next_actor()
                at = min(event_at, actor_at)
                if not self._pace(min(at, until), done):
                    continue
                if at > until:
                    self._now = max(self._now, until)
                    return
                here = here + 1 if at <= self._now else 0
                if here > _MOST_EVENTS:
                    raise A465Error(f"{_MOST_EVENTS} events at {self._now:g} s: stepped time does not go on")
                self._now = max(self._now, at)
                with held():
                    if event_at <= actor_at:
                        heapq.heappop(self._events)[2]()
                    elif actor is not None:
                        actor.step()
        finally:
            self._stepping = False

    def _pace(self, at: float, done: Callable[[], bool]) -> bool:
        """Wait until the wall's time has come for `at`; False if another thread has ended the waiting before."""
        if not self._paced:
            return True
        begin = max(self._wall_due, time.monotonic() - _LATE_S)
        wall_due = begin + max(at - self._now, 0.0) / self.time_scale
        while (left := wall_due - time.monotonic()) > 0.0:
            time.sleep(min(left, _SLICE_S))
            if done():
                return False
        self._wall_due = wall_due
        return True

    def _next_actor(self) -> tuple[Actor | None, float]:
        """Who acts first, and when."""
        first, at = None, math.inf
        for actor in self._actors:
            if (due := actor.next_at()) < at:
                first, at = actor, due
        return first, at


def _never() -> bool:
    return False
