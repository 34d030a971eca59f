"""What the figures rest on, and CPU time."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_LIBRARIES = ("a465", "numpy", "pin", "coal", "roboplan")


def conditions(what: str) -> str:
    """Return commit, versions, machine, and `what` was run."""
    root = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        ran = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False)
        return ran.stdout.strip()

    def of(name: str) -> str:
        try:
            return f"{name} {version(name)}"
        except PackageNotFoundError:
            return f"{name} -"

    changed = " with changes" if git("status", "--porcelain", "--", "src", "bench") else ""
    return (
        f"conditions: commit {git('rev-parse', '--short', 'HEAD')}{changed}; Python {platform.python_version()}; "
        + ", ".join(map(of, _LIBRARIES))
        + f"\n  machine: {os.cpu_count()} processors, load {', '.join(f'{x:.1f}' for x in os.getloadavg())}; CPU is "
        "process time over all threads\n"
        f"  {what}"
    )


@contextmanager
def timed(into: list[float]) -> Iterator[None]:
    """Append the CPU time of the context, s."""
    began = time.process_time()
    yield
    into.append(time.process_time() - began)
