"""Simulated time that advances from event to event: driver and emulated unit run in one thread.

A discrete-event simulation (next-event time advance). Time does not pass during computation. When the driver waits, the
clock executes one event after the other until the awaited item is there or the wait is over. So a run depends on its
inputs alone, not on the host, and takes only the time to compute it.
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

_LEAST_S = 1e-6  # shortest wait; a shorter one may be lost in rounding and not advance the time
_SLICE_S = 0.02  # wall time between two checks for what other threads have sent
_LATE_S = 0.05  # wall time; a paced clock makes up for a delay only up to this
_MOST_EVENTS = 100_000  # at one instant; more are an endless loop of events


class Actor(Protocol):
    """Something that acts in simulated time, such as an emulated unit."""

    def next_at(self) -> float:
        """Return the time, s, of its next action; infinite while it waits for others."""
        ...

    def step(self) -> None:
        """Do what is due now. Must not wait."""
        ...


class SteppedClock(Clock):
    """A clock that starts at 0 s and advances while its user waits. For one thread; others may only put into a queue.

    Pass it to `driver.emulator.Emulator` and to `driver.mars.mars.Mars`, and connect them by `Emulator.open_line`. What
    an event raises is raised by the wait that executes it, so a `KeyboardInterrupt` scheduled by `call_at` reaches the
    driver where a real one would. A signal is deferred to the end of the event (`driver.line.signals.held`).

    Args:
        time_scale: most seconds per wall second, to watch a run; None: as fast as possible.
    """

    def __init__(self, time_scale: float | None = None) -> None:
        super().__init__(time_scale or 1.0)
        self._paced = time_scale is not None
        self._wall_due = time.monotonic()  # wall time at which `_now` is due
        self._now = 0.0
        self._actors: list[Actor] = []
        self._events: list[tuple[float, int, Callable[[], object]]] = []
        self._order = itertools.count()
        self._stepping = False

    def now(self) -> float:
        """Simulated seconds so far."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Execute all events within that many seconds, a microsecond at least."""
        if seconds > 0.0:
            self._run(self._now + max(seconds, _LEAST_S), lambda: False)

    def at_least(self, seconds: float, wall_s: float) -> float:
        """Return `seconds`: simulated time does not depend on the host."""
        return seconds

    def next_of(self, items: queue.SimpleQueue[_T], until: float) -> _T:
        """Return the next item. Time passes until it is there, or until `until`.

        Raises:
            queue.Empty: none came.
        """
        if items.empty():
            self._run(until, lambda: not items.empty())
        return items.get_nowait()

    def unique_ms(self) -> int:
        """Not unique, so that runs are repeatable."""
        return int(self._now * 1e3)

    def call_at(self, at: float, action: Callable[[], object]) -> None:
        """Schedule an action, at the next wait if that time is over. Equal times keep their order."""
        heapq.heappush(self._events, (at, next(self._order), action))

    def call_after(self, seconds: float, action: Callable[[], object]) -> None:
        """Schedule an action in that many seconds."""
        self.call_at(self._now + seconds, action)

    def add(self, actor: Actor) -> None:
        """Add an actor."""
        self._actors.append(actor)

    def remove(self, actor: Actor) -> None:
        """Remove an actor."""
        self._actors.remove(actor)

    def _run(self, until: float, done: Callable[[], bool]) -> None:
        """Execute events in the order of time until `done`, or until the time is over.

        At equal times, events of `call_at` come before the actors, and actors in the order of `add`.

        Raises:
            A465Error: called from within an event, or an endless loop of events at one instant.
        """
        if self._stepping:
            raise A465Error("an event of a stepped clock must not wait")
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
                    why = f"{_MOST_EVENTS} events at {self._now:g} s: stepped time does not advance"
                    raise A465Error(why)
                self._now = max(self._now, at)
                with held():
                    if event_at <= actor_at:
                        heapq.heappop(self._events)[2]()
                    elif actor is not None:
                        actor.step()
        finally:
            self._stepping = False

    def _pace(self, at: float, done: Callable[[], bool]) -> bool:
        """Wait for the wall time at which `at` is due. Return False if another thread ends the wait before."""
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
        """Return the actor that acts first, and when."""
        first, at = None, math.inf
        for actor in self._actors:
            if (due := actor.next_at()) < at:
                first, at = actor, due
        return first, at
