"""`a465 doctor`: installation, cell and devices are checked, and a small job is done as a self-test."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "ROWS",
    "Rows",
    "doctor_step",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("cell.doctor.doctor"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
