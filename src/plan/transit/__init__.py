"""Transits around bodies: RRT-Connect and path optimisation."""

from arm.former import former_names

former_names(__name__, "plan.transit.planner", "plan_transit", Detours="TransitPlanner")
