"""One arm on one controller: identify, initialise, home, move, grip, stop."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "ENGAGE_S",
    "RELEASE_MARGIN_S",
    "Mars",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("driver.mars.mars"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
