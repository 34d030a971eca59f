"""The robot: URDF model, shapes of bodies, tool, and link errors."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(
        __name__, "arm.robot.model", "LinkBody", "Robot", "load_robot", "by_link", "load_a465"
    )
