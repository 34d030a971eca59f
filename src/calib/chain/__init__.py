"""Calibration of a chain of joints with a camera: one fit of everything, model selection, score tests and verdict."""

from arm.former import former_names

_MOVED = ("Fixed", "Unknown", "Motion", "Element", "Evaluated", "Chain", "pose_unknowns", "joined")
former_names(__name__, "calib.model.chain", *_MOVED)
