"""Joint trajectories that other programs made: read, certified, and made plans that can be executed."""
