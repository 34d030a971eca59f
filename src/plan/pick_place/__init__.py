"""Tasks with cubes: order, grasps, transits and recovery."""
