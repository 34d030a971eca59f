"""The legs and head of a NAO: its chains, stances, backlash and calibration."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "LEG",
    "HEAD",
    "SIDES",
    "LEG_JOINTS",
    "CAMERA_TURNS",
    "MOUNT",
    "PLAY_NM",
    "NaoUnknowns",
    "nao_model",
    "nao_chain",
    "gravity_torques",
    "KnownSides",
    "gravity_gains",
    "nao_sightings",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("calib.nao.chain"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
