"""The result of one check of ``a465 doctor``. This module imports nothing that may be missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from arm.errors import A465Error
from vision.camera.deadline_worker import Worker

OK, NOTE, WRONG = "ok", "note", "wrong"
VERDICTS = (OK, NOTE, WRONG)  # from good to bad
T = TypeVar("T")


@dataclass(frozen=True)
class CheckResult:
    """A row of the table.

    Attributes:
        check: name of the check.
        verdict: one of `VERDICTS`; a note prevents nothing.
        found: what was found, in words.
        help: what would help if the verdict is not ok.
        data: what was found, as JSON types.
    """

    check: str
    verdict: str
    found: str
    help: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)


def guarded(check: str, run: Callable[[], T], seconds: float, help: str = "") -> T | CheckResult:
    """Return the result of `run`, or a row with the verdict wrong if it fails or exceeds its time.

    Args:
        check: name of the row.
        run: the check; it may hang in a library, or need a missing one.
        seconds: wall time limit.
        help: what would help if it fails.
    """
    worker = Worker(f"doctor: {check}")
    try:
        return worker.call(run, seconds)
    except ImportError as error:
        return CheckResult(check, WRONG, f"cannot be checked: {error}", REINSTALL)
    except (A465Error, OSError) as error:  # TimeoutError is an OSError
        data = error.data if isinstance(error, A465Error) else {}
        return CheckResult(check, WRONG, str(error), help, {"error": type(error).__name__, **data})
    finally:
        worker.end()


REINSTALL = "reinstall a465 with its dependencies: make run, or pip install -e ."
