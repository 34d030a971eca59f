"""One run of a task on an open cell: its stages, and the result for every cube."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from arm.errors import ExecutionStopped, ImpossibleError
from arm.plan_file import Move, Plan, Step
from cell.accuracy.budget_report import budget_words
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.plan_budgets import plan_budgets, require_placements
from cell.cubes.confirm_placed import unseen_places
from cell.files.board_shift import moved_boards
from cell.scene.build import cube_name
from cell.scene.displaced import DisplacedCube
from cell.scene.places import reach_of
from cell.session.budget import spending
from cell.session.grasp_monitor import grip_fault
from cell.session.speed import tool_words
from cell.task.cube_cycles import cube_cycles
from cell.task.explain import explain_failure
from cell.task.planning import (
    Rest,
    free_goals,
    hidden_holes,
    plan_otherwise,
    plan_recovery,
    plan_rest,
    skipped_cubes,
)
from cell.task.second_look.judge import second_look_helps
from cell.task.second_look.run import SecondLookRun
from vision.observation import Observation


class TaskRun(SecondLookRun):
    """A run that moves cubes; every public method is one stage. Constructed like `OpenRun`."""

    def check_reach(self, observation: Observation) -> None:
        """Require that every hole of the task's boards is in reach.

        Raises:
            ImpossibleError: names each hole that is not, and by how much.
        """
        if self.task.skip:  # what is out of reach stays, and the plan says so
            return
        table = reach_of(self.task, observation, self.speed)
        with explain_failure(self.rest(observation, self.task.cell.q_start), self.advice, every_hole=True):
            table.require()
        least = min(float(np.degrees(h.best.margin)) for h in table.holes)
        self.console.step(f"reach: all {len(table.holes)} holes, at least {least:.1f} deg from every limit")

    def foresee(self, observation: Observation) -> bool:
        """Plan the whole task from q_start before anything moves, so that an impossible task is refused here.

        Returns:
            Whether there is anything to do.

        Raises:
            ImpossibleError: names step, hole, joint or pair of bodies and how much.
        """
        self.check_reach(observation)
        self._survey(observation)
        rest = replace(self.rest(observation, self.task.cell.q_start), done={}, skip=())
        plan = self._planned(rest, every_hole=True)
        if plan is None and self.recovery.displaced:
            return True
        if plan is None:
            self.console.step(f"board {self.task.from_board.name} holds no cube: nothing to do")
            return False
        cell = self.task.cell
        speed = tool_words(plan, cell.robot_holding(), cell.unit, self.control.ceiling)
        self.console.step(
            f"foreseen: {len(plan.task['cubes'])} cubes in {plan.duration_s:.1f} s of motion, {speed}"
        )
        observation, plan = self._certain(rest, plan)
        targets = [] if plan is None else [c["to"] for c in plan.task["cubes"]]
        hidden = unseen_places(self.task, observation, targets)
        if hidden:
            self.tell(hidden)
        return True

    def carry_out(self, observation: Observation) -> None:
        """Do the task, for a look from q_start."""
        self.check_reach(observation)
        self.move_cubes(observation)

    def move_cubes(self, observation: Observation) -> None:
        """Plan the rest and execute it, until nothing is left; take displaced cubes first, and blocked ones at last."""
        self._survey(observation)
        observation = self._move_rest(self._recover(observation))
        while self.recovery.take_up():
            observation = self._move_rest(self._recover(observation))
        for cube in self.recovery.stuck.values():
            row = self.add_row({"cube": cube.name, "from": cube.place, "to": self.recovery.target(cube)})
            row.at = cube.place
            if "stays" not in row.faults:
                row.add_fault("stays", f"it stays {cube.place}")
        for line in hidden_holes(self.rest(observation, self.task.cell.q_start)):
            self.tell(line)

    def _move_rest(self, observation: Observation) -> Observation:
        """Move the cubes that are in their seats; what a cube beside its seat keeps from moving stays."""
        try:
            plan, observation = self._plan_rest(observation)
        except ImpossibleError as error:
            if not self.recovery.cubes:
                raise
            self.tell(f"no other cube moves: {error}")
            return observation
        while plan is not None:
            observation, again = self.follow(plan, observation)
            observation = self._recover(observation)
            plan, observation = self._plan_rest(observation) if again else (None, observation)
        return observation

    def _survey(self, observation: Observation) -> None:
        self.recovery.keep_empty(observation)
        for line in self.recovery.survey(observation):
            self.tell(line)

    def _recover(self, observation: Observation) -> Observation:
        """Take displaced cubes again, each by a plan of its own; return the last observation.

        Those that stay are located in each new look, too: the other cubes are planned around them.
        """
        recovery = self.recovery
        while True:
            for line in recovery.locate_again(observation):
                self.tell(line)
            if not recovery.displaced:
                return observation
            cube = next(iter(recovery.displaced.values()))
            try:
                plan = self._plan_recovery(cube, observation)
            except ImpossibleError as error:
                row = self.add_row({"cube": cube.name, "from": cube.place, "to": recovery.target(cube)})
                row.at = cube.place
                if recovery.wait(cube):
                    words = f"waits {cube.place} until the others are moved: {error}"
                    row.remarks.append(f"it {words}")
                else:
                    words = f"stays {cube.place}: {error}"
                    row.add_fault("stays", f"it {words}")
                self.tell(f"{cube.name} {words}")
                continue
            self.keep(plan, f"recovery-{sum(recovery.tried.values())}")
            observation, _ = self.follow(plan, observation)

    def _plan_recovery(self, cube: DisplacedCube, observation: Observation) -> Plan:
        """Plan to take a displaced cube to its target or, after the last attempt, back to its hole."""
        rest = self.rest(observation, self.q_now())
        others = tuple(other for other in rest.displaced if other is not cube)
        goals = self.recovery.goals(cube, observation, lambda: free_goals(replace(rest, displaced=others)))
        with self.console.doing("planning"), spending(self.budget):
            plan = plan_recovery(rest, cube, goals)
        (transfer,) = plan.task["cubes"]
        beside = sorted(
            {name for m in plan.moves for name in m.allowed_collisions if name.startswith(cube_name(""))}
        )
        if beside:
            self.tell(f"{cube.name} is lifted along {' and '.join(beside)}, which it may touch")
        self.console.step(
            f"planned {cube.name} from {cube.place} to {transfer['to']}: {plan.duration_s:.1f} s of motion, "
            f"clearance {1e3 * min(m.clearance for m in plan.moves):.1f} mm, {plan.sha256[:12]}"
        )
        return plan

    def _planned(self, rest: Rest, every_hole: bool = False) -> Plan | None:
        explaining = explain_failure(rest, self.advice, every_hole)
        with self.console.doing("planning"), explaining, spending(self.budget):
            plan = plan_rest(rest)
        for line in skipped_cubes(plan):
            if line not in self.remarks:
                self.tell(line)
        return plan

    def _plan_rest(self, observation: Observation) -> tuple[Plan | None, Observation]:
        """Plan what is left, for this look or for a longer one; return the plan and its look."""
        rest = self.rest(observation, self.q_now())
        plan = self._planned(rest)
        if plan is None:
            return None, observation
        seen, plan = self._certain(rest, plan)
        if plan is None:
            return None, seen
        cubes = plan.task["cubes"]
        self.console.step(
            f"planned {len(cubes)} cube{'' if len(cubes) == 1 else 's'}: {plan.duration_s:.1f} s of motion, "
            f"clearance {1e3 * min(m.clearance for m in plan.moves):.1f} mm, {plan.sha256[:12]}"
        )
        again = any(kept.plan.task["cubes"] for kept in self.kept)
        self.keep(plan, f"plan-{len(self.kept)}" if again else "plan")
        return plan, seen

    def _certain(self, rest: Rest, plan: Plan) -> tuple[Observation, Plan | None]:
        """Require accurate placements; if more images in a look suffice for that, take them and plan anew.

        Returns:
            The observation, or the longer look that makes the placements certain enough, and the plan for it;
            None if that look leaves nothing to move.

        Raises:
            ImpossibleError: as `require_accuracy`.
        """
        try:
            self.require_accuracy(rest.observation, plan)
        except ImpossibleError as error:
            if not self.recovery.most:
                raise
            images = error.data.get("photographs")
            if images is None or (self.photographs or 0) >= images:
                return rest.observation, self._with_second_looks(rest, plan, error)
            self.tell(f"the placements are not certain enough: looking with {images} images")
            self.photographs = images
            rest = replace(rest, observation=self.look(f"with {images} images"))
            planned = self._planned(rest)
            if planned is not None:
                try:
                    self.require_accuracy(rest.observation, planned)
                except ImpossibleError as again:
                    planned = self._with_second_looks(rest, planned, again)
            return rest.observation, planned
        return rest.observation, plan

    def _with_second_looks(self, rest: Rest, plan: Plan, refused: ImpossibleError) -> Plan | None:
        """Plan again with a second look for the cubes that are not certain to enter, if that makes them certain enough.

        Raises:
            ImpossibleError: `refused`; it does not.
        """
        cell, seen = self.task.cell, rest.observation
        uncertain = second_look_helps(cell, seen, plan) if "insertion" in refused.data else frozenset()
        planned = self._planned(replace(rest, second_looks=uncertain)) if uncertain else None
        if planned is None:
            raise refused
        erring_clearances(cell, planned, seen)
        self.budgets |= {budget.cube: budget for budget in plan_budgets(cell, seen, planned)}
        names = ", ".join(sorted(uncertain))
        self.tell(f"one look does not make it certain enough: a second one before the pocket, with {names}")
        return planned

    def require_accuracy(self, observation: Observation, plan: Plan, given: bool = False) -> None:
        """Say how accurate the placements are.

        Args:
            observation: of the boards.
            plan: to be executed.
            given: the plan is a file, so no other one is tried.

        Raises:
            ImpossibleError: a cube is too likely to miss its pocket, or the arm may come too near to something.
        """
        erring_clearances(self.task.cell, plan, observation)
        rest = self.rest(observation, self.task.cell.unit.positions(plan.start))
        again = None if given else partial(plan_otherwise, rest)
        budgets = require_placements(self.task.cell, observation, plan, again)
        self.budgets |= {budget.cube: budget for budget in budgets}
        if budgets:
            self.console.step(budget_words(budgets))

    def follow(self, plan: Plan, observation: Observation) -> tuple[Observation, bool]:
        """Execute a plan cube by cube, and look where the plan does.

        Returns:
            The last observation, and whether the remaining cubes must be replanned.

        Raises:
            ExecutionStopped: a cube is at neither of its places, so its position is unknown; the arm is at q_start.
        """
        planned, cycles = observation, cube_cycles(plan)
        retract: tuple[Step, ...] = ()  # from the last place: one motion with the moves to the next cube
        for transfer, cycle in zip(plan.task["cubes"], cycles, strict=True):
            row = self.add_row(transfer)
            held = self.execute((*retract, *cycle.fetch))[-1].gripper
            row.add_motion(cycle.fetch)
            why_not = "the jaws closed on nothing"
            if held is not None and held.stalled:
                why_not = grip_fault(self.task.cell, self.task.cell.gripper.width(held.fraction_closed))
            if held is None or why_not:
                return self.missed(cycle, transfer, row, observation, why_not), True
            self.recovery.displaced.pop(transfer["cube"], None)
            if self.carry(cycle.carry, transfer, held.fraction_closed, row, observation, plan):
                observation = self.look(f"after cube {len(self.rows)}")
                return self.confirm_placed(observation), True
            row.add_motion((*cycle.carry, *cycle.leave))
            observation = observation.with_moves({transfer["cube"]: transfer["to"]})
            retract, last = cycle.leave, cycle is cycles[-1]
            if not last and not cycle.looks:
                if not self.released_held_back:
                    continue
                away = next(step for step in cycle.leave if isinstance(step, Move))
                self.back_out(self.task.cell.unit.positions(away.path.start), away, observation)
                observation = self.look(f"after cube {len(self.rows)}, which may not be seated")
                return self.confirm_placed(observation), True
            self.execute(retract)
            retract = ()
            expected, observation = observation, self.look(f"after cube {len(self.rows)}")
            observation = self.confirm_placed(observation)
            if self.recovery.displaced:
                return observation, True
            changes = moved_boards(planned, observation, self.task) + observation.changed(expected)
            for line in changes:
                self.tell(line + "; the rest is replanned")
            if changes and not last:
                return observation, True
        return observation, False

    def require_confirmed(self) -> dict[str, Any]:
        """The report of a run; requires that every cube was confirmed.

        Raises:
            ExecutionStopped: names those that were not; with the report.
        """
        report = self.report()
        wrong = [row for row in self.rows if not row.placed]
        if wrong:
            listed = "; ".join(f"{row.way}: {'; '.join(row.remarks[-1:])}" for row in wrong)
            raise ExecutionStopped(
                f"{len(wrong)} of {len(self.rows)} cubes not confirmed: {listed}", **report
            )
        return report
