"""The legs and head of a NAO: chains, recordings, backlash and calibration."""

from arm.former import former_names

_MOVED = ("NaoUnknowns", "nao_model", "nao_chain", "gravity_torques", "KnownSides", "gravity_gains")
former_names(__name__, "calib.nao.chain", *_MOVED, "nao_sightings")
