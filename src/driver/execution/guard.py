"""What every session with a controller has: it stops the arm before an error or a signal is passed on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Self

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from driver.execution.rest import RestState, wait_settled
from driver.line.clock import Clock
from driver.line.signals import caught, hear_again, interruptible


class Guarded(ABC):
    """A session with a controller. A context manager: leaving it by an exception stops the arm but never releases it.

    Inside the context, in the main thread, a signal that would end the program (`driver.line.signals`) raises an
    exception.

    Args:
        unit: the expected arm and controller.
        clock: controller time.
    """

    def __init__(self, unit: Unit, clock: Clock) -> None:
        self.unit = unit
        self.clock = clock
        self._guarded = False
        self._signals = ExitStack()

    @property
    @abstractmethod
    def identified(self) -> bool:
        """Whether the other side is known to be the expected unit. If not, nothing moves and STOP is not sent."""

    @abstractmethod
    def counts(self) -> tuple[int, ...]:
        """Read the encoder counts, (n,)."""

    @abstractmethod
    def wait_until(self, until: float) -> None:
        """Wait until controller time `until`, or until woken (`driver.execution.controller.Controller`)."""

    @abstractmethod
    def stop(self) -> RestState:
        """Stop at once and wait until the arm is at rest. Return its state. Never raises for a failing line."""

    @abstractmethod
    def close(self) -> None:
        """Close the line."""

    def __enter__(self) -> Self:
        self._signals.enter_context(interruptible())
        return self

    def __exit__(self, _: object, error: BaseException | None, trace: object) -> None:
        try:
            if not self.identified:
                pass  # nothing moves, and no command may be sent
            elif isinstance(error, ExecutionStopped):
                if "state" not in error.data:
                    error.data["state"] = self.stop().to_json()
            elif error is not None and not isinstance(error, InputError | ImpossibleError):
                self.stop()
        finally:
            self.close()
            self._signals.close()

    def wait(self, seconds: float) -> None:
        """Wait for that many controller seconds, whatever wakes it.

        Raises:
            Aborted, LinkLost: at once.
        """
        until = self.clock.now() + seconds
        while self.clock.now() < until:
            self.wait_until(until)

    def settled_counts(self) -> tuple[int, ...]:
        """Wait until two samples 0.1 s apart differ by at most `STILL_COUNTS` on every axis. Return the counts.

        Raises:
            NoAnswer: still moving after `driver.execution.rest.SETTLE_S`.
        """
        return wait_settled(self.clock, self.wait, self.counts)

    def note(self, kind: str, **data: object) -> None:
        """Record an event; a session with a log overrides this."""
        return

    @contextmanager
    def guarded(self, what: str, lost: str = "") -> Iterator[None]:
        """Stop the arm before any error inside is passed on, with the arm's state in its ``data``.

        An interrupt (SIGINT) becomes `ExecutionStopped` with ``reason="interrupted"``. Nested uses stop once.

        Args:
            what: is done inside, for messages.
            lost: why the counters say nothing of where the arm is, if it is stopped inside.
        """
        if self._guarded:
            yield
            return
        self._guarded = True
        try:
            yield
        except ExecutionStopped as error:
            state = self.stop().noted(lost)
            raise state.error(f"{what}: {error}", self.unit, **error.data) from error
        except KeyboardInterrupt:
            caught()
            state = self.stop().noted(lost)
            hear_again()
            raise state.error(f"{what} interrupted", self.unit, reason="interrupted") from None
        except BaseException:
            self.stop()
            raise
        finally:
            self._guarded = False
