"""The simulated cell: bodies, cubes and photographs."""
