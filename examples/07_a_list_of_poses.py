"""Follow the rim of a pipe with the A465, the tool free to rotate about its own axis."""

import csv
from pathlib import Path

import numpy as np

from a465 import (
    Body,
    Box,
    Cylinder,
    PlanOptions,
    Target,
    load_a465,
    load_unit,
    plan_poses,
    rot_x,
    transform,
)

unit, robot = load_unit("crs97"), load_a465(tool_length=0.134112, jaw_opening=0.0)
centre, radius = np.array([0.42, 0.0, 0.16]), 0.06
bodies = (
    Body("table", Box((1.2, 1.4, 0.04)), transform(t=(0.3, 0.0, -0.02)), "table"),
    Body("pipe", Cylinder(radius, centre[2]), transform(t=(centre[0], centre[1], centre[2] / 2)), "post"),
)
# the finger tips follow the rim 8 mm above it, the tool pointing down, its rotation about its own axis free
angles = np.radians(np.arange(0, 361, 40))
rim = [centre + (radius * np.cos(a), radius * np.sin(a), 0.008) for a in angles]
targets = [
    Target(
        f"rim {k}",
        transform(rot_x(np.pi), place),
        free="rz",
        by="line" if k else "transit",
        approach=0.0 if k else 0.04,
        retract=0.04 if k == len(rim) - 1 else 0.0,
        blend_radius=0.002,  # corners may be cut by 2 mm, so the arm need not stop at them
        speed=0.05,
    )
    for k, place in enumerate(rim)
]
home = np.radians([-60, -40, -80, 0, -60, 0])
plan = plan_poses(
    robot, bodies, targets, home, unit.limits(), q_end=home, unit=unit, options=PlanOptions(speed=1.0)
)
for move in plan.moves:
    print(
        f"{move.name:32s} {move.path.duration_s:5.2f} s, {1e3 * move.clearance:4.1f} mm clear of {move.closest[1]}"
    )
print(f"{plan.duration_s:.2f} s, bound {plan.lower_bound_s:.2f} s")

with Path("rim.csv").open("w", newline="") as file:
    csv.writer(file).writerows(plan.rows(0.02))
print("rows written:", len(Path("rim.csv").read_text().splitlines()))
