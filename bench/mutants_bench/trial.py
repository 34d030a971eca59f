"""A copy of the project in which mutants are tried, one after the other."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mutants_bench.mutant import FOUND, Mutant

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("src", "tests", "urdf", "scenes", "docs", "examples", "bench")
FILES = ("pyproject.toml", "constraints.txt", "README.md", "CHANGELOG.md", "Makefile", "LICENSE")
RED, GREEN, LATE, SKIPPED = "red", "green", "red (time limit)", "skipped"


@dataclass(frozen=True)
class Outcome:
    """Of one mutant.

    Attributes:
        result: `RED`, `GREEN`, `LATE` (a loop without an end is seen too), or why it could not be tried.
        seen_by: the test that was red first.
        seconds: of wall time.
    """

    result: str
    seen_by: str
    seconds: float


class Trial:
    """A copy; removed on leaving. Nothing outside it is written, and no worktree that is in use is touched."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="a465-mutants-")
        self.root = Path(self._folder.name)
        ignored = shutil.ignore_patterns("__pycache__", "_data", "_build", "results")
        for name in COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, self.root / name, ignore=ignored)
        for name in FILES:
            if (ROOT / name).is_file():
                shutil.copy(ROOT / name, self.root / name)
        # Bytecode is taken for that of a source with its time in whole seconds and its size: each text gets its own.
        self._time = int(time.time()) - 1_000_000

    def close(self) -> None:
        self._folder.cleanup()

    def run(self, tests: Sequence[str], limit_s: float) -> Outcome:
        """The tests up to the first red one."""
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.root / "src"),
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
        }
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "-n",
            "0",
            "-p",
            "no:cacheprovider",
            "--no-header",
        ]
        command += ["--tb=no", *(f"tests/{name}" for name in tests)]
        began = time.monotonic()
        child = subprocess.Popen(
            command,
            cwd=self.root,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            said, _ = child.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(
                child.pid, signal.SIGKILL
            )  # the group that was made for it, with what its tests have started
            child.communicate()
            return Outcome(LATE, "", time.monotonic() - began)
        seconds = time.monotonic() - began
        if child.returncode == 0:
            return Outcome(GREEN, "", seconds)
        red = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
        if red is None:
            return Outcome(RED, (said.strip().splitlines() or ["?"])[-1][:200], seconds)
        return Outcome(RED, red[1], seconds)

    def try_one(self, mutant: Mutant, tests: Sequence[str], limit_s: float) -> Outcome:
        """Change the copy, run the tests, and change it back."""
        path, found = mutant.place(self.root / "src")
        if path is None or found != FOUND:
            return Outcome(f"{SKIPPED}: {found}", "", 0.0)
        if not tests:
            return Outcome(GREEN, "no test of this module", 0.0)
        before = path.read_text()
        try:
            self._write(path, mutant.apply(path))
            return self.run(tests, limit_s)
        finally:
            self._write(path, before)

    def _write(self, path: Path, text: str) -> None:
        path.write_text(text)
        self._time += 1
        os.utime(path, (self._time, self._time))
