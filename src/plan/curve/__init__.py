"""Curves of the tool: a path of poses with free directions becomes a path of the joints."""

from arm.former import former_names

former_names(
    __name__, "plan.collision.bezier", "Curve", "curve_of_counts", "curve_of_waypoints", "curve_of_path"
)
