"""The judge: MuJoCo's own kinematics and collision along the timed motion, every millisecond.

Nothing of any planner is used. The arm comes from the URDF through MuJoCo's parser. A cube is fixed to the hand where
the hand is when the jaws close, and stays where it is when they open. What is a line is seen from the motion itself:
the part of it within `OFFSET` of a station, counted from the gripper's action.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from arm.io.storage import data_file
from arm.robot.shapes import Body, Box, Cylinder, Sphere
from arm.se3 import Array, angle_between, frozen, inverse, transform
from plan.scene import Station, Transfer
from planning_bench.query import OFFSET, Answer, Query, Stretch

STEP = 1e-3  # s
TOLERANCE = 1e-6  # m that counts as no penetration
POCKET_PLAY = 2.5e-3  # a cube whose centre is this near its hole's axis is in its own pocket, m
POCKET_TILT = np.radians(3.0)
FAR = 0.06  # clearance above this is not told apart, m
CLEARANCE_EVERY = 20  # samples
TOOL_LENGTH = 0.134112
OPEN, HOLDING = 0.06, 0.04  # of the jaws, m
_LINE_END = 2e-4  # m before OFFSET where a line is over


@dataclass(frozen=True)
class Verdict:
    """What was found about one answer.

    Attributes:
        deepest: m, 0 if clean.
        hits: pairs that penetrate and the stretch in which they do, deepest first.
        duration: of all motion, s.
        clearance: least distance of transits as sampled, m, at most `FAR`.
        grasp: largest distance of the tool from the wanted pose where the gripper acts, m; `turned` rad.
        line: largest distance of the tool from the lines at the stations, m.
        velocity, acceleration: largest share of the limits.
        join: largest velocity step at a join over the controller's rule, or nan.
        path: joint way, rad (Euclidean).
    """

    deepest: float
    hits: tuple[tuple[str, int, float], ...]
    duration: float
    clearance: float
    grasp: float
    turned: float
    line: float
    velocity: float
    acceleration: float
    join: float
    path: float

    @property
    def clean(self) -> bool:
        return not self.hits


class Stage:
    """MuJoCo's cell for one stretch: bodies and cubes that stand, jaws where they are, and a cube in the hand.

    Args:
        bodies: that stand, cubes included.
        apart: pairs of bodies that are not checked.
        held: a cube with its pose in the flange frame, or None.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        apart: frozenset[frozenset[str]],
        held: tuple[Body, Array] | None = None,
    ) -> None:
        root = ElementTree.fromstring(data_file("urdf/a465/a465.urdf").read_text())
        compiler = {"fusestatic": "false", "discardvisual": "false", "balanceinertia": "true"}
        ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", compiler)
        for link in root.findall("link"):
            for collision in link.findall("collision"):
                collision.set("name", link.attrib["name"])
            inertial = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(inertial, "mass", {"value": "1"})
            axes = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            inertia = {k: "0.01" if k[1] == k[2] else "0" for k in axes}
            ElementTree.SubElement(inertial, "inertia", inertia)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        for body in bodies:
            spec.worldbody.add_geom(name=body.name, **_geom(body, body.T_base_body))
        if held is not None:
            spec.body("flange").add_geom(name=held[0].name, **_geom(held[0], held[1]))
        links = {link.attrib["name"] for link in root.findall("link")} - {"base"}
        for pair in sorted(map(sorted, apart)):
            if links >= set(pair):
                spec.add_exclude(bodyname1=pair[0], bodyname2=pair[1])
        if held is not None:
            for name in ("hub", "gripper", "palm", "finger_l", "finger_r"):
                spec.add_exclude(bodyname1="flange", bodyname2=name)
        self.model = spec.compile()
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
        self.data = mujoco.MjData(self.model)
        self.names = [self.model.geom(i).name for i in range(self.model.ngeom)]
        self.held = None if held is None else held[0].name
        self._joints = np.array([self.model.joint(f"J{i}").qposadr[0] for i in range(1, 7)])
        for name in ("jaw_l", "jaw_r"):
            opening = OPEN if held is None else HOLDING
            self.data.qpos[self.model.joint(name).qposadr[0]] = opening / 2
        self._flange = self.model.body("flange").id
        self._apart = apart
        self.pairs = self._far_pairs(links, {b.name for b in bodies})

    def _far_pairs(self, links: set[str], standing: set[str]) -> list[tuple[int, int]]:
        hand = {"hub", "gripper", "palm", "finger_l", "finger_r"}
        index = {n: i for i, n in enumerate(self.names)}
        moving = [n for n in self.names if n in links or n == self.held]
        pairs = []
        for i, a in enumerate(moving):
            others = [*sorted(standing), "base", *moving[i + 1 :]]
            for b in others:
                if frozenset((a, b)) in self._apart or (self.held in (a, b) and {a, b} & hand):
                    continue
                pairs.append((index[a], index[b]))
        return pairs

    def place(self, q: Array) -> Array:
        """Put the arm at q (6,); T_base_flange."""
        self.data.qpos[self._joints] = q
        mujoco.mj_kinematics(self.model, self.data)
        return self.T_base_flange()

    def T_base_flange(self) -> Array:
        T = np.eye(4)
        T[:3, :3] = self.data.xmat[self._flange].reshape(3, 3)
        T[:3, 3] = self.data.xpos[self._flange]
        return T

    def contacts(self) -> list[tuple[str, str, float]]:
        """Pairs inside each other where the arm is, and how deep, m."""
        mujoco.mj_collision(self.model, self.data)
        found = []
        contact = self.data.contact
        for i in range(self.data.ncon):
            depth = -float(contact.dist[i])
            if depth > TOLERANCE:
                a, b = (self.names[int(g)] for g in contact.geom[i])
                if frozenset((a, b)) not in self._apart:
                    found.append((a, b, depth))
        return found

    def clearance(self) -> float:
        """Least distance of all pairs where the arm is, m."""
        least = FAR
        for a, b in self.pairs:
            least = min(least, mujoco.mj_geomDistance(self.model, self.data, a, b, least, None))
        return least


