"""A chain of joints with a camera: one fit of everything, its model selection, tests and verdict."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "Fixed",
    "Unknown",
    "Motion",
    "Element",
    "Evaluated",
    "Chain",
    "pose_unknowns",
    "joined",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("calib.model.chain"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
