"""The legs and head of a NAO: chains, recordings, backlash and calibration."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(
        __name__,
        "calib.nao.chain",
        "NaoUnknowns",
        "nao_model",
        "nao_chain",
        "gravity_torques",
        "KnownSides",
        "gravity_gains",
        "nao_sightings",
    )
