"""Faults that the emulated unit and its line have, and when."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "Kind",
    "Direction",
    "KINDS",
    "DIRECTIONS",
    "LINE_KINDS",
    "AXES",
    "USED",
    "NEEDED",
    "KNOWN",
    "When",
    "Fault",
    "FaultEvent",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("driver.emulator.faults.model"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
