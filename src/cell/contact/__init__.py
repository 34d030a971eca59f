"""The simulated cell with contact physics (MuJoCo), as an optional judge of placement."""
