"""A run that looks at the target once more while the cube is above its pocket.

The arm rests on the approach, the camera looks, and the last part is executed as it was certified, or planned and
certified again for where the pocket is now. If neither will do, or the arm hides the markers, the cube is taken back to
q_start in the jaws, the camera looks from there, and the cube is brought to where its place is now.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from arm.errors import ExecutionStopped, ImpossibleError
from arm.numerics.products import mul
from arm.plan_file import GripperStep, LookStep, Plan, Step
from arm.se3 import frozen, inverse
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.placement import gripper_positions
from cell.accuracy.plan_budgets import require_placements
from cell.cubes.confirm_placed import T_base_of, width_at
from cell.cubes.held_back import MOST_COUNTS, MOST_GRIPPED_COUNTS, HeldBack, held_back
from cell.files.cube_widths import width_kept
from cell.report.cubes import CubeRow, judge_release
from cell.scene.build import padded_cube, second_look_before
from cell.scene.displaced import BESIDE, support_of
from cell.scene.fingerprint import plan_fingerprint
from cell.scene.options import options_of
from cell.session.grasp_monitor import GraspMonitor
from cell.task.checked_run import CheckedRun
from cell.task.second_look.judge import Judgement, judge
from driver.execution.execute import StepResult
from driver.execution.progress import StreamOptions
from plan.program.recovery import CarryPlanner, InJaws
from plan.program.setting import Setting
from plan.scene import Station, scene_from_json
from vision.observation import Observation
from vision.occupancy.seated import CubeWidth


@dataclass(frozen=True, eq=False)
class _InHand:
    """A cube in the jaws, on the way to its place.

    Attributes:
        plan: that it is carried by.
        transfer: its entry in the plan.
        grip: closing of the jaws on it, 0 open to 1 closed.
        row: of the cube in the report.
        observation: that the plan was made from, with what has been done since.
    """

    plan: Plan
    transfer: dict[str, str]
    grip: float
    row: CubeRow
    observation: Observation

    @property
    def number(self) -> int:
        """Of the cube in the plan."""
        found: int = self.plan.task["cubes"].index(self.transfer)
        return found


class SecondLookRun(CheckedRun):
    """A run that carries cubes to their places, and may look at a place before it releases them."""

    def carry(
        self,
        steps: Sequence[Step],
        transfer: dict[str, str],
        grip: float,
        row: CubeRow,
        observation: Observation,
        plan: Plan | None = None,
    ) -> bool:
        """Execute the steps with a cube in the jaws, from the grip to the release at its target.

        Args:
            steps: the last one opens the jaws. A look among them is a second look at the target.
            transfer: entry of the plan: cube, from, to.
            grip: closing of the jaws on the cube, 0 open to 1 closed.
            row: of the cube.
            observation: the last look, or what is known instead.
            plan: that the steps are of; needed for a second look.

        Returns:
            Whether the cube was released elsewhere than the plan has it; then the arm is at q_start, and the rest must
            be planned again.

        Raises:
            ExecutionStopped: the cube was lost or is not released, a motion stopped, or no certified motion brings the
                cube to its target after a second look.
        """
        look = next((i for i, step in enumerate(steps) if isinstance(step, LookStep)), None)
        width = partial(self._width, transfer, observation)
        with width_kept(self.folder, transfer["cube"], width):
            if look is None or plan is None:
                self._release(steps, transfer, grip, row, observation, gripped=True)
                return False
            self._monitored(steps[:look], transfer["cube"], grip, gripped=True)
            held = _InHand(plan, transfer, grip, row, observation)
            found = self._judged(held)
            if found is not None and found.enters:
                self.console.step(f"second look: {found.words()}")
                self._release(steps[look + 1 :], transfer, grip, row, observation)
                return False
            if (known := width()) is not None:  # no later look shows the cube at its source
                self.widths[transfer["cube"]] = known
            self._placed_anew(held, found)
            return True

    def _placed_anew(self, held: _InHand, found: Judgement | None) -> None:
        """Bring a cube to its place other than as planned.

        Raises:
            ExecutionStopped: the run does not recover, or there is no certified way; the cube is in the jaws.
        """
        cube, why = held.transfer["cube"], "the second look does not show its place"
        if found is not None:
            why = found.words()
        try:
            if not self.recovery.most:
                raise ImpossibleError(f"{why}; a plan is executed as it is")
            if found is None or not found.worth or not self._finished(held, found):
                self._brought_again(held, found)
        except ImpossibleError as error:
            raise ExecutionStopped(
                f"{cube} is not brought to {held.transfer['to']}: {error}; {cube} is in the jaws",
                holding=cube,
            ) from error

    def _judged(self, held: _InHand) -> Judgement | None:
        """Look at the target from where the arm rests; None, said why, if that does not tell where it is."""
        self.second_looks += 1
        transfer, observation = held.transfer, held.observation
        name = transfer["to"].rpartition("/")[0]
        planned = observation.board(name)
        try:
            seen = self.see(f"at {transfer['to']} before {transfer['cube']} enters", arm_in_view=True)
        except ImpossibleError as error:
            self.tell(f"the second look at {transfer['to']} tells nothing: {error}")
            return None
        now = seen.board(name)
        if planned is None or now is None:
            why = seen.missing.get(name, "its board was not seen before")
            self.tell(f"the second look at {transfer['to']} does not show board {name}: {why}")
            return None
        return judge(self.task.cell, held.plan, held.number, observation, now.pose, planned.pose)

    def _finished(self, held: _InHand, found: Judgement) -> bool:
        """Plan the last part for where the pocket is now, and execute it; False, said why, if there is no such plan."""
        cell, transfer = self.task.cell, held.transfer
        now = _with_pose(held.observation, found)
        try:
            planner = self._planner(held, now)
            made = planner.last_part(self._station(held, now), second_look_before(cell))
            erring_clearances(cell, made, now, transfer["cube"])
        except ImpossibleError as error:
            self.tell(f"{found.words()}; the last part cannot be planned again: {error}")
            return False
        self.tell(f"{found.words()}; the last part is planned again")
        self._execute_made(made, held, now)
        return True

    def _brought_again(self, held: _InHand, found: Judgement | None) -> None:
        """Take the cube back to q_start in the jaws, look, and bring it to where its place is now.

        Raises:
            ImpossibleError: there is no certified way, or the cube is too likely to miss its pocket.
        """
        cell, transfer = self.task.cell, held.transfer
        known = held.observation if found is None else _with_pose(held.observation, found)
        why = "" if found is None else f"{found.words()}; "
        self.tell(f"{why}{transfer['cube']} is taken back to q_start in the jaws, to look again")
        made = self._planner(held, known).home()
        erring_clearances(cell, made, known, transfer["cube"])
        self.keep(made, f"back-{self.second_looks}")
        self._monitored(made.steps, transfer["cube"], held.grip)
        held.row.add_motion(made.steps)
        now = self.look(f"with {transfer['cube']} in the jaws")
        now = replace(now, moved_since=now.moved_since | {transfer["from"]})  # it left before the images
        planner = self._planner(held, now)
        planner = replace(planner, held=replace(planner.held, touches=frozenset()))
        made = planner.to_place(self._station(held, now))
        erring_clearances(cell, made, now, transfer["cube"])
        q_grip = gripper_positions(cell, held.plan)[held.number, "close"]
        budgets = require_placements(cell, now, made, gripped={0: q_grip})
        self.budgets |= {budget.cube: budget for budget in budgets}
        self._execute_made(made, held, now)

    def _execute_made(self, made: Plan, held: _InHand, now: Observation) -> None:
        """Execute a plan that releases the cube in the jaws and returns to q_start."""
        self.keep(made, f"second-look-{self.second_looks}")
        release = 1 + next(i for i, s in enumerate(made.steps) if isinstance(s, GripperStep))
        self._release(made.steps[:release], held.transfer, held.grip, held.row, now)
        held.row.add_motion(made.steps)
        self.execute(made.steps[release:])

    def _planner(self, held: _InHand, now: Observation) -> CarryPlanner:
        """Plans with the cube in the jaws as the plan has it, among what surrounds the arm now."""
        cell, transfer, q = self.task.cell, held.transfer, self.q_now()
        name = transfer["cube"]
        robot = cell.robot_holding()
        body = scene_from_json(held.plan.scene, cell.robot(), robot).cube(name)
        T_grip = robot.T_base_tool(gripper_positions(cell, held.plan)[held.number, "close"])
        T_tool_cube = frozen(mul(inverse(T_grip), body.T_base_body))
        places = transfer["to"], transfer["from"].removeprefix(BESIDE)
        scene = self.rest(now.with_states(dict.fromkeys(places, "empty")), q).scene
        support = support_of(transfer["to"])
        cube = padded_cube(cell, name, frozen(mul(robot.T_base_tool(q), T_tool_cube)))
        others = tuple(other for other in scene.cubes if other.name != name)
        scene = replace(scene, cubes=(*others, cube), allowed=scene.allowed | {frozenset((name, support))})
        setting = Setting(scene, cell.unit, cell.limits, options_of(self.task, self.speed))
        stated = {"name": self.task.name, "kind": self.task.kind, "cubes": [transfer]}
        jaws = InJaws(name, T_tool_cube, frozenset((support,)))
        return CarryPlanner(setting, q, jaws, cell.q_start, plan_fingerprint(self.task), stated)

    def _station(self, held: _InHand, now: Observation) -> Station:
        """The place of the planned release, moved with its board since the plan."""
        place = held.transfer["to"]
        q = gripper_positions(self.task.cell, held.plan)[held.number, "open"]
        T = self.task.cell.robot_holding().T_base_tool(q)
        T_then, T_now = (T_base_of(self.task, look, place) for look in (held.observation, now))
        if T_then is None or T_now is None:
            raise ImpossibleError(
                f"the board of {place} was not seen, so its holes are not known", place=place
            )
        moved = frozen(mul(mul(T_now, inverse(T_then)), T))
        return Station(place, (moved,), frozenset((support_of(place),)))

    def _release(
        self,
        steps: Sequence[Step],
        transfer: dict[str, str],
        grip: float,
        row: CubeRow,
        observation: Observation,
        gripped: bool = False,
    ) -> None:
        """Execute the steps up to the release of a cube, and take it for placed until a look judges it.

        `gripped`: they begin where the jaws have closed on it.
        """
        simulated = self.connection.simulated
        before = 0 if simulated is None else len(simulated.events)
        done = self._monitored(steps, transfer["cube"], grip, gripped)
        on_table = transfer["to"].startswith("table/")  # there is no pocket to stay out of
        held = None if on_table else self._held_back(done)
        self.add_release(steps, transfer, row, observation, held)
        self._set_done(transfer["cube"], transfer["to"])
        known = len(row.remarks)
        if simulated is not None:
            judge_release(self.task, simulated, row, transfer["to"], simulated.events[before:])
        remarks = "".join(f"; {remark}" for remark in row.remarks[known:])
        self.console.step(f"{transfer['cube']} released at {transfer['to']}{remarks}")
        if held is not None and held.by_contact:
            self.tell(f"{transfer['cube']} may not be seated: {held.words()}")

    def _held_back(self, done: Sequence[StepResult]) -> HeldBack | None:
        """How the arm rested after the last move of some steps; None if it did not move."""
        sent = next((result.sent for result in reversed(done) if result.sent is not None), None)
        return None if sent is None else held_back(self.task.cell, sent.path.end, sent.end_counts)

    def _monitored(
        self, steps: Sequence[Step], cube: str, grip: float, gripped: bool = False
    ) -> tuple[StepResult, ...]:
        """Execute steps and monitor that a cube stays in the jaws, until the last step if that releases it.

        If the steps begin where the jaws have closed on it (`gripped`), a cube that is wedged may push the arm off its
        start. The unit still holds that as its target, so the motion goes on from there.
        """
        self.held = GraspMonitor(cube, grip)
        options = StreamOptions(watch_jaws=True, start_held_counts=MOST_GRIPPED_COUNTS if gripped else 0)
        if isinstance(steps[-1], GripperStep):  # the cube may touch the rim of its pocket
            options = replace(options, held_back_counts=MOST_COUNTS)
        try:
            done = self.execute(steps, options)
            opened = done[-1].gripper
            if isinstance(steps[-1], GripperStep) and (opened is None or opened.stalled):
                why = f"the jaws do not open to release {cube}; the arm is at its target"
                raise ExecutionStopped(why, index=0)
            return done
        except ExecutionStopped as error:
            if error.data.get("reason") == "lost":
                raise
            raise ExecutionStopped(f"{error}; {cube} is in the jaws", **error.data, holding=cube) from error
        finally:
            self.held = None

    def _width(self, transfer: dict[str, Any], observation: Observation) -> CubeWidth | None:
        """Width of a cube, from the last look at its source; None if that does not determine it."""
        known = self.widths.get(transfer["cube"])
        if known is None and transfer["from"] not in observation.moved_since:
            known = width_at(self.task, observation, transfer["from"])
        return known


def _with_pose(observation: Observation, found: Judgement) -> Observation:
    """The observation with the board where a second look found it; its images do not show it there."""
    boards = tuple(
        replace(b, pose=found.pose) if b.name == found.pose.board.name else b for b in observation.boards
    )
    changed = {hole.name for hole in found.pose.holes}
    return replace(observation, boards=boards, moved_since=observation.moved_since | changed)
