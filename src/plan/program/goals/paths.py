"""Paths of a program: the moves along curves of the tool (`plan.curve`)."""

from __future__ import annotations

import numpy as np

from arm.se3 import Array
from plan.cartesian.line import JointPath
from plan.curve.graph import Chain
from plan.curve.planner import CurvePlanner
from plan.kinematics.closed_form import has_closed_form
from plan.kinematics.numeric_ik import Solutions
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.linear_move import LinearMove
from plan.program.goals.target import Target
from plan.program.setting import Setting

_CANDIDATES = 4  # chains along a path, of different branches
_NO_CAP = 100.0  # m/s, tool speed that is no limit


class PathMoves:
    """The moves along the paths of a program, each planned at its first use.

    Args:
        setting: arm, limits, and options of lines.
        worlds: worlds and goals of the program.
    """

    def __init__(self, setting: Setting, worlds: AttachmentWorlds) -> None:
        self.setting, self.worlds = setting, worlds
        self._planners: dict[int, CurvePlanner] = {}
        self._chains: dict[int, list[Chain]] = {}
        self._moves: dict[tuple[int, bytes], LinearMove] = {}

    def solutions(self, index: int) -> Solutions:
        """Return where the tool may begin the path of a target, the fastest path first.

        Raises:
            InputError: the arm has no closed-form inverse kinematics.
            ImpossibleError: there is no clear path, or its start is not threaded although the path is.
        """
        chains = self._chains_of(index)
        return Solutions(
            np.stack([chain.q[0] for chain in chains]),
            np.zeros(len(chains), dtype=np.intp),
            tuple(chain.branch for chain in chains),
            np.zeros(len(chains), dtype=bool),
        )

    def move(self, index: int, q: Array) -> LinearMove:
        """Return the certified move along the path of a target from q (n,): a solution of `solutions`, or where the
        move before it has ended.

        Raises:
            ImpossibleError: there is no clear path from there, or it cannot be smoothed and certified.
        """
        key = index, q.tobytes()
        if key not in self._moves:
            target, planner = self.worlds.targets[index], self._planner(index)
            known = [chain for chain in self._chains.get(index, ()) if np.array_equal(chain.q[0], q)]
            path = (
                planner.followed(known[0]) if known else planner.followed(planner.chains(1, q)[0], fixed=True)
            )
            self._moves[key] = LinearMove(
                target.curve, path, self._rate(target, path), "xyz", role="line", target=index
            )
        return self._moves[key]

    def _rate(self, target: Target, path: JointPath) -> float:
        """Return the largest rate along a path, m/s: with it the tool is nowhere faster than its target allows.

        Where positions are free, the tool's way is longer than the path.
        """
        if target.speed is None:
            return _NO_CAP
        places = np.linspace(0.0, path.s[-1], 4 * len(path.s))
        tools = product_of_exponentials(self.setting.robot).tool_poses(path.spline(places))
        ways = np.sqrt((np.diff(tools[:, :3, 3], axis=0) ** 2).sum(axis=1))
        return target.speed / max(1.0, round(float((ways / np.diff(places)).max()), 4))

    def _chains_of(self, index: int) -> list[Chain]:
        if index not in self._chains:
            chains, target = self._planner(index).chains(_CANDIDATES), self.worlds.targets[index]
            if target.threaded is not None:
                thread = self.setting.scene.thread(target.threaded)
                for chain in chains:
                    thread.require_threaded(self.setting.robot, chain.q[0], target.name)
            self._chains[index] = chains
        return self._chains[index]

    def _planner(self, index: int) -> CurvePlanner:
        target, setting = self.worlds.targets[index], self.setting
        if index not in self._planners:
            if not has_closed_form(setting.robot):
                raise target.error("by", target.by, "needs an arm with closed-form inverse kinematics")
            world = self.worlds.on_lines(self.worlds.nominal_state(index), target)
            clearance = target.clearance_on_lines(setting.options)
            widened = frozenset(target.clearance_of) if setting.options.aim == "clearance" else None
            self._planners[index] = CurvePlanner(
                target.name, setting.robot, target.curve, world, clearance, setting.planned, widened
            )
        return self._planners[index]
