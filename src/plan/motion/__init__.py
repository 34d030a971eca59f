"""Motions from rest to rest."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(
        __name__,
        "plan.motion.builder",
        Phase="MotionPhase",
        Grip="ApproachLine",
        Leg="RestToRestPath",
        Mover="MotionBuilder",
    )
