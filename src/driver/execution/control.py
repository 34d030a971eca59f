"""Requests during an execution: pause, resume, abort, speed override.

On the command line `cell.session.speed` (``--speed``) and `cell.session.keyboard` (keys + and -) set the override.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from arm.errors import Aborted, InputError

LEAST_OVERRIDE = 0.05  # lowest speed override, unless the ceiling is lower


class Woken(Protocol):
    """What waits for the arm (`driver.execution.controller.Controller`)."""

    def wake(self) -> None:
        """Look at the requests now."""
        ...

    def interrupt(self) -> None:
        """Raise `Aborted` now."""
        ...


class Control:
    """Requests to a running `driver.execution.execute.execute`, or to one path (`Controller.follow`).

    Every method may be called from a signal handler or from another thread. It sets one value and wakes the thread that
    drives the arm; it neither locks nor waits.

    Args:
        override: initial speed override (factor on velocities).
        ceiling: upper limit of the override.
        tell: called with one line of text by the thread that drives the arm, when the arm pauses, stops and resumes.

    Attributes:
        ceiling: upper limit of the override.
        paused: whether a pause is requested.
        aborted: whether an abort is requested; final.
        standing: whether the arm has come to rest in a pause. Set by the thread that drives the arm.

    Raises:
        InputError: ceiling or override out of range.
    """

    def __init__(
        self, override: float = 1.0, ceiling: float = 1.0, tell: Callable[[str], None] | None = None
    ) -> None:
        if not 0.0 < ceiling <= 1.0:
            why = f"speed override = {ceiling:g}: must be above 0 and at most 1; an override only slows down"
            raise InputError(why, value=ceiling)
        self.ceiling = ceiling
        self.paused = False
        self.aborted = False
        self.standing = False
        self.tell: Callable[[str], None] = tell or (lambda text: None)
        self._override = ceiling
        self._waits: Woken | None = None
        self.override = min(override, ceiling) if 0.0 < override <= 1.0 else override

    @property
    def least(self) -> float:
        """Lower limit of the override."""
        return min(LEAST_OVERRIDE, self.ceiling)

    @property
    def override(self) -> float:
        """Factor on velocities, from `least` to `ceiling`; applies from the next motion on.

        Raises:
            InputError: on setting, out of range.
        """
        return self._override

    @override.setter
    def override(self, factor: float) -> None:
        if not self.least <= factor <= self.ceiling:
            raise InputError(
                f"speed override = {factor:g}: must be from {self.least:g} to {self.ceiling:g}; "
                "an override only slows down",
                value=factor,
            )
        self._override = factor

    def pause(self) -> None:
        """Pause: in a motion once the unit has executed the segments that it holds, between steps at once."""
        self.paused = True
        self._wake()

    def go_on(self) -> None:
        """End the pause."""
        self.paused = False
        self._wake()

    def abort(self) -> None:
        """Send STOP at once."""
        self.aborted = True
        waits = self._waits
        if waits is not None:
            waits.interrupt()

    def _wake(self) -> None:
        waits = self._waits
        if waits is not None:
            waits.wake()

    @contextmanager
    def attached(self, waits: Woken) -> Iterator[None]:
        """Inside, requests wake the thread that waits for the arm; `Aborted` is raised there. May be nested.

        Raises:
            Aborted: an abort was requested before.
        """
        if self._waits is waits:
            yield
            return
        self._waits = waits  # set first: an abort that comes now is noticed below or by what waits
        try:
            self.require()
            yield
        finally:
            self._waits = None
            self.standing = False

    def require(self) -> None:
        """Refuse to continue after an abort.

        Raises:
            Aborted: with reason ``aborted``.
        """
        if self.aborted:
            raise Aborted("aborted on request", reason="aborted")
