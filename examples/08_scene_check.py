"""Print the distances at one configuration, and certify a whole motion."""

import numpy as np

from a465 import (
    Body,
    Box,
    Capsule,
    World,
    certify,
    convex,
    curve_of_waypoints,
    load_a465,
    rot_y,
    transform,
)

robot = load_a465(tool_length=0.134112, jaw_opening=0.060)
wedge = convex([(0, 0, 0), (0.2, 0, 0), (0.2, 0.1, 0), (0, 0.1, 0), (0, 0, 0.15), (0, 0.1, 0.15)])
world = World(
    robot,
    (
        Body("table", Box((1.2, 1.4, 0.04)), transform(t=(0.3, 0.0, -0.02)), "table"),
        Body("wedge", wedge, transform(t=(0.35, 0.10, 0.0)), "wall"),
        Body("handrail", Capsule(0.02, 0.6), transform(rot_y(np.pi / 2), (0.4, -0.45, 0.35)), "post"),
    ),
)
q = np.radians([[-35, -20, -100, 0, -60, 0], [35, -20, -100, 0, -60, 0]])
for distance in world.distances_below(q[1], 0.20):
    print(f"{distance.pair[0]:8s} is {1e3 * distance.value:6.1f} mm from {distance.pair[1]}")

check = certify(world, curve_of_waypoints(q), clearance=0.010, tight=True)
print(
    f"on the way: proved {1e3 * check.clearance:.1f} mm, seen {1e3 * check.seen:.1f} mm, {' and '.join(check.pair)}"
)
print("10 mm are", "kept" if check.proved else "not kept")
