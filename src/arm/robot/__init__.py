"""The robot: its URDF model, the shapes of its bodies, its tool, and errors of its links."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "LinkBody",
    "Robot",
    "load_robot",
    "by_link",
    "load_a465",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("arm.robot.model"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