def judge(query: Query, answer: Answer) -> Verdict:
    """Replay an answer and measure it.

    Raises:
        ValueError: the answer has not two stretches per transfer and one more, or they do not meet.
    """
    if len(answer.stretches) != 2 * len(query.transfers) + 1:
        raise ValueError(f"{len(answer.stretches)} stretches for {len(query.transfers)} transfers")
    query = _as_done(query, answer)
    apart = query.scene.robot_open.disabled_collisions
    cubes = {c.name: c for c in query.scene.cubes}
    held: tuple[Body, Array] | None = None
    hits: dict[tuple[str, int], float] = {}
    measured: list[_Measured] = []
    q_last = query.q_start
    for index, stretch in enumerate(answer.stretches):
        standing = [*query.scene.bodies, *(c for n, c in cubes.items() if held is None or n != held[0].name)]
        stage = Stage(standing, apart, held)
        transfer = query.transfers[min(index // 2, len(query.transfers) - 1)]
        pockets = query.holes[min(index // 2, len(query.holes) - 1)]
        samples = [part.at(_grid(part.duration)) for part in stretch.parts]
        for part in samples:
            if np.abs(part[0] - q_last).max() > 2e-3:
                raise ValueError(f"stretch {index} begins {np.abs(part[0] - q_last).max():.4f} rad off")
            q_last = part[-1]
        q = np.concatenate(samples)
        flange = _replay(stage, q, index, held, transfer, pockets, hits)
        tool = flange @ transform(t=(0.0, 0.0, TOOL_LENGTH))
        stations = (
            query.transfers[(index - 1) // 2] if index else None,
            query.transfers[index // 2] if index < 2 * len(query.transfers) else None,
        )
        begin = None if stations[0] is None else (stations[0].place if index % 2 == 0 else stations[0].pick)
        end = None if stations[1] is None else (stations[1].pick if index % 2 == 0 else stations[1].place)
        measured.append(_measure(stage, q, tool, samples, begin, end, query))
        if index % 2 == 0 and index < 2 * len(query.transfers):
            cube = cubes[transfer.cube]
            held = (cube, frozen(inverse(flange[-1]) @ cube.T_base_body))
        elif held is not None:
            cubes[held[0].name] = held[0].at(flange[-1] @ held[1])
            held = None
    if np.abs(q_last - query.q_start).max() > 2e-3:
        raise ValueError("does not end at the start")
    return Verdict(
        deepest=max(hits.values(), default=0.0),
        hits=tuple((n, i, d) for (n, i), d in sorted(hits.items(), key=lambda kv: -kv[1])),
        duration=sum(s.duration for s in answer.stretches),
        clearance=min(m.clearance for m in measured),
        grasp=max(m.grasp for m in measured),
        turned=max(m.turned for m in measured),
        line=max(m.line for m in measured),
        velocity=answer.peaks[0] if answer.peaks else max(m.velocity for m in measured),
        acceleration=answer.peaks[1] if answer.peaks else max(m.acceleration for m in measured),
        join=float("nan") if answer.joins is None else answer.joins,
        path=sum(m.path for m in measured),
    )


def _as_done(query: Query, answer: Answer) -> Query:
    """The query with cubes and places in the order of the answer; every cube and every place once."""
    if answer.order is None:
        return query
    asked = range(len(query.transfers))
    if sorted(i for i, _ in answer.order) != [*asked] or sorted(j for _, j in answer.order) != [*asked]:
        raise ValueError(f"cubes and places {answer.order} are not each of those asked for, once")
    return replace(
        query,
        transfers=tuple(replace(query.transfers[i], place=query.transfers[j].place) for i, j in answer.order),
        holes=tuple((query.holes[i][0], query.holes[j][1]) for i, j in answer.order),
    )


@dataclass(frozen=True)
class _Measured:
    clearance: float
    grasp: float
    turned: float
    line: float
    velocity: float
    acceleration: float
    path: float


def _grid(duration: float) -> Array:
    return np.append(np.arange(0.0, duration, STEP), duration)


def _replay(
    stage: Stage,
    q: Array,
    index: int,
    held: tuple[Body, Array] | None,
    transfer: Transfer,
    pockets: tuple[Array, Array],
    hits: dict[tuple[str, int], float],
) -> Array:
    """Every sample through MuJoCo; adds to `hits`, returns T_base_flange (m, 4, 4)."""
    own = {
        name: T for T, s in zip(pockets, (transfer.pick, transfer.place), strict=True) for name in s.touches
    }
    flange = np.empty((len(q), 4, 4))
    for row, configuration in enumerate(q):
        flange[row] = stage.place(configuration)
        for a, b, depth in stage.contacts():
            if held is not None and held[0].name in (a, b):
                other = b if a == held[0].name else a
                if other in own and _in_pocket(flange[row] @ held[1], own[other]):
                    continue
            pair = "/".join(sorted((a, b)))
            hits[pair, index] = max(hits.get((pair, index), 0.0), depth)
    return flange


def _in_pocket(T_base_cube: Array, T_base_hole: Array) -> bool:
    T = inverse(T_base_hole) @ T_base_cube
    tilt = np.arccos(np.clip(np.abs(T[2, :3]).max(), -1.0, 1.0))
    return bool(np.hypot(T[0, 3], T[1, 3]) <= POCKET_PLAY and tilt <= POCKET_TILT)


def _measure(
    stage: Stage,
    q: Array,
    tool: Array,
    samples: list[Array],
    begin: Station | None,
    end: Station | None,
    query: Query,
) -> _Measured:
    first, last, line, grasp, turned = 0, len(q), 0.0, 0.0, 0.0
    if begin is not None:
        found = _line(tool, begin)
        first, line, grasp, turned = found
    if end is not None:
        count, off, miss, turn = _line(tool[::-1], end)
        last, line, grasp, turned = len(q) - count, max(line, off), max(grasp, miss), max(turned, turn)
    clearance = FAR
    for row in range(first, last, CLEARANCE_EVERY):
        stage.place(q[row])
        clearance = min(clearance, stage.clearance())
    velocity = acceleration = 0.0
    for part in samples:
        v = np.diff(part[:-1], axis=0) / STEP
        if len(v) > 1:
            velocity = max(velocity, float((np.abs(v) / query.limits.velocity).max()))
            a = np.diff(v, axis=0) / STEP
            acceleration = max(acceleration, float((np.abs(a) / query.limits.acceleration).max()))
    path = float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
    return _Measured(clearance, grasp, turned, line, velocity, acceleration, path)


def _line(tool: Array, station: Station) -> tuple[int, float, float, float]:
    """How many samples the line at the beginning has, its deviation, and how far and turned the first sample is off."""
    misses = [
        (float(np.linalg.norm(T[:3, 3] - tool[0, :3, 3])) + angle_between(T[:3, :3], tool[0, :3, :3]), T)
        for T in station.T_base_tool
    ]
    T = min(misses, key=lambda m: m[0])[1]
    relative = inverse(T) @ tool
    away = -relative[:, 2, 3]
    past = np.flatnonzero(away >= OFFSET - _LINE_END)
    count = int(past[0]) + 1 if len(past) else len(tool)
    off = float(np.hypot(relative[:count, 0, 3], relative[:count, 1, 3]).max())
    grasp = float(np.linalg.norm(relative[0, :3, 3]))
    return count, off, grasp, float(angle_between(T[:3, :3], tool[0, :3, :3]))


def _geom(body: Body, pose: Array) -> dict[str, Any]:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(pose[:3, :3]).ravel())
    match body.shape:
        case Box(size):
            shape: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [s / 2 for s in size]}
        case Cylinder(radius, length):
            shape = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": [radius, length / 2, 0]}
        case Sphere(radius):
            shape = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [radius, 0, 0]}
        case other:
            raise ValueError(f"the judge has no shape for {type(other).__name__}")
    return {**shape, "pos": np.array(pose[:3, 3]), "quat": quat}


@dataclass(frozen=True)
class Control:
    """A motion that must be caught: fingers driven 5 mm into a plate, and how deep it was found to be, m."""

    depth: float

    @property
    def ok(self) -> bool:
        return abs(self.depth - 5e-3) < 1e-4


def control(query: Query, q_down: Array) -> Control:
    """Drive the open fingers down at the place (its hole is free), `q_down` (m, 6) ending 5 mm inside the plate."""
    stage = Stage([*query.scene.bodies, *query.scene.cubes], query.scene.robot_open.disabled_collisions)
    plate = next(iter(query.transfers[0].place.touches))
    deepest = 0.0
    for q in q_down:
        stage.place(q)
        for a, b, depth in stage.contacts():
            if plate in (a, b) and {a, b} & {"finger_l", "finger_r"}:
                deepest = max(deepest, depth)
    return Control(deepest)


__all__ = ["Control", "Stage", "Stretch", "Verdict", "control", "judge"]
