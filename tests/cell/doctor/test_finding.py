"""Checks that hang or fail are findings; mistakes of the program are not hidden."""

from __future__ import annotations

import threading
import time

import pytest

from arm.errors import InputError
from cell.doctor import finding
from cell.doctor.finding import WRONG, CheckResult, guarded

pytestmark = pytest.mark.xdist_group("doctor")


def test_a_check_that_hangs_is_wrong_in_time() -> None:
    over = threading.Event()
    began = time.monotonic()
    found = guarded("slow", lambda: over.wait(120.0), 0.1, "wait")
    over.set()
    assert time.monotonic() - began < 60.0
    assert found == CheckResult("slow", WRONG, "no answer within 0.1 s", "wait", {"error": "TimeoutError"})


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (
            InputError("bad key", key="x"),
            CheckResult("c", WRONG, "bad key", "h", {"error": "InputError", "key": "x"}),
        ),
        (OSError(5, "broken"), CheckResult("c", WRONG, "[Errno 5] broken", "h", {"error": "OSError"})),
        (ImportError("no x"), CheckResult("c", WRONG, "cannot be checked: no x", finding.REINSTALL)),
    ],
)
def test_a_check_that_fails_is_wrong(error: Exception, told: CheckResult) -> None:
    def fail() -> CheckResult:
        raise error

    assert guarded("c", fail, 5.0, "h") == told


def test_mistakes_of_the_program_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        guarded("c", lambda: 1 // 0, 5.0, "h")
