"""A pytest plugin: which lines of given source files each test reaches, and how long each takes."""

from __future__ import annotations

import json
import sys
import threading
from collections import defaultdict
from pathlib import Path
from types import FrameType
from typing import Any

import pytest


class Reach:
    """Traces tests one by one; lines that run while modules are imported are nobody's.

    Args:
        src: folder of the sources.
        files: below it, such as ``plan/collision/certificate.py``.
        output: JSON file: seconds by test, and tests by ``file:line``.
    """

    def __init__(self, src: Path, files: list[str], output: Path) -> None:
        self.names = {str(src / file): file for file in files}
        self.output = output
        self.seconds: dict[str, float] = defaultdict(float)
        self.tests: dict[str, list[str]] = defaultdict(list)
        self._now: set[tuple[str, int]] = set()

    def _enter(self, frame: FrameType, event: str, _: Any) -> Any:
        return self._line if frame.f_code.co_filename in self.names else None

    def _line(self, frame: FrameType, event: str, _: Any) -> Any:
        self._now.add((frame.f_code.co_filename, frame.f_lineno))
        return self._line

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        self._now = set()
        threading.settrace(self._enter)
        sys.settrace(self._enter)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)
            for file, line in self._now:
                self.tests[f"{self.names[file]}:{line}"].append(item.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration
        if report.failed:  # of no use: it is red without a mutant
            self.seconds[report.nodeid] = float("inf")

    def pytest_sessionfinish(self) -> None:
        good = {test: round(s, 3) for test, s in self.seconds.items() if s < float("inf")}
        tests = {line: [t for t in names if t in good] for line, names in self.tests.items()}
        self.output.write_text(json.dumps({"seconds": good, "tests": tests}))
