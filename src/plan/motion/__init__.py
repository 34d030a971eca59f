"""Motions from rest to rest."""

from arm.former import former_names

former_names(
    __name__,
    "plan.motion.builder",
    Phase="MotionPhase",
    Grip="ApproachLine",
    Leg="RestToRestPath",
    Mover="MotionBuilder",
)
