"""Plan a motion around a wall, with its clearance certified as it will be sent."""

import numpy as np

from a465 import Body, Box, PlanOptions, Scene, load_a465, load_unit, plan_joint_motion, transform

unit = load_unit("crs93")
bodies = (
    Body("table", Box((1.2, 1.4, 0.04)), transform(t=(0.3, 0.0, -0.02)), "table"),
    Body("wall", Box((0.40, 0.02, 0.50)), transform(t=(0.50, 0.0, 0.25)), "wall"),
)
scene = Scene(load_a465(0.134112, 0.060), load_a465(0.134112, 0.040), bodies, ())

plan = plan_joint_motion(
    scene,
    q_from=np.radians([-35, -35, -85, 0, -60, 0]),
    q_to=np.radians([35, -35, -85, 0, -60, 0]),
    unit=unit,
    options=PlanOptions(speed=1.0, clearance=0.010),
)
if plan is not None:
    for move in plan.moves:
        print(f"{move.path.duration_s:.2f} s in {len(move.path.segments)} segments")
        print(f"nowhere nearer than {1e3 * move.clearance:.1f} mm: {' and '.join(move.closest)}")
