"""The command line: options and verbs, each a few lines that call `cell.commands`."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "app",
    "run",
    "look",
    "reach",
    "plan",
    "plan_poses",
    "check",
    "preview",
    "execute",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("cell.cli.main"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
