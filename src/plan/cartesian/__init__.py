"""Cartesian lines of the tool: differential inverse kinematics, reachability, and collision barriers."""
