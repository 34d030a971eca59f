"""Plan around a rock for an invented seven-axis arm with its own tool: no controller, no shipped files."""

from pathlib import Path

import numpy as np

from a465 import (
    Body,
    Box,
    Cylinder,
    PlanOptions,
    Target,
    convex,
    load_robot,
    plan_poses,
    rot_x,
    transform,
    urdf_limits,
    with_disabled_collisions,
    with_tool,
)

# axes alternate between z and y, as in many seven-axis arms; lengths in m
LENGTHS, AXES = (0.32, 0.0, 0.38, 0.0, 0.36, 0.0, 0.10), "zyzyzyz"
links = "".join(
    f"""<link name="link{k}"><collision><origin xyz="0 0 {length / 2}"/>
        <geometry><cylinder radius="0.04" length="{length + 0.06}"/></geometry></collision></link>"""
    for k, length in enumerate((*LENGTHS, 0.04))
)
joints = "".join(
    f"""<joint name="j{k + 1}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/>
        <origin xyz="0 0 {length}"/><axis xyz="{int(axis == "x")} {int(axis == "y")} {int(axis == "z")}"/>
        <limit lower="-2.6" upper="2.6" velocity="1.5" effort="1"/></joint>"""
    for k, (length, axis) in enumerate(zip(LENGTHS, AXES, strict=True))
)
Path("arm.urdf").write_text(f'<robot name="seven">{links}{joints}</robot>')

# there is no SRDF: disable collisions between adjacent links, also across a link of zero length
robot = load_robot(Path("arm.urdf"), "link7", np.eye(4))
robot = with_disabled_collisions(robot, [(f"link{k}", f"link{k + 2}") for k in (0, 2, 4)], neighbours=True)
nozzle = Body("nozzle", Cylinder(0.012, 0.12), transform(t=(0.0, 0.0, 0.13)), "tool")
robot = with_tool(robot, transform(t=(0.0, 0.0, 0.20)), [nozzle])

corners = np.random.default_rng(3).normal(size=(40, 3)) * (0.07, 0.07, 0.10)
bodies = (
    Body("floor", Box((2.0, 2.0, 0.04)), transform(t=(0.0, 0.0, -0.06)), "table"),
    Body("rock", convex(corners), transform(t=(0.5, 0.0, 0.1)), "rock"),
)
down = rot_x(np.pi)
targets = [
    Target("left", transform(down, (0.5, -0.3, 0.15)), free="rz", approach=0.05, retract=0.05),
    Target("right", transform(down, (0.5, 0.3, 0.15)), free="rz", approach=0.05, dwell_s=0.2),
]
plan = plan_poses(
    robot,
    bodies,
    targets,
    q_start=[0.0, 0.3, 0.0, 1.4, 0.0, 1.2, 0.0],
    limits=urdf_limits(robot, acceleration=4.0),
    options=PlanOptions(speed=1.0),
)
for move in plan.moves:
    print(f"{move.name:22s} {move.path.duration_s:5.2f} s, at least {1e3 * move.clearance:5.1f} mm clear")
print(f"{plan.duration_s:.2f} s; through these solutions nothing is faster than {plan.lower_bound_s:.2f} s")
