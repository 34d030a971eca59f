"""Whatever computes, and whoever is killed, the chunks are the same."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ExecutionStopped, InputError
from cell.files.study import read_study
from cell.study.question.scratch import Bundle, bundle_of
from cell.study.work.chunks import Chunk, Store, chunks_of
from cell.study.work.engine import AnyExecutor, InThisProcess, Lane, OneProcess, Work, compute_all
from cell.study.work.worker import BUSY
from studies.cluster import cluster_by_commands, cluster_here
from studies.written import write_study
from typed.command_line import a465


def _asked(scenes: Path, points: int = 40, chunk: int = 4) -> tuple[Bundle, list[Chunk]]:
    study = read_study(write_study(scenes, points=points, chunk=chunk))
    bundle = bundle_of(study)
    return bundle, chunks_of(study, bundle)


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "chunks").iterdir())}


class Scripted:
    """A lane whose chunks end as a script says: done, or that the process was lost."""

    most, tries = 1, 2

    def __init__(self, store: Store, lost: set[int]) -> None:
        self._store, self._lost = store, lost

    def submit(self, chunk: Chunk) -> Future[str]:
        future: Future[str] = Future()
        if chunk.number in self._lost:
            future.set_exception(BrokenProcessPool())
        else:
            self._store.write(chunk, f"{chunk.number}\n")
            future.set_result("")
        return future

    def died(self, error: BaseException) -> bool:
        return isinstance(error, BrokenProcessPool)

    def close(self) -> None:
        pass


def test_a_chunk_that_its_processes_do_not_survive_is_set_aside_alone(scenes: Path, tmp_path: Path) -> None:
    _, chunks = _asked(scenes)
    store = Store(tmp_path)
    work = compute_all(chunks, store, [Scripted(store, {3})], lambda _: None)
    assert [chunk.number for chunk in work.aside] == [3]
    assert work.lost == 2
    assert [c.number for c in chunks if store.has(c)] == [0, 1, 2, 4, 5, 6, 7, 8, 9]


def test_if_processes_die_one_after_the_other_the_study_ends(scenes: Path, tmp_path: Path) -> None:
    _, chunks = _asked(scenes)
    store = Store(tmp_path)
    with pytest.raises(ExecutionStopped, match="10 processes died one after the other"):
        compute_all(chunks, store, [Scripted(store, set(range(10)))], lambda _: None)


def test_processes_that_die_now_and_then_do_not_end_the_study(scenes: Path, tmp_path: Path) -> None:
    _, chunks = _asked(scenes, points=60)
    store, lost = Store(tmp_path), set(range(0, 15, 2))
    work = compute_all(chunks, store, [Scripted(store, lost)], lambda _: None)
    assert {chunk.number for chunk in work.aside} == lost
    assert work.lost == 16
    assert work.done == 7


def test_a_chunk_that_somebody_else_is_at_is_asked_for_again(scenes: Path, tmp_path: Path) -> None:
    _, chunks = _asked(scenes)
    store, asked = Store(tmp_path), list[int]()

    class Busy(Scripted):
        def submit(self, chunk: Chunk) -> Future[str]:
            asked.append(chunk.number)
            if asked.count(chunk.number) > 1 or chunk.number % 4:
                return super().submit(chunk)
            future: Future[str] = Future()
            future.set_result(BUSY)
            return future

    work = compute_all(chunks, store, [Busy(store, set())], lambda _: None)
    assert work.done == len(chunks) == 10
    assert [number for number in range(10) if asked.count(number) == 2] == [0, 4, 8]
    assert all(map(store.has, chunks))


class Answering(ThreadPoolExecutor):
    """Answers each chunk at once, or with an error."""

    def __init__(self, errors: dict[int, Exception | None]) -> None:
        super().__init__(1)
        self._errors = errors

    def submit(self, _: object, *arguments: Any, **__: object) -> Future[str]:  # type: ignore[override]
        future: Future[str] = Future()
        number = arguments[1].number
        if number not in self._errors:
            future.set_result(f"{number}\n")
        elif (error := self._errors[number]) is None:
            future.cancel()
        else:
            future.set_exception(error)
        return future


def test_a_fault_at_one_point_sets_its_chunk_aside_and_is_told(scenes: Path, tmp_path: Path) -> None:
    bundle, chunks = _asked(scenes)
    lanes = [AnyExecutor(Answering({4: ZeroDivisionError("division")}), bundle, lambda: 1)]
    work = compute_all(chunks, Store(tmp_path), lanes, lambda _: None)
    assert [chunk.number for chunk in work.aside] == [4]
    assert work.failed == {4: "ZeroDivisionError: division"}
    assert work.done == 9


@pytest.mark.parametrize(
    ("error", "raised", "words"),
    [
        (
            ZeroDivisionError("division"),
            ExecutionStopped,
            "failed in 10 chunks one after the other: ZeroDivision",
        ),
        (
            ModuleNotFoundError("No module named 'cell'"),
            InputError,
            "a worker cannot import a465: No module named",
        ),
    ],
)
def test_a_program_that_fails_everywhere_ends_the_study(
    scenes: Path, tmp_path: Path, error: Exception, raised: type[Exception], words: str
) -> None:
    bundle, chunks = _asked(scenes, points=48)
    lanes = [AnyExecutor(Answering(dict.fromkeys(range(12), error)), bundle, lambda: 1)]
    with pytest.raises(raised, match=words):
        compute_all(chunks, Store(tmp_path), lanes, lambda _: None)


def test_faults_now_and_then_do_not_end_the_study(scenes: Path, tmp_path: Path) -> None:
    bundle, chunks = _asked(scenes, points=100)
    faults = dict.fromkeys(range(0, 25, 2), ZeroDivisionError("division"))
    lane = AnyExecutor(Answering(faults), bundle, lambda: 1)
    work = compute_all(chunks, Store(tmp_path), [lane], lambda _: None)
    assert {chunk.number for chunk in work.aside} == set(faults)
    assert work.done == 12


def test_a_cluster_without_workers_is_waited_for_but_not_forever(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle, chunks = _asked(scenes)
    monkeypatch.setattr("cell.study.work.engine._ASK_S", 0.0)
    some = iter([0, 0, 0, 1])
    lane = AnyExecutor(Answering({}), bundle, lambda: next(some, 1))
    assert compute_all(chunks, Store(tmp_path / "some"), [lane], lambda _: None).done == 10
    monkeypatch.setattr("cell.study.work.engine._ALONE_S", 1.0)
    with pytest.raises(ExecutionStopped, match="the cluster has had no worker for 1 s"):
        compute_all(
            chunks, Store(tmp_path / "none"), [AnyExecutor(Answering({}), bundle, lambda: 0)], lambda _: None
        )


def test_a_cluster_that_is_gone_ends_the_study(scenes: Path, tmp_path: Path) -> None:
    bundle, chunks = _asked(scenes)
    with pytest.raises(ExecutionStopped, match="scheduler is gone"):
        compute_all(
            chunks, Store(tmp_path), [AnyExecutor(Answering({2: None}), bundle, lambda: 1)], lambda _: None
        )


def test_what_is_there_is_not_computed_again(scenes: Path, tmp_path: Path) -> None:
    bundle, chunks = _asked(scenes)
    store = Store(tmp_path)
    store.write(chunks[3], "as it was\n")
    told: list[tuple[int, int]] = []
    lanes: list[Lane] = [InThisProcess(bundle, tmp_path)]
    work = compute_all(chunks, store, lanes, lambda w: told.append((w.found, w.done)))
    assert (work.found, work.done) == (1, 9)
    assert told[0] == (1, 0)
    assert store.read(chunks[3]) == "as it was\n"


def test_an_error_of_a_chunk_ends_the_study(scenes: Path, tmp_path: Path) -> None:
    bundle, chunks = _asked(scenes)

    executor: Executor = Answering({0: InputError("another version")})
    with pytest.raises(InputError, match="another version"):
        compute_all(chunks, Store(tmp_path), [AnyExecutor(executor, bundle, lambda: 1)], lambda _: None)


@pytest.mark.slow
def test_serial_processes_and_dask_give_the_same_bytes(scenes: Path, tmp_path: Path) -> None:
    from distributed import Client

    bundle, chunks = _asked(scenes)
    alone, processes, cluster, commands = (
        tmp_path / name for name in ("alone", "processes", "dask", "commands")
    )
    compute_all(chunks, Store(alone), [InThisProcess(bundle, alone)], lambda _: None)
    lanes = [OneProcess(bundle, processes) for _ in range(2)]
    compute_all(chunks, Store(processes), lanes, lambda _: None)
    with (
        cluster_here(2) as two,
        Client(two) as client,
    ):
        lane = AnyExecutor(client.get_executor(pure=False), bundle, lambda: 2)
        compute_all(chunks, Store(cluster), [lane], lambda _: None)
    with cluster_by_commands(tmp_path) as address:
        a465("study", scenes / "study.toml", "-o", commands, "--scheduler", address)
    assert _files(alone) == _files(processes) == _files(cluster) == _files(commands)
    assert len(_files(alone)) == len(chunks)


def _children(pid: int) -> list[int]:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in found if "spawn_main" in Path(f"/proc/{child}/cmdline").read_text()]


@pytest.mark.slow
@pytest.mark.parametrize("whom", ["worker", "program"])
def test_after_kills_at_random_moments_the_same_bytes_are_there(
    scenes: Path, tmp_path: Path, whom: str
) -> None:
    bundle, chunks = _asked(scenes, points=600, chunk=60)
    alone, killed = tmp_path / "alone", tmp_path / "killed"
    compute_all(chunks, Store(alone), [InThisProcess(bundle, alone)], lambda _: None)
    rng, kills = np.random.default_rng(1), 0
    command = [sys.executable, "-m", "a465", "study", scenes / "study.toml", "-o", killed, "--workers", "2"]
    while kills < 5:
        program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(rng.uniform(2.0, 6.0))
        victims = _children(program.pid) if whom == "worker" else [program.pid]
        if program.poll() is None and victims:
            os.kill(int(rng.choice(victims)), signal.SIGKILL)
        kills += 1
        if whom == "worker":
            assert program.wait(300.0) == 0
            for chunk in chunks[:3]:
                (killed / "chunks" / chunk.name).unlink()
        else:
            program.wait(300.0)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=300.0)
    assert _files(killed) == _files(alone)


def test_progress_is_told_while_nothing_ends(scenes: Path, tmp_path: Path) -> None:
    bundle, chunks = _asked(scenes, points=4)

    class Slow(ThreadPoolExecutor):
        def submit(self, *_: object, **__: object) -> Future[str]:  # type: ignore[override]
            return super().submit(lambda: time.sleep(0.8) or "0\n")

    told: list[Work] = []
    compute_all(chunks, Store(tmp_path), [AnyExecutor(Slow(1), bundle, lambda: 1)], told.append)
    assert len(told) >= 3
