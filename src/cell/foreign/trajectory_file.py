"""Joint trajectories of other programs: the ROS message trajectory_msgs/JointTrajectory as JSON.

Between two points joints move on straight lines, or, if the points have velocities, on the cubics with the positions
and velocities of both (as ros2_controllers' joint_trajectory_controller does).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from arm.io.node import Node, Rule
from arm.io.rules import is_number, numbers, rule_of
from arm.se3 import Array, frozen
from plan.collision.bezier import Curve

# Of RobotTrajectory, of the parts of a DisplayTrajectory, and of a FollowJointTrajectory.
WRAPPERS = ("joint_trajectory", "trajectory")
POINT = ("positions", "velocities", "accelerations", "effort", "time_from_start")
_UNITS = ("unit", "units", "angles")  # that a message has not, and that would be ignored
_DEPTH = 4  # to which a trajectory is looked for in other messages
MOST_POINTS = 100_000
LONGEST_S = 1e5
LEAST_STEP_S = 1e-6  # between two points
_SECONDS = ({"sec", "nanosec"}, {"secs", "nsecs"})  # of ROS 2 and ROS 1


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """A motion of all joints of an arm, in the arm's order.

    Attributes:
        times: of the points, (m,) s, increasing; m is at least 2.
        q: positions, (m, n) rad (m where a joint slides).
        velocity: (m, n) rad/s (m/s), or None: the joints move on straight lines.
    """

    times: Array
    q: Array
    velocity: Array | None

    @property
    def duration(self) -> float:
        """Time from the first point to the last, s."""
        return float(self.times[-1] - self.times[0])

    @cached_property
    def coefficients(self) -> Array:
        """Rows a1, a2, a3 of the cubics q_i + a1 u + a2 u^2 + a3 u^3, 0 <= u <= 1, between points: (3, m - 1, n)."""
        step = np.diff(self.q, axis=0)
        if self.velocity is None:
            return frozen(np.stack([step, np.zeros_like(step), np.zeros_like(step)]))
        lasts = np.diff(self.times)[:, None]
        begin, end = lasts * self.velocity[:-1], lasts * self.velocity[1:]
        return frozen(np.stack([begin, 3.0 * step - 2.0 * begin - end, begin + end - 2.0 * step]))

    @property
    def curve(self) -> Curve:
        """The motion as it is certified; time from the first point."""
        a1, a2, _ = self.coefficients
        start = self.q[:-1]
        control = np.stack([start, start + a1 / 3.0, start + (2.0 * a1 + a2) / 3.0, self.q[1:]], axis=1)
        return Curve(control, self.times[1:] - self.times[0])

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return positions and velocities (k, n) at times (k,) s from the first point."""
        t = np.clip(np.asarray(times) + self.times[0], self.times[0], self.times[-1])
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        lasts = np.diff(self.times)[i][:, None]
        u = (t - self.times[i])[:, None] / lasts
        a1, a2, a3 = self.coefficients[:, i]
        return self.q[i] + u * (a1 + u * (a2 + u * a3)), (a1 + u * (2.0 * a2 + u * 3.0 * a3)) / lasts


