"""One run of a task on an open cell: its stages, and the result for every cube."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from arm.errors import ExecutionStopped
from arm.plan_file import Plan, Step
from cell.files.board_shift import moved_boards
from cell.files.cube_widths import width_kept
from cell.report.cubes import CubeRow, judge_release
from cell.report.run_report import TO_START
from cell.scene.build import T_base_cube_on_table, cube_name
from cell.session.budget import spending
from cell.session.grasp_monitor import GraspMonitor, grip_of
from cell.session.speed import tool_words
from cell.task.confirm_placed import require_confirmed, unseen_places, width_at
from cell.task.cube_cycles import CubeCycle, cube_cycles
from cell.task.explain import explain_failure
from cell.task.open_run import OpenRun
from cell.task.planning import plan_rest, plan_retreat_from, plan_to_start, reach_of
from driver.execution.progress import StreamOptions
from vision.observation import Observation
from vision.occupancy.seated import CubeWidth


class TaskRun(OpenRun):
    """A run that moves cubes; every public method is one stage. Constructed like `OpenRun`."""

    def check_reach(self, seen: Observation) -> None:
        """Require that every hole of the task's boards is in reach.

        Raises:
            ImpossibleError: names each that is not, and by how much.
        """
        table = reach_of(self.task, seen, self.speed)
        q_start, rest = self.task.cell.q_start, (self.done, self.on_table, self.given_up)
        with explain_failure(self.task, seen, q_start, self.speed, self.advice, *rest, every_hole=True):
            table.require()
        least = min(float(np.degrees(h.best.margin)) for h in table.holes)
        self.console.step(f"reach: all {len(table.holes)} holes, at least {least:.1f} deg from every limit")

    def foresee(self, seen: Observation) -> bool:
        """Plan the whole task from q_start before anything moves, so that an impossible task is refused here.

        Returns:
            Whether there is anything to do.

        Raises:
            ImpossibleError: names step, hole, joint or pair of bodies and how much.
        """
        self.check_reach(seen)
        q_start = self.task.cell.q_start
        explaining = explain_failure(self.task, seen, q_start, self.speed, self.advice, every_hole=True)
        with self.console.doing("planning"), explaining, spending(self.budget):
            plan = plan_rest(self.task, seen, q_start, self.speed, {}, {})
        if plan is None:
            self.console.step(f"board {self.task.from_board.name} holds no cube: nothing to do")
            return False
        speed = tool_words(plan, self.task.cell, self.control.ceiling)
        self.console.step(
            f"foreseen: {len(plan.task['cubes'])} cubes in {plan.duration_s:.1f} s of motion, {speed}"
        )
        hidden = unseen_places(self.task, seen, [c["to"] for c in plan.task["cubes"]])
        if hidden:
            self.tell(hidden)
        return True

    def go_to_start(self, seen: Observation | None) -> None:
        """Go to q_start, avoiding what was seen or, without a look, the whole zone for boards."""
        plan = plan_to_start(self.task, seen, self.q_now(), self.speed, self.on_table)
        if plan is not None:
            self.keep(plan, TO_START)
            self.execute(plan.steps)

    def move_cubes(self, seen: Observation) -> None:
        """Plan the rest and execute it, until nothing is left."""
        plan = self._plan_rest(seen)
        while plan is not None:
            seen, again = self.follow(plan, seen)
            plan = self._plan_rest(seen) if again else None

    def _plan_rest(self, seen: Observation) -> Plan | None:
        q_now, rest = self.q_now(), (self.done, self.on_table, self.given_up)
        explaining = explain_failure(self.task, seen, q_now, self.speed, self.advice, *rest)
        with self.console.doing("planning"), explaining, spending(self.budget):
            plan = plan_rest(self.task, seen, q_now, self.speed, *rest)
        if plan is None:
            return None
        cubes = plan.task["cubes"]
        self.console.step(
            f"planned {len(cubes)} cube{'' if len(cubes) == 1 else 's'}: {plan.duration_s:.1f} s of motion, "
            f"clearance {1e3 * min(m.clearance for m in plan.moves):.1f} mm, {plan.sha256[:12]}"
        )
        self.keep(plan, "plan" if not any(p.task["cubes"] for p in self.plans) else f"plan-{len(self.plans)}")
        return plan

    def follow(self, plan: Plan, seen: Observation) -> tuple[Observation, bool]:
        """Execute a plan cube by cube; return early, with True, if the rest must be replanned.

        Raises:
            ExecutionStopped: a cube is at neither of its places, so its position is unknown; the arm is at q_start.
        """
        planned = seen
        behind: tuple[
            Step, ...
        ] = ()  # retract from the last place: one motion with the moves to the next cube
        visited = cube_cycles(plan)
        for transfer, visit in zip(plan.task["cubes"], visited, strict=True):
            row = CubeRow(transfer["from"], transfer["to"])
            self.rows.append(row)
            held = self.execute((*behind, *visit.fetch))[-1].gripper
            row.add_motion(visit.fetch)
            if held is None or not held.stalled:
                return self._missed(visit, row, seen, "the jaws closed on nothing"), True
            why_not = grip_of(self.task.cell).why_not(self.task.cell.gripper.width(held.fraction_closed))
            if why_not:
                return self._missed(visit, row, seen, why_not), True
            with width_kept(self.folder, transfer["cube"], partial(self._width, transfer, seen)):
                self._carry(visit.carry, transfer["cube"], held.fraction_closed)
            row.add_motion((*visit.carry, *visit.leave))
            self._put_down(transfer, row, seen)
            seen, behind = seen.with_moves({transfer["cube"]: transfer["to"]}), visit.leave
            last = visit is visited[-1]
            if last or visit.looks:
                self.execute(behind)
                behind = ()
            if not last and not visit.looks:
                continue
            expected, seen = seen, self.look(f"after cube {len(self.rows)}")
            self.confirm_placed(seen)
            changes = moved_boards(planned, seen, self.task.cell) + seen.changed(expected)
            for line in changes:
                self.tell(line + "; the rest is replanned")
            if changes and not last:
                return seen, True
        return seen, False

    def _carry(self, steps: Sequence[Step], cube: str, grip: float) -> None:
        """Execute the steps with a cube in the jaws, and monitor that it stays there until it is released.

        Raises:
            ExecutionStopped: the cube was lost or is not released, or a motion stopped.
        """
        self.held = GraspMonitor(cube, grip)
        try:
            opened = self.execute(steps, StreamOptions(watch_jaws=True))[-1].gripper
            if opened is None or opened.stalled:
                raise ExecutionStopped(
                    f"the jaws do not open to release {cube}; the arm is at its target", index=0
                )
        except ExecutionStopped as error:
            if error.data.get("reason") != "lost":
                raise ExecutionStopped(
                    f"{error}; {cube} is in the jaws", **error.data, holding=cube
                ) from error
            raise
        finally:
            self.held = None

    def _width(self, transfer: dict[str, Any], seen: Observation) -> CubeWidth | None:
        """Width of a cube, by the last look at its source; None if that does not determine it."""
        known = self.widths.get(transfer["cube"])
        if known is None and transfer["from"] not in seen.moved_since:
            known = width_at(self.task, seen, transfer["from"])
        return known

    def _missed(self, visit: CubeCycle, row: CubeRow, seen: Observation, why: str) -> Observation:
        """The jaws hold no cube: open them on the spot, back out, go to q_start, look."""
        self.tell(f"cube of {row.source} is not gripped: {why}")
        row.remarks.append(why)
        self.given_up.add(int(row.source.rsplit("/", 1)[1]) - 1)
        self.connection.mars.gripper(0.0)
        self.execute(plan_retreat_from(self.task, seen, visit.approach, self.speed, self.on_table))
        self.go_to_start(seen)
        before, after = seen.state(row.source), self.look("after a missed cube")
        if before == "cube" and after.state(row.source) == "empty":
            self._stop(
                f"the cube of {row.source} is gone from its hole and was not gripped; its position is unknown: "
                "remove it"
            )
        return after

    def confirm_placed(self, seen: Observation) -> None:
        """Judge the cubes released since the last look.

        Raises:
            ExecutionStopped: the position of one is unknown.
        """
        for row, found in self._let_go.judge(seen, self.pictures[-1].file):
            self.tell(f"{row.source} to {row.target} {row.remarks[-1]}")
            if found.lost:
                self._stop(f"{row.source} to {row.target} {row.remarks[-1]}; correct or remove that cube")

    def require_confirmed(self) -> dict[str, Any]:
        """The report of a run; requires that every cube was confirmed.

        Raises:
            ExecutionStopped: one was not; with the report.
        """
        report = self.report()
        require_confirmed(self.rows, report)
        return report

    def _stop(self, why: str) -> None:
        """End the task because a cube is misplaced or lost; `why` ends in what to do about it."""
        raise ExecutionStopped(
            f"{why}, and run again; the arm is at q_start",
            **self.report(),
        )

    def _put_down(self, transfer: dict[str, Any], row: CubeRow, seen: Observation) -> None:
        """Record a released cube, to be confirmed by the next look; `seen`: the last look before."""
        self._let_go.add(row, seen, self.widths.get(transfer["cube"]))
        self.done[transfer["cube"]] = transfer["to"]
        if self.task.places is not None:
            self.on_table[cube_name(transfer["to"])] = T_base_cube_on_table(self.task, transfer["to"])
        if self.connection.simulated is not None:
            judge_release(self.task, self.connection.simulated, row)
        remarks = "".join(f"; {remark}" for remark in row.remarks)
        self.console.step(f"{transfer['cube']} released at {transfer['to']}{remarks}")

    def finish_carry(
        self,
        carry: Sequence[Step],
        leave: Sequence[Step],
        transfer: dict[str, Any],
        grip: float,
        row: CubeRow,
        seen: Observation,
    ) -> None:
        """Execute steps that start with a cube in the jaws, closed by `grip`, and then those that leave its target."""
        with width_kept(self.folder, transfer["cube"], partial(self._width, transfer, seen)):
            self._carry(carry, transfer["cube"], grip)
        row.add_motion((*carry, *leave))
        self._put_down(transfer, row, seen)
        self.execute(leave)
