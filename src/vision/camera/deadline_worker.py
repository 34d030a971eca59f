"""Calls into a library that may never come back, each with a deadline."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import TypeVar

T = TypeVar("T")
END_S = 2.0  # wall time that an idle thread may take to end


class Worker:
    """A thread that makes calls one after the other; whoever asks waits for a stated time at most.

    A native library cannot be interrupted, not even by Ctrl-C. Here the wait can be, and a call that hangs holds up
    nothing but this thread, which does not keep the program from ending.

    Attributes:
        lost: a call has not come back; the worker makes no other.
    """

    def __init__(self, name: str) -> None:
        """
        Args:
            name: of the thread, for people who debug.
        """
        self.lost = False
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def call(self, function: Callable[[], T], seconds: float) -> T:
        """What `function` gives, or raises.

        Raises:
            TimeoutError: it has not come back after `seconds` of wall time, or one before it did not.
        """
        if self.lost:
            raise TimeoutError("an earlier call has not come back")
        future: Future[T] = Future()

        def fill() -> None:
            try:
                future.set_result(function())
            except BaseException as error:  # noqa: BLE001 - raised again where it is waited for
                future.set_exception(error)

        self._calls.put(fill)
        if not wait([future], timeout=seconds).done:
            self.lost = True
            raise TimeoutError(f"no answer within {seconds:g} s")
        return future.result()

    def end(self, seconds: float = END_S) -> None:
        """Let the thread end after the calls that it still has, and wait for that if all have come back.

        A program that ends while the thread does is ended by the C library (a native frame is on its stack).
        """
        self._calls.put(None)
        if not self.lost:
            self._thread.join(seconds)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            call()
