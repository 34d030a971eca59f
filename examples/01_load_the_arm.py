"""Load the arm, and print the tool pose at a configuration and the joint limits."""

import numpy as np

from a465 import load_a465, load_unit

unit = load_unit("crs93")
robot = load_a465(tool_length=0.134112, jaw_opening=0.060)

q = np.radians([-60, -40, -80, 0, -60, 0])
T_base_tool = robot.T_base_tool(q)
print("tool at", np.round(1e3 * T_base_tool[:3, 3], 1), "mm, pointing along", np.round(T_base_tool[:3, 2], 3))
print("which is", unit.counts(q).tolist(), "encoder counts")
for name, low, high, speed in zip(
    robot.joint_names, unit.lower, unit.upper, unit.limits().velocity, strict=True
):
    print(f"{name}: {np.degrees(low):7.1f} to {np.degrees(high):6.1f} deg, {np.degrees(speed):6.1f} deg/s")
