"""A Dask cluster on this machine, started by Dask's own commands as docs/study.md says."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from distributed import LocalCluster

_WAIT_S = 60.0
_COMMAND = [str(Path(sys.executable).with_name("dask"))]


def free_port() -> int:
    """A port of loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def _running(folder: Path, *words: str) -> Iterator[None]:
    """A command of Dask in its own group of processes, which all end with it."""
    with (folder / f"dask-{words[0]}.log").open("w") as log:
        program = subprocess.Popen(
            [*_COMMAND, *words], cwd=folder, stdout=log, stderr=log, start_new_session=True
        )
        try:
            yield
        finally:
            program.send_signal(signal.SIGINT)
            try:
                program.wait(_WAIT_S)
            except subprocess.TimeoutExpired:
                os.killpg(program.pid, signal.SIGKILL)
                program.wait(_WAIT_S)


def cluster_here(workers: int, threads: int = 1) -> LocalCluster:
    """A cluster of this process, to be left by `with`.

    Without a dashboard, Dask's scheduler still listens on port 8787 for its health page, and warns if
    another one of the same machine has it. Tests that run side by side would have to share it.

    Args:
        workers: number of processes.
        threads: threads of each.
    """
    from distributed import LocalCluster

    pages = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=threads,
        host="127.0.0.1",
        dashboard_address=None,
        scheduler_kwargs=pages,
    )


@contextmanager
def cluster_by_commands(folder: Path, workers: int = 2) -> Iterator[str]:
    """Start a scheduler and workers with one thread each; yield the scheduler's address.

    Args:
        folder: for their files.
        workers: number of processes.

    Raises:
        TimeoutError: the workers did not come.
    """
    from distributed import Client

    address = f"127.0.0.1:{free_port()}"
    scheduler = ("scheduler", "--host", "127.0.0.1", "--port", address.partition(":")[2], "--no-dashboard")
    pages = ("--dashboard-address", "127.0.0.1:0")
    worker = ("worker", f"tcp://{address}", "--nthreads", "1", "--nworkers", str(workers))
    here = ("--host", "127.0.0.1", "--no-dashboard", "--local-directory", str(folder / "dask-worker-space"))
    with ExitStack() as started:
        started.enter_context(_running(folder, *scheduler, *pages))
        started.enter_context(_running(folder, *worker, *here))
        with Client(f"tcp://{address}", timeout=_WAIT_S) as client:
            client.wait_for_workers(workers, timeout=_WAIT_S)
        yield f"tcp://{address}"
