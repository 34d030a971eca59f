"""Lines of the tool: differential inverse kinematics, reachability, and the barrier beside bodies."""
