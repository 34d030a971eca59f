"""Find every configuration for a tool pose, and why the other branches do not reach it."""

import numpy as np

from a465 import explain_pose, inverse_kinematics, load_a465, load_unit, rot_x, transform

unit, robot = load_unit("crs93"), load_a465(0.134112, 0.060)
T_base_tool = transform(rot_x(np.pi), (0.45, 0.10, 0.08))  # above the table, pointing down

found = inverse_kinematics(robot, T_base_tool, unit.lower, unit.upper)
for name, q in zip(found.names(), found, strict=True):
    print(f"{name:18s}", np.round(np.degrees(q), 1))
for report in explain_pose(robot, T_base_tool, unit.lower, unit.upper):
    if not report.inside:
        print(f"{report.branch:18s} {report.joint} is {np.degrees(report.excess):.1f} deg beyond its limit")
