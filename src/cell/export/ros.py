"""ROS 2 messages as JSON values, with the field names of their definitions: JointTrajectory and JointState.

Source: trajectory_msgs/msg/JointTrajectory, JointTrajectoryPoint, sensor_msgs/msg/JointState, builtin_interfaces.
Positions in rad, velocities in rad/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from arm.se3 import Array

JOINTS = ("J1", "J2", "J3", "J4", "J5", "J6")  # of the A465's URDF
NS = 1_000_000_000
Message = tuple[int, str, dict[str, Any]]
"""Time in ns, topic of `cell.export.mcap.TOPICS`, and value."""
DIGITS = 9  # decimals of an angle in rad, much finer than a count


def nanoseconds(time_s: float) -> int:
    """Return a time in ns, rounded to a microsecond, the resolution of a log."""
    return round(time_s * 1e6) * 1000


def stamp(time_s: float) -> dict[str, int]:
    """builtin_interfaces/Time or Duration: whole seconds, and the remaining nanoseconds."""
    sec, nanosec = divmod(nanoseconds(time_s), NS)
    return {"sec": sec, "nanosec": nanosec}


def header(time_s: float) -> dict[str, Any]:
    """std_msgs/Header."""
    return {"stamp": stamp(time_s), "frame_id": ""}


def joint_trajectory(
    time_s: Array, q: Array, velocity: Array | None, start_s: float, names: Sequence[str] = JOINTS
) -> dict[str, Any]:
    """trajectory_msgs/JointTrajectory that begins at `start_s`.

    Args:
        time_s: (m,), strictly increasing, none before `start_s`.
        q: (m, n) rad (m for sliding joints).
        velocity: (m, n) rad/s (m/s), or None to leave it out.
        names: of the n joints.
    """
    return {
        "header": header(start_s),
        "joint_names": list(names),
        "points": [
            {
                "positions": _numbers(q[i]),
                "velocities": [] if velocity is None else _numbers(velocity[i]),
                "accelerations": [],
                "effort": [],
                "time_from_start": stamp(float(time_s[i]) - start_s),
            }
            for i in range(len(time_s))
        ],
    }


def joint_state(time_s: float, q: Array, velocity: Array, names: Sequence[str] = JOINTS) -> dict[str, Any]:
    """sensor_msgs/JointState."""
    return {
        "header": header(time_s),
        "name": list(names),
        "position": _numbers(q),
        "velocity": _numbers(velocity),
        "effort": [],
    }


def _numbers(values: Array) -> list[float]:
    return [round(float(v), DIGITS) + 0.0 for v in values]


def message_schema(title: str, **properties: Any) -> dict[str, Any]:
    """Return the JSON schema of a message with these fields."""
    return {"title": title, **_object(**properties)}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


_STAMP = _object(sec={"type": "integer"}, nanosec={"type": "integer"})
_HEADER = _object(stamp=_STAMP, frame_id={"type": "string"})
_NAMES = {"type": "array", "items": {"type": "string"}}
_NUMBERS = {"type": "array", "items": {"type": "number"}}
_POINT = _object(
    positions=_NUMBERS, velocities=_NUMBERS, accelerations=_NUMBERS, effort=_NUMBERS, time_from_start=_STAMP
)
JOINT_STATE_SCHEMA = message_schema(
    "sensor_msgs/msg/JointState",
    header=_HEADER,
    name=_NAMES,
    position=_NUMBERS,
    velocity=_NUMBERS,
    effort=_NUMBERS,
)
JOINT_TRAJECTORY_SCHEMA = message_schema(
    "trajectory_msgs/msg/JointTrajectory",
    header=_HEADER,
    joint_names=_NAMES,
    points={"type": "array", "items": _POINT},
)
