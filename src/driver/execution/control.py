"""What may be asked for while an execution runs: pause, go on, abort, slower."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from arm.errors import InputError
from driver.line.link import Aborted, Link

LEAST_OVERRIDE = 0.05


class Control:
    """Requests to a running `driver.execution.execute.execute` or `driver.execution.stream.stream`.

    Every method may be called from a signal handler or from another thread: it sets one value and wakes the thread
    that drives the arm; nothing is locked, nothing waits.

    Args:
        override: factor of velocities to begin with.
        ceiling: the override never goes above it.
        tell: called by the thread that drives the arm, with one line, when it pauses, stands, and goes on.

    Attributes:
        ceiling: most that the override can be.
        paused: whether a pause is asked for.
        aborted: whether an end is asked for; for good.
        standing: whether the arm was seen to stand because of the pause. Set by the thread that drives the arm.

    Raises:
        InputError: ceiling or override out of range.
    """

    def __init__(
        self, override: float = 1.0, ceiling: float = 1.0, tell: Callable[[str], None] | None = None
    ) -> None:
        if not 0.0 < ceiling <= 1.0:
            raise InputError(
                f"speed override = {ceiling:g}: must be above 0 and at most 1; an override only lowers",
                value=ceiling,
            )
        self.ceiling = ceiling
        self.paused = False
        self.aborted = False
        self.standing = False
        self.tell: Callable[[str], None] = tell or _nobody
        self._override = ceiling
        self._link: Link | None = None
        self.override = min(override, ceiling) if 0.0 < override <= 1.0 else override

    @property
    def least(self) -> float:
        """The override is never below this."""
        return min(LEAST_OVERRIDE, self.ceiling)

    @property
    def override(self) -> float:
        """Factor of velocities, from `least` to `ceiling`, from the next motion on.

        Raises:
            InputError: on setting, out of range.
        """
        return self._override

    @override.setter
    def override(self, factor: float) -> None:
        if not self.least <= factor <= self.ceiling:
            raise InputError(
                f"speed override = {factor:g}: must be from {self.least:g} to {self.ceiling:g}; "
                "an override only lowers",
                value=factor,
            )
        self._override = factor

    def pause(self) -> None:
        """Stand as soon as what the unit holds is played out, on the path; between steps at once."""
        self.paused = True
        self._wake()

    def go_on(self) -> None:
        """End the pause."""
        self.paused = False
        self._wake()

    def abort(self) -> None:
        """STOP, at once, wherever the execution is."""
        self.aborted = True
        link = self._link
        if link is not None:
            link.interrupt()

    def _wake(self) -> None:
        link = self._link
        if link is not None:
            link.wake()

    @contextmanager
    def attached(self, link: Link) -> Iterator[None]:
        """Inside, requests reach whoever waits on the link; `Aborted` is raised there. Nested uses do it once.

        Raises:
            Aborted: an abort was asked for before.
        """
        if self._link is link:
            yield
            return
        self._link = link  # first this: an abort that comes now is seen below, or by the link
        try:
            self.require()
            yield
        finally:
            self._link = None
            self.standing = False

    def require(self) -> None:
        """Refuse to go on after an abort.

        Raises:
            Aborted: with reason ``aborted``.
        """
        if self.aborted:
            raise Aborted("aborted on request", reason="aborted")


def _nobody(text: str) -> None:
    """Nobody wants to be told."""
