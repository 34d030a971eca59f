"""The simulated cell: bodies, cubes and images."""