def read_trajectory(path: Path, joints: Sequence[str]) -> JointTrajectory:
    """Read a JointTrajectory; also one inside a RobotTrajectory or the goal of a FollowJointTrajectory.

    Args:
        path: JSON file.
        joints: names of the arm's joints, in its order.

    Raises:
        FileInputError: the file is no such message; joints are missing, or are not the arm's; a number is wrong; times
            do not increase; only some points have velocities; points have accelerations, between which a controller
            follows other curves.
    """
    root = _message(Node.of_json(path, "trajectory"))
    for unit in _UNITS:
        if root.get(unit, _ANY, None) not in (None, "rad"):
            rule = "is not read: positions are in rad, m where a joint slides"
            raise root[unit].error(rule, "leave it out, and convert them")
    names: list[str] = root.get("joint_names", _NAMES)
    order = _order(root, names, joints)
    points = root["points"].items()
    if not 2 <= len(points) <= MOST_POINTS:
        raise root.error_at("points", f"has {len(points)} points; must have 2 to {MOST_POINTS}")
    for point in points:
        _require_known(point)
    times = np.array([_time(point["time_from_start"]) for point in points])
    late = np.flatnonzero(np.diff(times) < LEAST_STEP_S)
    if len(late):
        before, after = times[late[0]], times[late[0] + 1]
        rule = f"is {after:.9g} s, not after {before:.9g} s of the point before; times must increase by 1 us or more"
        raise points[int(late[0]) + 1].error_at("time_from_start", rule, _late(points, int(late[0]), times))
    row = numbers(len(names), "rad (m where a joint slides)", -1e4, 1e4)
    rate = numbers(len(names), "rad/s (m/s)", -1e4, 1e4)
    q = np.stack([point.get("positions", row) for point in points])[:, order]
    with_rates = [point for point in points if _has(point, "velocities")]
    for point in points:
        if _has(point, "accelerations") and np.any(point.get("accelerations", rate)):
            rule = "are not certified: between points with accelerations a controller follows quintics; leave them out"
            raise point.error_at("accelerations", rule)
        if with_rates and not _has(point, "velocities"):
            raise point.error_at("velocities", "is missing; all points must have velocities, or none")
    velocity = np.stack([point.get("velocities", rate) for point in points])[:, order] if with_rates else None
    return JointTrajectory(frozen(times), frozen(q), None if velocity is None else frozen(velocity))


def _late(points: Sequence[Node], k: int, times: Array) -> str:
    """Say why point k + 1 may not be later than point k; "" if nothing is known."""
    same = [point.value.get("positions") for point in points[k : k + 2]]
    if times[k + 1] == times[k] and same[0] == same[1]:
        return "the point is there twice: leave out one"
    if times[k + 1] > times[k] and isinstance(points[k + 1].value["time_from_start"], dict):
        return "nanosec is in ns"
    return (
        "is it the time from the point before? It counts from the start"
        if times[k + 1] >= LEAST_STEP_S
        else ""
    )


def _message(node: Node) -> Node:
    """Return the JointTrajectory in a file."""
    whole = node
    for _ in WRAPPERS:
        inside = [] if "points" in node else [name for name in WRAPPERS if name in node]
        if len(inside) > 1:
            raise node.error_at(inside[1], f"is a second trajectory beside {inside[0]}; must be one")
        more = node.value.get("multi_dof_joint_trajectory") if isinstance(node.value, dict) else None
        if more.get("points") if isinstance(more, dict) else more:
            raise node.error_at(
                "multi_dof_joint_trajectory", "moves what this arm has not; must have no points"
            )
        node = node[inside[0]] if inside else node
        if isinstance(node.value, list):
            count, first = len(node.value), node.value[:1]
            if node is whole and not any(True for one in first for _ in _trajectories(one)):
                raise node.error(f"is a list of {count}, and {_RULE}")
            what = (
                f"is a list of {count}, as in a moveit_msgs/DisplayTrajectory; must be one trajectory"
                if node is not whole
                else f"is a list of {count} trajectories; must be one"
            )
            raise node.error(what, f"give a file with {node.key}[0] alone" if first else "")
    if "points" not in node:
        raise whole.error(_RULE, _instead(whole.value))
    return node


def _trajectories(value: Any, depth: int = _DEPTH) -> Iterator[str]:
    """Yield where in a value there are points of a trajectory, as keys such as ``plan.joint_trajectory``."""
    if isinstance(value, dict) and isinstance(value.get("points"), list):
        yield ""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, one in inner if depth else ():
        here = f"[{name}]" if isinstance(name, int) else f".{name}"
        yield from (f"{here}{found}" for found in _trajectories(one, depth - 1))


