"""Motions from rest to rest: phases, and the builder that times and certifies them."""

from arm.former import former_names

former_names(__name__, "plan.motion.builder", Mover="MotionBuilder")
