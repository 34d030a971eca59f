"""The robot: URDF model, shapes of bodies, tool, and link errors."""

from arm.former import former_names

former_names(__name__, "arm.robot.model", "LinkBody", "Robot", "load_robot", "by_link", "load_a465")
