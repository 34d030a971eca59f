"""Plans, logs and scenes for other programs."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "PERIOD_S",
    "URDF",
    "SUFFIXES",
    "Asked",
    "export_file",
    "export_step",
    "csv_text",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("cell.export.export"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
