"""A run that takes stock of cubes: were they gripped, are they seated, and where are they instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

from arm.errors import ExecutionStopped
from arm.numerics.products import norm
from arm.plan_file import Move, Step
from arm.se3 import Array
from cell.config.cell import Cell
from cell.cubes.confirm_placed import NOT_CONFIRMED, Release, Unconfirmed
from cell.cubes.held_back import HeldBack
from cell.program.planning import program_scene
from cell.program.program_file import ProgramTask
from cell.report.cubes import CubeRow
from cell.scene.build import T_base_cube_on_table, cube_name, unseen_scene
from cell.scene.displaced import BESIDE
from cell.scene.options import options_of
from cell.task.cube_cycles import CubeCycle
from cell.task.open_run import TO_START, OpenRun
from cell.task.planning import Rest, plan_motion
from plan.program.recovery import plan_retreat
from plan.scene import Scene
from vision.observation import Observation


class CheckedRun(OpenRun):
    """A run that knows where its cubes are. Constructed like `OpenRun`."""

    def rest(self, observation: Observation, q_from: Array) -> Rest:
        """What is left of the task, with the arm at rest at `q_from` (6,) rad."""
        return Rest(
            self.task,
            observation,
            q_from,
            self.speed,
            self.done,
            self.on_table,
            self.given_up,
            self.recovery.cubes,
        )

    def go_to_start(self, observation: Observation | None) -> None:
        """Go to q_start around all known boards and cubes or, without an observation, around the zone for boards."""
        cell, q = self.task.cell, self.q_now()
        if isinstance(self.task, ProgramTask):
            scene = self._scene_of_program(self.task, observation)
        else:
            scene = unseen_scene(cell) if observation is None else self.rest(observation, q).scene
        plan = plan_motion(self.task, scene, q, cell.q_start, self.speed)
        if plan is not None:
            self.keep(plan, TO_START)
            self.execute(plan.steps)

    def _scene_of_program(self, task: ProgramTask, observation: Observation | None) -> Scene:
        """What surrounds the arm: with the workpiece, if it is known where that is."""
        if observation is not None:
            return program_scene(task, observation)
        unseen = unseen_scene(task.cell)
        if task.board is not None:
            return unseen
        known = program_scene(task, Observation())
        return replace(known, bodies=(*known.bodies, task.cell.zone))

    def add_release(
        self,
        steps: Sequence[Step],
        transfer: dict[str, str],
        row: CubeRow,
        observation: Observation,
        held: HeldBack | None = None,
    ) -> None:
        """Keep what the next look needs to judge a released cube; `held`: the arm at rest there."""
        cell, cube, target = self.task.cell, transfer["cube"], transfer["to"]
        last = next(step for step in reversed(steps) if isinstance(step, Move))
        self._released.append(
            Release(
                row,
                transfer["from"],
                target,
                observation,
                cell.robot_holding().T_base_tool(cell.unit.positions(last.path.end)),
                self.widths.get(cube) or self.recovery.widths.get(cube),
                self.recovery.empty_look(target),
                disturbed=self.recovery.tried[cube] > 0,
                held_back=held,
            )
        )

    def missed(
        self, cycle: CubeCycle, transfer: dict[str, str], row: CubeRow, observation: Observation, why: str
    ) -> Observation:
        """Recover from jaws that hold no cube: open them on the spot, retract, go to q_start, look."""
        self.tell(f"cube of {row.source} is not gripped: {why}")
        row.add_fault("not gripped", why)
        if self.connection.mars.gripper(0.0).stalled:
            raise ExecutionStopped(
                f"the jaws missed the cube of {row.source} and do not open: something blocks them; the arm is at the "
                "hole",
                index=0,
            )
        self.back_out(self.task.cell.unit.positions(cycle.approach.path.end), cycle.approach, observation)
        self.recovery.keep_width(observation, transfer["cube"], transfer["from"])
        before, after = observation.state(row.source), self.look("after a missed cube")
        words = self.recovery.after_miss(after, transfer["cube"], transfer["from"])
        if words is not None:
            self.tell(words)
            row.remarks.append(words)
            row.at = self.recovery.where(transfer["cube"], transfer["from"])
            seated_elsewhere = not row.at.startswith(BESIDE) and row.at != row.source
            if seated_elsewhere:  # the jaws pushed it into the place of its last release
                self._set_done(transfer["cube"], row.at)
                row.placed = row.at == row.target
        elif (why_not := self.recovery.not_located.get(transfer["cube"])) or (
            before == "cube" and after.state(row.source) == "empty"
        ):
            row.faults.append("not located")
            self._stop(
                f"the cube of {row.source} was not gripped, and {transfer['from']} does not show it; its position is "
                f"unknown{f' (not located {why_not})' if why_not else ''}: remove it"
            )
        if words is None or not self.recovery.goes_on(transfer["cube"]):
            self.given_up.add(int(row.source.rsplit("/", 1)[1]) - 1)
        return after

    def back_out(self, q: Array, line: Move, observation: Observation) -> None:
        """Retract from rest at `q` (6,) rad with open jaws, as far as a line there is long, and go to q_start."""
        cell, options = self.task.cell, options_of(self.task, self.speed)
        options = replace(options, offset=min(options.offset, _length(cell, line)))
        scene = self.rest(observation, q).scene
        self.execute(plan_retreat(scene, q, cell.unit, cell.limits, options))
        self.go_to_start(observation)

    @property
    def released_held_back(self) -> bool:
        """Whether contact held the arm back at a release that no look has judged."""
        return any(one.held_back is not None and one.held_back.by_contact for one in self._released)

    def confirm_placed(self, observation: Observation) -> Observation:
        """Judge the cubes released since the last look; look once more if one is not confirmed and may be displaced.

        Returns:
            The last observation.

        Raises:
            ExecutionStopped: the position of one is unknown.
        """
        released, self._released = self._released, []
        judged = [one.judge(self.task, observation, again=not self.recovery.most) for one in released]
        if self.recovery.most and any(why is not None and why.lost for _, why in judged):
            observation = self.look("again, for a cube that is not confirmed")
            judged = [one.judge(self.task, observation, again=True) for one, _ in judged]
        for release, why in judged:  # of all, before one ends the run
            release.row.at = "unknown" if why is not None and why.lost else release.target
        for release, why in judged:
            if why is not None:
                self._not_confirmed(release, why, observation)
            elif not release.row.placed:
                release.row.add_fault("put back", f"put back into {release.target}")
        self.recovery.keep_empty(observation)  # now that it is known which cubes stand beside holes
        return observation

    def _not_confirmed(self, release: Release, why: Unconfirmed, observation: Observation) -> None:
        """Say so, and take stock of the cube.

        Raises:
            ExecutionStopped: its position is unknown.
        """
        row, cube = release.row, cube_name(release.row.source)
        picture = self.pictures[-1].file.name
        row.add_fault("not confirmed", f"{NOT_CONFIRMED}: {'; '.join(why.reasons)} (see {picture})")
        self.tell(f"{row.source} to {release.target} {row.remarks[-1]}")
        if not why.lost:
            return
        words = self.recovery.after_release(observation, cube, release)
        if words is None:
            why_not = self.recovery.not_located.get(cube)
            row.faults.append("not located")
            self._stop(
                f"{row.source} to {release.target} {row.remarks[-1]}{f'; not located {why_not}' if why_not else ''}; "
                "correct or remove that cube"
            )
        row.at = self.recovery.displaced[cube].place
        row.remarks.append(words)
        self.tell(words)
        self.done.pop(cube, None)
        self.on_table.pop(cube_name(release.target), None)

    def _set_done(self, cube: str, place: str) -> None:
        """Take a cube for one that stays at a place."""
        self.done[cube] = place
        if place.startswith("table/"):
            self.on_table[cube_name(place)] = T_base_cube_on_table(self.task, place)

    def _stop(self, why: str) -> NoReturn:
        """End the task because a cube is misplaced or lost; `why` ends in what to do about it."""
        raise ExecutionStopped(f"{why}, and run again; the arm is at q_start", **self.report())


def _length(cell: Cell, line: Move) -> float:
    """Length of an approach or retract, m. Where only a shorter line is clear, only a retract as short is."""
    robot, path = cell.robot(), line.path
    start, end = (robot.T_base_tool(cell.unit.positions(counts))[:3, 3] for counts in (path.start, path.end))
    return float(norm(start - end))
