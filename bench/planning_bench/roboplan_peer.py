"""roboplan 0.7: its RRT-Connect, shortcutting, Cartesian lines (oink) and C++ TOPP-RA.

`step` is the joint step of its collision checks along edges: 0.05 rad is its own default, 0.01 rad the fine row.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import roboplan.cartesian_planning as cartesian
import roboplan.core as core
import roboplan.rrt as rrt
import roboplan.toppra as toppra

from arm.controller.unit import Limits
from arm.io.storage import data_file
from arm.robot.shapes import Body
from arm.se3 import Array, transform
from plan.scene import Station
from plan.trajectory.time_estimates import path_time
from planning_bench.grips import GripLine, line_poses
from planning_bench.judge import HOLDING, OPEN, TOOL_LENGTH
from planning_bench.query import Answer, PlannerFailed, Query, Timed, box_size
from planning_bench.sampling import peaks, plan_chain

DT = 0.01  # of its output, s; its default
BLEND = 0.1  # rad, of corners; checked for collision by roboplan, which else stops at each
MAX_NODES = 4000
RANGE = 0.3  # rad between nodes; its default of 3 gave paths about half as long again on these scenes
PEAK = 1.05  # of the limits, above which corners are not blended
HUB_LENGTH = 0.0762  # from the hub, the link of joint 6, to the flange, m
LINE_ERROR = 1e-3  # m off the line at most
GROUP = "arm"
_GREY = np.array([0.5, 0.5, 0.5, 1.0])


class Roboplan:
    """Two scenes, jaws open and jaws on the cube, made once; bodies are put in for every query."""

    def __init__(self, name: str, step: float, restarts: int = 1) -> None:
        self.name, self.step, self.restarts = name, step, restarts
        self._scenes: dict[bool, Any] = {}
        self._inside: dict[bool, set[str]] = {False: set(), True: set()}

    def plan(self, query: Query) -> Answer:
        """All motion of a query."""
        if not self._scenes:
            self._scenes = {False: arm_scene(query.limits, OPEN), True: arm_scene(query.limits, HOLDING)}
        return plan_chain(self, query)

    def answer(self, query: Query, planned: Answer) -> Answer:
        """The plan is the answer."""
        return planned

    def load(self, query: Query) -> None:
        """Still bodies and cubes into both scenes; what the query before left is taken out."""
        if not self._scenes:
            raise PlannerFailed("not loaded")
        for holding, scene in self._scenes.items():
            for name in self._inside[holding]:
                scene.removeGeometry(name)
            self._inside[holding] = set()
            for body in (*query.scene.bodies, *query.scene.cubes):
                self._add(holding, body, "universe", body.T_base_body)
            still = sorted(self._inside[holding])
            scene.setCollisions([(a, b) for i, a in enumerate(still) for b in still[i + 1 :]], False)
        self._bodies = {b.name: b for b in (*query.scene.bodies, *query.scene.cubes)}
        self._held: str | None = None
        self._touches: frozenset[str] = frozenset()
        self._limits = query.limits

    def _add(self, holding: bool, body: Body, parent: str, T: Array) -> None:
        scene = self._scenes[holding]
        scene.addBoxGeometry(body.name, parent, core.Box(*box_size(body)), np.asfortranarray(T), _GREY)
        self._inside[holding].add(body.name)
        if parent == "universe":
            scene.setCollisions([("base", body.name)], False)

    def hold(self, cube: str, T_tool_cube: Array, touches: frozenset[str]) -> None:
        """The cube hangs on joint 6 of the holding scene: roboplan leaves out where a fixed frame is on it."""
        scene = self._scenes[True]
        body = self._bodies[cube]
        self._touches = touches
        T = transform(t=(0.0, 0.0, HUB_LENGTH + TOOL_LENGTH)) @ T_tool_cube
        if self._held == cube:
            scene.updateGeometryPlacement(cube, "hub", np.asfortranarray(T))
            return
        scene.removeGeometry(cube)
        self._inside[True].discard(cube)
        self._add(True, body, "hub", T)
        others = self._inside[True] - {cube}
        scene.setCollisions([(cube, other) for other in sorted(others)], True)
        hand = ("gripper", "palm", "finger_l", "finger_r")
        scene.setCollisions([(cube, link) for link in hand], False)
        self._held = cube

    def set_down(self, cube: str, T_base_cube: Array) -> None:
        """The cube stands where it was let go."""
        self._scenes[False].updateGeometryPlacement(cube, "universe", np.asfortranarray(T_base_cube))
        self._bodies[cube] = self._bodies[cube].at(T_base_cube)
        if self._held == cube:
            self._scenes[True].removeGeometry(cube)
            self._inside[True].discard(cube)
            self._add(True, self._bodies[cube], "universe", T_base_cube)
            others = self._inside[True] - {cube}
            self._scenes[True].setCollisions([(cube, other) for other in sorted(others)], False)
            self._held = None

    def transit(self, q_from: Array, q_to: Array, holding: bool, seed: int) -> Timed | None:
        """Straight if free, else RRT-Connect and shortcuts; timed by TOPP-RA with blended corners."""
        scene = self._scenes[holding]
        if not core.hasCollisionsAlongPath(scene, q_from, q_to, self.step, True, True):
            return self._timed(scene, [q_from, q_to])
        names = list(scene.getJointGroupInfo(GROUP).joint_names)
        start, goal = (core.JointConfiguration(names, np.array(q)) for q in (q_from, q_to))
        if scene.hasCollisions(np.array(q_to)) or scene.hasCollisions(np.array(q_from)):
            return None
        options = rrt.RRTOptions(
            group_name=GROUP,
            max_nodes=MAX_NODES,
            max_connection_distance=RANGE,
            collision_check_step_size=self.step,
            rrt_connect=True,
        )
        shortcuts = core.PathShortcuttingOptions(
            group_name=GROUP, max_step_size=self.step, max_iters=200, seed=seed + 1
        )
        found: list[Array] = []
        for attempt in range(self.restarts + 2):
            planner = rrt.RRT(scene, options)
            planner.setRngSeed(1000 * seed + attempt + 1)
            try:
                path = planner.plan(start, goal)
            except RuntimeError:
                continue
            found.append(np.array(core.PathShortcutter(scene, shortcuts).shortcut(path).positions))
            if len(found) == self.restarts:
                break
        if not found:
            return None
        best = min(found, key=lambda waypoints: path_time(waypoints, self._limits))
        return self._timed(scene, list(best))

    def _timed(self, scene: Any, waypoints: list[Array]) -> Timed | None:
        """Blended corners if the timed motion is free at the step and within limits, else a stop at each."""
        modes = toppra.SplineFittingMode
        for mode in (modes.LinearBlend, modes.Hermite) if len(waypoints) > 2 else (modes.Hermite,):
            found = timed(scene, waypoints, mode)
            if found is not None and (mode == modes.Hermite or self._sound(scene, found)):
                return found
        return None

    def _sound(self, scene: Any, found: Timed) -> bool:
        if max(peaks(found, self._limits)) > PEAK:
            return False
        return not any(scene.hasCollisions(found.q[i]) for i in every(found.q, self.step))

    def line(self, grip: GripLine, station: Station) -> Timed | None:
        """From the offset point to the station by the Cartesian planner."""
        scene = self._scenes[False]
        poses = line_poses(station.T_base_tool[grip.yaw], 2)[::-1]
        path = core.CartesianPath(["base"], ["tool"], [[np.asfortranarray(T) for T in poses]])
        options = cartesian.CartesianPlannerOptions(
            group_name=GROUP,
            dt=DT,
            speed_mode=cartesian.CartesianSpeedMode.TimeOptimal,
            max_position_error=LINE_ERROR,
        )
        names = list(scene.getJointGroupInfo(GROUP).joint_names)
        try:
            planner = cartesian.CartesianPathPlanner(scene, options)
            return motion(planner.plan(path, core.JointConfiguration(names, np.array(grip.q_offset))))
        except RuntimeError:
            return None

    def line_free(self, line: Timed, holding: bool) -> bool:
        """Samples of the line no further apart than the step; the held cube may touch what it stands in."""
        scene = self._scenes[holding]
        may = [(self._held, name) for name in self._touches] if holding else []
        if may:
            scene.setCollisions(may, False)
        try:
            return not any(scene.hasCollisions(line.q[i]) for i in every(line.q, self.step))
        finally:
            if may:
                scene.setCollisions(may, True)


def arm_scene(limits: Limits, opening: float) -> Any:
    """The arm with jaws locked, its own limits and a tool frame."""
    root = ElementTree.fromstring(data_file("urdf/a465/a465.urdf").read_text())
    for joint in root.findall("joint"):
        name = joint.attrib["name"]
        if name in ("jaw_l", "jaw_r"):
            joint.set("type", "fixed")
            origin = joint.find("origin")
            if origin is not None:
                x, y, z = origin.attrib["xyz"].split()
                y = str(opening / 2 if name == "jaw_l" else -opening / 2)
                origin.set("xyz", f"{x} {y} {z}")
            for tag in ("axis", "limit"):
                found = joint.find(tag)
                if found is not None:
                    joint.remove(found)
        elif joint.attrib["type"] == "revolute":
            k, limit = int(name[1:]) - 1, joint.find("limit")
            if limit is not None:
                limit.set("lower", repr(float(limits.lower[k])))
                limit.set("upper", repr(float(limits.upper[k])))
                limit.set("velocity", repr(float(limits.velocity[k])))
    ElementTree.SubElement(root, "link", {"name": "tool"})
    mount = ElementTree.SubElement(root, "joint", {"name": "tool_mount", "type": "fixed"})
    ElementTree.SubElement(mount, "parent", {"link": "flange"})
    ElementTree.SubElement(mount, "child", {"link": "tool"})
    ElementTree.SubElement(mount, "origin", {"xyz": f"0 0 {TOOL_LENGTH}"})
    scene = core.Scene(
        "a465", core.loadUrdfSceneDescriptionFromXml(ElementTree.tostring(root, encoding="unicode"))
    )
    joints = [f"J{i}" for i in range(1, 7)]
    rows = [
        f"  {n}:\n    max_acceleration: [{float(a)!r}]"
        for n, a in zip(joints, limits.acceleration, strict=True)
    ]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "limits.yaml"
        file.write_text("joint_limits:\n" + "\n".join(rows) + "\n")
        scene.importJointLimitsFromConfig(core.loadJointLimitsConfig(file))
    scene.importSrdf(data_file("urdf/a465/a465.srdf").read_text())
    scene.addGroup(GROUP, joints)
    return scene


def timed(scene: Any, waypoints: list[Array], mode: Any, blend: float = BLEND) -> Timed | None:
    """roboplan's C++ TOPP-RA through way-points, or None where it finds nothing."""
    path = core.JointPath()
    path.joint_names = [f"J{i}" for i in range(1, 7)]
    path.positions = [np.array(q) for q in waypoints]
    options = toppra.TOPPRAOptions(dt=DT, mode=mode, max_blend_deviation=blend)
    try:
        return motion(toppra.PathParameterizerTOPPRA(scene, GROUP).generate(path, options))
    except RuntimeError:
        return None


def every(q: Array, step: float) -> list[int]:
    """Rows of q (m, 6) about `step` rad (Euclidean) apart along the way, with both ends."""
    ways = np.concatenate([[0.0], np.linalg.norm(np.diff(q, axis=0), axis=1).cumsum()])
    rows = np.searchsorted(ways, np.arange(0.0, ways[-1], step))
    return [*np.unique(rows).tolist(), len(q) - 1]


def motion(trajectory: Any) -> Timed:
    return Timed(np.array(trajectory.times), np.array(trajectory.positions), np.array(trajectory.velocities))
