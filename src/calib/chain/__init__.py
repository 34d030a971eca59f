"""Calibration of a chain of joints with a camera: one fit of everything, model selection, score tests and verdict."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(
        __name__,
        "calib.model.chain",
        "Fixed",
        "Unknown",
        "Motion",
        "Element",
        "Evaluated",
        "Chain",
        "pose_unknowns",
        "joined",
    )
