"""One run of a program on an open cell."""

from __future__ import annotations

from functools import partial

from arm.plan_file import Plan
from cell.accuracy.clearances import erring_clearances
from cell.program.planning import plan_of_program
from cell.program.program_file import ProgramTask
from cell.session.budget import spending
from cell.session.speed import tool_words
from cell.task.explain import explain_list_failure
from cell.task.run import TaskRun
from vision.observation import Observation


class ProgramRun(TaskRun):
    """A run of a program: what a `TaskRun` is for cubes. Constructed like `OpenRun`, with a `ProgramTask`."""

    task: ProgramTask

    def foresee(self, observation: Observation) -> bool:
        """Plan the whole program before anything moves, so that an impossible one is refused here.

        Returns:
            True: there always is something to do.

        Raises:
            ImpossibleError: names the step.
        """
        plan = self._plan_of(observation)
        cell = self.task.cell
        words = tool_words(plan, cell.robot_holding(), cell.unit, self.control.ceiling)
        self.console.step(f"foreseen: {plan.duration_s:.1f} s of motion, {words}")
        return True

    def carry_out(self, observation: Observation) -> None:
        """Plan the program for a look from q_start, and execute it."""
        plan = self._plan_of(observation)
        self.console.step(
            f"planned {self.task.title}: {plan.duration_s:.1f} s of motion, "
            f"clearance {1e3 * min(m.clearance for m in plan.moves):.1f} mm, {plan.sha256[:12]}"
        )
        self.keep(plan, "plan")
        self.follow_through(plan)

    def _plan_of(self, observation: Observation) -> Plan:
        explain = partial(explain_list_failure, self.task, observation) if self.advice else None
        with self.console.doing("planning"), spending(self.budget):
            plan = plan_of_program(self.task, observation, self.speed, explain)
        erring_clearances(self.task.cell, plan, observation)
        return plan
