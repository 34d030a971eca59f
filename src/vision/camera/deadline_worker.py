"""Calls, with a deadline, into a library that may hang."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import TypeVar

T = TypeVar("T")
END_S = 2.0  # wall time for an idle thread to end
LATE_S = 0.5  # and for one whose call missed its deadline, and may hang for ever


class Worker:
    """A thread that makes calls one after the other, while the caller waits for a limited time.

    A native library cannot be interrupted, not even by Ctrl-C, but the wait for it can. A call that hangs blocks only
    this daemon thread, so the program can still exit.

    Attributes:
        lost: whether a call hangs; the worker then refuses further ones.
    """

    def __init__(self, name: str) -> None:
        """
        Args:
            name: of the thread, for debugging.
        """
        self.lost = False
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def begin(self, function: Callable[[], None]) -> None:
        """Call `function`, which must not raise, on the thread after its pending calls, and do not wait for it."""
        self._calls.put(function)

    def call(self, function: Callable[[], T], seconds: float) -> T:
        """Call `function` on the thread and return its result, or raise its error.

        Raises:
            TimeoutError: it has not returned after `seconds` of wall time, or an earlier call hangs.
        """
        if self.lost:
            raise TimeoutError("an earlier call hangs")
        future: Future[T] = Future()

        def fill() -> None:
            try:
                future.set_result(function())
            except BaseException as error:  # noqa: BLE001 - raised again in the caller
                future.set_exception(error)

        self._calls.put(fill)
        if not wait([future], timeout=seconds).done:
            self.lost = True
            raise TimeoutError(f"no answer within {seconds:g} s")
        return future.result()

    def end(self, seconds: float = END_S) -> None:
        """End the thread after its pending calls; wait for that, also for a call that is only late.

        A program that exits before is aborted by the C library, as a native frame is on the thread's stack.
        """
        self._calls.put(None)
        self._thread.join(min(seconds, LATE_S) if self.lost else seconds)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            call()
