"""A copy of the project in which mutants are tried, one after the other, each in a process that is forked for it.

The process that forks has the libraries loaded and nothing of the project: a test then costs little more than itself.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mutants_bench.mutant import FOUND, Mutant
from mutants_bench.reach import Reach

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("src", "tests", "urdf", "scenes", "docs", "examples", "bench")
FILES = ("pyproject.toml", "constraints.txt", "README.md", "CHANGELOG.md", "Makefile", "LICENSE")
RED, GREEN, LATE, SKIPPED = "red", "green", "red (time limit)", "skipped"
_ROOMS = ("a465", "arm", "plan", "vision", "driver", "render", "calib", "cell")
_LIBRARIES = (
    "numpy",
    "scipy.optimize",
    "scipy.spatial",
    "scipy.stats",
    "cv2",
    "pinocchio",
    "coal",
    "qpsolvers",
    "daqp",
    "osqp",
    "ruckig",
    "serial",
    "typer",
    "pytest",
)


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
    """A copy; removed by `close`. Nothing outside it is written, and no worktree that is in use is touched.

    Args:
        marks: expression of the marks that tests have, such as ``not slow``; "": all tests.
    """

    def __init__(self, marks: str = "") -> None:
        self.marks = marks
        self._folder = tempfile.TemporaryDirectory(prefix="a465-mutants-")
        self.root = Path(self._folder.name).resolve()
        ignored = shutil.ignore_patterns("__pycache__", "_data", "_build", "results")
        for name in COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, self.root / name, ignore=ignored)
        for name in FILES:
            if (ROOT / name).is_file():
                shutil.copy(ROOT / name, self.root / name)
        for name in _LIBRARIES:
            with contextlib.suppress(ImportError):
                importlib.import_module(name)
        # Bytecode is taken for that of a source with its time in whole seconds and its size: each text gets its own.
        self._time = int(time.time()) - 1_000_000

    def close(self) -> None:
        self._folder.cleanup()

    def run(
        self, tests: Sequence[str], limit_s: float, reach: tuple[list[str], Path] | None = None
    ) -> Outcome:
        """Test files or single tests, up to the first red one; with `reach`, all of them, traced."""
        log, began = self.root / "tests.log", time.monotonic()
        child = os.fork()
        if not child:
            self._be_pytest(tests, log, reach)
        while not (ended := os.waitpid(child, os.WNOHANG))[0]:
            if time.monotonic() - began > limit_s:
                os.killpg(child, signal.SIGKILL)  # its own group, with what its tests have started
                os.waitpid(child, 0)
                return Outcome(LATE, "", time.monotonic() - began)
            time.sleep(0.02)
        seconds, said = time.monotonic() - began, log.read_text(errors="replace")
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what tests have left behind
        if os.waitstatus_to_exitcode(ended[1]) == 0:
            return Outcome(GREEN, "", seconds)
        red = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
        return Outcome(RED, red[1] if red else (said.strip().splitlines() or ["?"])[-1][:200], seconds)

    def _be_pytest(self, tests: Sequence[str], log: Path, reach: tuple[list[str], Path] | None) -> None:
        """What the forked process does; it never returns."""
        code = 99
        try:
            os.setsid()
            signal.signal(signal.SIGINT, signal.default_int_handler)
            handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            for standard in (1, 2):
                os.dup2(handle, standard)
            os.chdir(self.root)
            os.environ["PYTHONPATH"] = str(self.root / "src")
            for name in [m for m in sys.modules if m.partition(".")[0] in _ROOMS]:
                del sys.modules[name]
            own = str(ROOT / "src")
            sys.path[:] = [str(self.root / "src"), *(p for p in sys.path if p != own)]
            importlib.invalidate_caches()
            import pytest

            words = ["-q", "-n", "0", "-p", "no:cacheprovider", "--no-header", "--tb=no", *tests]
            words += ["-m", self.marks] if self.marks else []
            if reach is None:
                code = int(pytest.main(["-x", *words]))
            else:
                code = int(pytest.main(words, plugins=[Reach(self.root / "src", *reach)]))
        except BaseException:  # noqa: BLE001 (the parent reads it in the log)
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)

    def try_one(self, mutant: Mutant, tests: Sequence[str], limit_s: float) -> Outcome:
        """Change the copy, run the tests, and change it back."""
        path, found = mutant.place(self.root / "src")
        if path is None or found != FOUND:
            return Outcome(f"{SKIPPED}: {found}", "", 0.0)
        if not tests:
            return Outcome(GREEN, "no test of its list reaches it", 0.0)
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
