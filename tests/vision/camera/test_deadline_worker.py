"""Calls with a deadline into a library that may hang."""

from __future__ import annotations

import threading
import time

import pytest

from vision.camera.deadline_worker import Worker

pytestmark = pytest.mark.xdist_group("basler_parts")


def test_a_worker_gives_what_calls_give_and_raise() -> None:
    worker = Worker("test")
    assert worker.call(lambda: 3, 1.0) == 3
    with pytest.raises(ZeroDivisionError):
        worker.call(lambda: 1 // 0, 1.0)
    with pytest.raises(TimeoutError, match="its own"):
        worker.call(lambda: (_ for _ in ()).throw(TimeoutError("its own")), 1.0)
    assert not worker.lost
    assert worker.call(lambda: 4, 1.0) == 4
    worker.end()


def test_a_worker_that_is_lost_makes_no_other_call() -> None:
    worker, free, made = Worker("test"), threading.Event(), []
    begun = time.monotonic()
    with pytest.raises(TimeoutError, match=r"no answer within 0\.1 s"):
        worker.call(lambda: free.wait(300.0), 0.1)
    with pytest.raises(TimeoutError, match="an earlier call hangs"):
        worker.call(lambda: made.append(1), 300.0)
    assert time.monotonic() - begun < 60.0
    free.set()
    assert not made


def test_a_worker_that_was_ended_is_gone() -> None:
    """A native thread that ends while the interpreter does is ended by the C library, with exit code 134."""
    worker = Worker("ends")
    assert worker.call(lambda: 7, 5.0) == 7
    worker.end()
    assert "ends" not in {thread.name for thread in threading.enumerate()}


def test_a_worker_whose_call_was_late_is_gone_too() -> None:
    """A slow decoder returned while the program was exiting, which ended with code 134 instead of 2."""
    worker, free = Worker("late"), threading.Event()
    with pytest.raises(TimeoutError):
        worker.call(lambda: free.wait(20.0), 0.05)
    threading.Timer(0.05, free.set).start()
    worker.end()
    assert "late" not in {thread.name for thread in threading.enumerate()}
