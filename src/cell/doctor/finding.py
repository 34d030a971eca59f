"""What one check of ``a465 doctor`` found. Imports nothing that may be missing."""

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
class Finding:
    """A row of the table.

    Attributes:
        check: what was looked at.
        verdict: one of `VERDICTS`; a note is worth knowing and stops nothing.
        found: the figures, for a person.
        help: what would help, unless the verdict is ok.
        data: the same facts for a program (JSON types).
    """

    check: str
    verdict: str
    found: str
    help: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """All of it."""
        return {
            "check": self.check,
            "verdict": self.verdict,
            "found": self.found,
            "help": self.help,
            "data": dict(self.data),
        }


def guarded(check: str, look: Callable[[], T], seconds: float, help: str) -> T | Finding:
    """What `look` gives; or, if it fails or does not come back in time, that this is wrong.

    Args:
        check: name of the row.
        look: may hang in a library, or need one that is not there.
        seconds: of wall time that it may take.
        help: what would help if it fails.
    """
    worker = Worker(f"doctor: {check}")
    try:
        return worker.call(look, seconds)
    except ImportError as error:
        return Finding(check, WRONG, f"cannot be looked at: {error}", REINSTALL)
    except (A465Error, OSError) as error:  # TimeoutError is an OSError
        data = error.data if isinstance(error, A465Error) else {}
        return Finding(check, WRONG, str(error), help, {"error": type(error).__name__, **data})
    finally:
        worker.end()


REINSTALL = "install a465 again with all that it needs: make run, or pip install -e ."
