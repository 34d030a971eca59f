"""The legs and head of a NAO: chains, recordings, backlash and calibration."""

from arm.former import former_names

former_names(
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
