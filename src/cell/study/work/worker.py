"""What computes chunks of a study, in a process of its own, on this machine or another."""

from __future__ import annotations

import ctypes
import gc
import os
import platform
import signal
import threading
import time
from pathlib import Path

from arm.errors import InputError
from arm.io.storage import sha256
from cell.study.question.scratch import Bundle, code_digest
from cell.study.work.chunks import Chunk, Store
from cell.study.work.stages import Evaluator
from driver.line.signals import leave_to_others

BUSY = "busy"  # somebody else is at the chunk
_ORPHAN_POLL_S = 0.5
# glibc's mallopt(3): memory at the top of the heap from which it is given back, and blocks that are mapped one by one
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _KEPT_BYTES, _MAPPED_BYTES = -1, -3, 256 * 2**20, 32 * 2**20

_evaluators: dict[str, Evaluator] = {}
_computing = threading.Lock()


def begin(parent: int) -> None:
    """Prepare a process of this machine: Ctrl-C is for the program that started it, whose end ends it too.

    A chunk that it is at is finished first: it may have taken minutes.

    Args:
        parent: process of the program. It may have ended already, so nobody here can ask who it was.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    leave_to_others()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_ORPHAN_POLL_S)
        with _computing:
            os._exit(0)

    threading.Thread(target=watch, daemon=True).start()


def compute(bundle: Bundle, chunk: Chunk, into: Path | None) -> str:
    """Compute a chunk.

    Args:
        bundle: the study's files.
        chunk: the chunk.
        into: folder of the study, if this process can write there; its file is then written.

    Returns:
        Its table; "" if it was written, `BUSY` if somebody else is at it.

    Raises:
        InputError: this machine has another version of the program.
    """
    with _computing:
        if into is None:
            return _evaluator(bundle).table(chunk.first, chunk.count)
        store = Store(into, tidy=False)
        with store.claimed(chunk) as mine:
            if not mine:
                return BUSY
            if not store.has(chunk):
                store.write(chunk, _evaluator(bundle).table(chunk.first, chunk.count))
        return ""


def _evaluator(bundle: Bundle) -> Evaluator:
    key = bundle.digest + sha256(bundle.files[bundle.study])
    if key not in _evaluators:
        if bundle.code != code_digest():
            raise InputError(
                f"{platform.node()}: a465, Python {platform.python_version()} or a library differs from that of the "
                "program that asks; install the same versions, and start the workers again",
                host=platform.node(),
            )
        _evaluators.clear()
        _keep_memory()
        gc.collect()
        gc.freeze()  # searching all modules for garbage again and again costs a twentieth of a plan
        _evaluators[key] = Evaluator(bundle)
    return _evaluators[key]


def _keep_memory() -> None:
    """Keep freed memory for the next arrays. Other C libraries than glibc are left as they are.

    Dask has its workers give back all that is above 64 kB. Each array is then mapped anew, which costs a third of the
    time of reach.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_MMAP_THRESHOLD, _MAPPED_BYTES)
