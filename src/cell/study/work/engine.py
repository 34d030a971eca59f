"""Hands the chunks of a study to processes, of this machine or of a cluster, until all are finished or set aside."""

from __future__ import annotations

import math
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Protocol

from arm.errors import A465Error, ExecutionStopped, InputError
from cell.study.question.scratch import Bundle
from cell.study.work.chunks import Chunk, Store
from cell.study.work.worker import BUSY, begin, compute

_POLL_S = 0.5
_MOST_DEATHS = 10  # in a row, without a chunk that was finished
_MOST_FAULTS = 10  # of the program, in a row
_BUSY_S = 0.2  # between two looks at what somebody else is at
_ASK_S = 5.0  # between two questions for the workers of a cluster
_ALONE_S = 120.0  # a cluster may be without a worker


class Lane(Protocol):
    """Takes chunks, and computes some of them at a time."""

    tries: int
    """Processes that a chunk may cost before it is set aside."""

    @property
    def most(self) -> int:
        """Chunks that it holds at a time."""
        ...

    def submit(self, chunk: Chunk) -> Future[str]:
        """Begin with a chunk, or put it behind those that it holds."""
        ...

    def died(self, error: BaseException) -> bool:
        """Whether an error means that the process of a chunk was lost; the lane then goes on with another."""
        ...

    def close(self) -> None:
        """Take no more chunks; let go of those that have not begun."""
        ...


class OneProcess:
    """A lane with one process of this machine. A process that is lost takes no chunk of another lane with it."""

    most, tries = 1, 2  # after Ctrl-C, none waits for its turn

    def __init__(self, bundle: Bundle, folder: Path) -> None:
        self._bundle, self._folder = bundle, folder
        self._pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            1, mp_context=get_context("spawn"), initializer=begin, initargs=(os.getpid(),)
        )

    def submit(self, chunk: Chunk) -> Future[str]:
        """Begin with a chunk."""
        try:
            return self._pool.submit(compute, self._bundle, chunk, self._folder)
        except BrokenProcessPool:
            self._pool.shutdown(wait=False)
            self._pool = self._new()
            return self._pool.submit(compute, self._bundle, chunk, self._folder)

    def died(self, error: BaseException) -> bool:
        """Whether its process was lost."""
        return isinstance(error, BrokenProcessPool)

    def close(self) -> None:
        """Take no more chunks."""
        self._pool.shutdown(wait=False, cancel_futures=True)


class AnyExecutor:
    """A lane with an executor, such as that of a cluster; its processes send their tables back.

    Args:
        executor: takes functions.
        workers: returns how many processes it has now.
        lost: errors that mean that a process was lost.
    """

    def __init__(
        self,
        executor: Executor,
        bundle: Bundle,
        workers: Callable[[], int],
        lost: tuple[type[BaseException], ...] = (),
    ) -> None:
        self.tries = 2  # a cluster has tried before it gives up, and blames all that a lost process held
        self._executor, self._bundle, self._workers, self._lost = executor, bundle, workers, lost
        self._count, self._asked_s, self._seen_s = 0, -math.inf, time.monotonic()

    @property
    def most(self) -> int:
        """Two chunks for each process, so that none waits for the next.

        Raises:
            ExecutionStopped: there has been no process for two minutes.
        """
        now = time.monotonic()
        if now - self._asked_s >= _ASK_S:
            self._count, self._asked_s = self._workers(), now
        if self._count:
            self._seen_s = now
        elif now - self._seen_s > _ALONE_S:
            why = f"the cluster has had no worker for {_ALONE_S:g} s; start some, and give the same command again"
            raise ExecutionStopped(why, reason="workers")
        return 2 * self._count

    def submit(self, chunk: Chunk) -> Future[str]:
        """Hand a chunk to the executor."""
        return self._executor.submit(compute, self._bundle, chunk, None)

    def died(self, error: BaseException) -> bool:
        """Whether a process of the executor was lost."""
        return isinstance(error, self._lost)

    def close(self) -> None:
        """Take no more chunks."""
        self._executor.shutdown(wait=False)


class InThisProcess:
    """A lane that computes each chunk at once, in this process."""

    most, tries = 1, 1

    def __init__(self, bundle: Bundle, folder: Path) -> None:
        self._bundle, self._folder = bundle, folder

    def submit(self, chunk: Chunk) -> Future[str]:
        """Compute a chunk."""
        future: Future[str] = Future()
        future.set_result(compute(self._bundle, chunk, self._folder))
        return future

    def died(self, error: BaseException) -> bool:
        """Never: this process would be lost."""
        return False

    def close(self) -> None:
        """Do nothing."""


