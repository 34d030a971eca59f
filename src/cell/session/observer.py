"""Who follows a run while it runs."""

from __future__ import annotations

from arm.plan_file import Plan, Step
from cell.files.task import Task
from driver.execution.control import Control
from driver.execution.progress import Progress


class Watcher:
    """Is told of a run by the thread that drives the arm, so nothing here may wait. This one does not look."""

    def begins(self, task: Task, control: Control) -> None:
        """A run of a task; `control` says whether it is paused."""

    def plan(self, plan: Plan, name: str) -> None:
        """A plan is executed from now on; the arm stands. `name` is that of its file."""

    def step(self, step: Step) -> None:
        """A step begins; one that is in no plan leads away from where the arm could not go on."""

    def progress(self, progress: Progress) -> None:
        """A look at the motion of the step that runs."""
