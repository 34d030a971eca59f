"""The emulated serial line: its ports, its speed, and how it weaves what arrives."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "Tap",
    "MemoryLine",
    "MemoryWire",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("driver.emulator.line.memory"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
