"""Programs on the road of tasks: run, resumed, and what of them is in reach."""
