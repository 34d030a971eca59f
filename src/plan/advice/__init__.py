"""What would help where no plan was found: changes of the task, tried by planning."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "BUDGET",
    "WANTED",
    "Advice",
    "advise",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("plan.advice.search"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
