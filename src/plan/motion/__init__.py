"""Motions of one leg, from rest to rest."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "Phase",
    "Grip",
    "Leg",
    "Mover",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("plan.motion.builder"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