def _instead(value: Any) -> str:
    """Say what a file has instead of a trajectory; "" if nothing is known."""
    if found := [one.removeprefix(".") for one in _trajectories(value)]:
        return f"there is one in {found[0]}: give a file with that alone"
    if not isinstance(value, dict):
        return ""
    if {"name", "position"} <= value.keys():
        return "it is like a sensor_msgs/JointState, which is one configuration and no motion"
    return f"the file has {', '.join(list(value)[:5])}" if value else "it is empty"


def _require_known(point: Node) -> None:
    """Refuse a key that a point of a trajectory has not: what it says would be ignored."""
    for name in point.value if isinstance(point.value, dict) else ():
        if name not in POINT:
            near = [one for one in POINT if one.startswith(name)] or difflib.get_close_matches(
                name, POINT, n=1
            )
            help = f"did you mean {near[0]}?" if near else f"known: {', '.join(POINT)}"
            raise point[name].error("is not a key of a JointTrajectoryPoint", help)


def _order(root: Node, names: list[str], joints: Sequence[str]) -> list[int]:
    """Return where each of the arm's joints is in the file."""
    for name in names:
        if name not in joints or names.count(name) > 1:
            why = "names it twice" if names.count(name) > 1 else "is no joint of the arm"
            raise root.error_at("joint_names", f"{name!r} {why}; must be {', '.join(joints)}, in any order")
    missing = [name for name in joints if name not in names]
    if missing:
        raise root.error_at("joint_names", f"lacks {', '.join(missing)}; must have all joints of the arm")
    return [names.index(name) for name in joints]


def _has(point: Node, name: str) -> bool:
    """Whether a point has these numbers: an empty list says that it has not."""
    return name in point and point.value[name] != []


def _time(node: Node) -> float:
    """Return a duration, s."""
    value = node.value
    if isinstance(value, dict):
        whole = next((names for names in _SECONDS if set(value) == names), set())
        parts = [value[name] for name in sorted(whole, key=len)]
        fits = len(parts) == 2 and all(is_number(part) and 0.0 <= part <= 1e9 * LONGEST_S for part in parts)
        if fits and parts[1] >= 1e9:
            raise node.error("must have less than 1000000000 ns beside its seconds")
        if fits and parts[1] % 1:
            raise node.error("must have a whole number of ns beside its seconds")
        value = parts[0] + 1e-9 * parts[1] if fits else None
    if not is_number(value) or not 0.0 <= value <= LONGEST_S:
        rule = f"must be a time from 0 to {LONGEST_S:g} s: a number, or sec and nanosec"
        raise node.error(rule, _meant_time(node.value))
    return float(value)


def _meant_time(value: Any) -> str:
    """Say what a value may be that is no time from the start; "" if nothing is known."""
    if isinstance(value, dict):
        names = next((names for names in _SECONDS if set(value) & names), set())
        if lacking := sorted(names - value.keys(), key=len):
            return f"it lacks {lacking[0]}"
        if any(isinstance(part, str) for part in value.values()):
            return "its numbers stand in quotation marks"
        value = value.get("sec", value.get("secs"))
    if isinstance(value, str):
        return "numbers stand without quotation marks, and without a unit"
    if not is_number(value) or value <= LONGEST_S:
        return ""
    if _CLOCK[0] < value < _CLOCK[1]:
        return "is it the time of day, in s since 1970? It counts from the start of the trajectory"
    return "is it in ns?" if value >= 1e7 else "is it in ms?"


def _is_names(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(name, str) for name in value)


_ANY: Rule[Any] = rule_of("any value", lambda value: True, lambda value: value)
_RULE = "must be a trajectory_msgs/JointTrajectory with joint_names and points"
_CLOCK = (1.4e9, 2.2e9)  # s since 1970, of the years in which a trajectory may be made
_NAMES: Rule[list[str]] = rule_of("names of joints", _is_names, list)