@dataclass
class Work:
    """What was done.

    Attributes:
        found: number of chunks that were there already.
        done: number of chunks that were computed.
        lost: number of processes that were lost.
        aside: chunks that their processes did not survive.
        deaths: number of processes that a chunk cost, by its number.
        failed: why chunks were set aside whose computation failed, by their number.
        in_a_row: number of processes that were lost since a chunk was finished.
        faults_in_a_row: number of faults of the program since then.
    """

    found: int = 0
    done: int = 0
    lost: int = 0
    aside: list[Chunk] = field(default_factory=list)
    deaths: Counter[int] = field(default_factory=Counter)
    failed: dict[int, str] = field(default_factory=dict)
    in_a_row: int = 0
    faults_in_a_row: int = 0


def compute_all(
    chunks: Sequence[Chunk], store: Store, lanes: Iterable[Lane], told: Callable[[Work], None]
) -> Work:
    """Compute all chunks that are not there.

    Args:
        chunks: all chunks.
        store: where they are.
        lanes: which compute.
        told: called after each chunk, and every `_POLL_S` seconds.

    Raises:
        A465Error: a chunk refuses as a whole, such as on a machine with another version of the program.
        ExecutionStopped: processes die or fail one after the other, or the cluster is gone.
    """
    left = deque(chunk for chunk in chunks if not store.has(chunk))
    work = Work(found=len(chunks) - len(left))
    held: dict[int, dict[Future[str], Chunk]] = {}
    with ExitStack() as closing:
        taking = list(lanes)
        for lane in taking:
            closing.callback(lane.close)
            held[id(lane)] = {}
        told(work)
        while left or any(held.values()):
            for lane in taking:
                mine = held[id(lane)]
                while left and len(mine) < lane.most:
                    chunk = left.popleft()
                    mine[lane.submit(chunk)] = chunk
            waiting = [future for mine in held.values() for future in mine]
            if waiting:
                wait(waiting, _POLL_S, FIRST_COMPLETED)
            else:
                time.sleep(_POLL_S)  # until a cluster has a worker
            for lane in taking:
                _collect(lane, held[id(lane)], store, left, work)
            told(work)
            if work.in_a_row >= _MOST_DEATHS:
                why = (
                    f"{work.in_a_row} processes died one after the other, and no chunk was finished meanwhile"
                )
                raise ExecutionStopped(why, reason="died")
            if work.faults_in_a_row >= _MOST_FAULTS:
                last = list(work.failed.values())[-1]
                why = f"the program failed in {work.faults_in_a_row} chunks one after the other: {last}"
                raise ExecutionStopped(why, reason="fault")
    return work


def _collect(
    lane: Lane, mine: dict[Future[str], Chunk], store: Store, left: deque[Chunk], work: Work
) -> None:
    """Take what a lane has finished, in the order in which it began."""
    for future, chunk in [(future, chunk) for future, chunk in mine.items() if future.done()]:
        del mine[future]
        if _lost(lane, future):
            work.lost += 1
            work.in_a_row += 1
            work.deaths[chunk.number] += 1
            if work.deaths[chunk.number] >= lane.tries:
                work.aside.append(chunk)
            else:
                left.appendleft(chunk)
            continue
        if future.cancelled():
            raise ExecutionStopped("the cluster cancelled a chunk: its scheduler is gone", reason="cluster")
        error = future.exception()
        if isinstance(error, ImportError):  # before any code of a465 could compare versions
            why = f"a worker cannot import a465: {error}; install the same version there"
            raise InputError(why, reason="import") from error
        if isinstance(error, Exception) and not isinstance(error, A465Error):
            # a fault of the program at one point must not end the study; the program tells it
            work.failed[chunk.number] = f"{type(error).__name__}: {error}"
            work.aside.append(chunk)
            work.faults_in_a_row += 1
        elif error is not None:
            raise error
        else:
            _take(future.result(), chunk, store, left, work)


def _lost(lane: Lane, future: Future[str]) -> bool:
    """Whether the process of a chunk was lost."""
    error = None if future.cancelled() else future.exception()
    return error is not None and lane.died(error)


def _take(result: str, chunk: Chunk, store: Store, left: deque[Chunk], work: Work) -> None:
    if result == BUSY:
        left.append(chunk)
        time.sleep(_BUSY_S)
        return
    if result:
        store.write(chunk, result)
    work.done += 1
    work.in_a_row = work.faults_in_a_row = 0
