"""What a run or a calibration leaves to be read: tables, pages and JSON."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "RELEASED",
    "HEADER",
    "CubeRow",
    "print_rows",
    "judge_release",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("cell.report.cubes"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
