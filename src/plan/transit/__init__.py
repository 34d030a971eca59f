"""Transits around bodies: RRT-Connect and path optimisation."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "plan.transit.planner", "plan_transit", Detours="TransitPlanner")
