"""Observer of a run in progress."""

from __future__ import annotations

from arm.plan_file import Plan, Step
from cell.files.task import Task
from driver.execution.control import Control
from driver.execution.progress import Progress


class RunObserver:
    """Called by the thread that drives the arm, so its methods must not block. This base class does nothing."""

    def begins(self, task: Task, control: Control) -> None:
        """A run of a task begins. `control` states whether it is paused."""

    def plan(self, plan: Plan, name: str) -> None:
        """A plan is executed from now on; the arm is at rest. `name` is that of its file."""

    def step(self, step: Step) -> None:
        """A step begins. A step of no plan is a retract that frees a blocked arm."""

    def progress(self, progress: Progress) -> None:
        """A sample of the present motion."""
