"""The page that follows a run."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "LEAST_PORT",
    "Live",
    "live_view",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("cell.live.view"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
