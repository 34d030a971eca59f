"""The live view of a run: a page on the loopback that follows the arm by the controller's own position samples."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count

from arm.controller.unit import Unit
from arm.errors import A465Error, InputError
from arm.plan_file import Plan, Step
from cell.console import Console
from cell.files.task import Task
from cell.live.server import LiveServer
from cell.preview.of_plan import plan_page
from cell.session.observer import RunObserver
from driver.execution.control import Control
from driver.execution.progress import Progress

LEAST_PORT = 1024  # lower ports need privileges


class Live(RunObserver):
    """Observer that reports a run to a server. Only `plan` takes time; the arm is at rest then."""

    def __init__(self, server: LiveServer) -> None:
        self._server = server
        self._task: Task | None = None
        self._run = secrets.token_hex(4)  # a page that was left open must not match a later run
        self._plans = count(1)

    def begins(self, task: Task, control: Control) -> None:
        self._task = task
        self._server.put(lambda state: state.begin(control))

    def plan(self, plan: Plan, name: str) -> None:
        if self._task is None:
            return
        unit = self._task.cell.unit
        mark = f"{self._run}-{next(self._plans)}"
        try:
            page = plan_page(self._task, plan, mark).encode()
        except A465Error as error:  # the run goes on without a page
            self.line(f"no live page of {name}: {error}")
            page = None
        self._server.put(lambda state: state.follow(mark, name, plan, unit, page))

    def step(self, step: Step) -> None:
        self._server.put(lambda state: state.enter(step))

    def progress(self, progress: Progress) -> None:
        self._server.put(lambda state: state.sample(progress))

    def place(self, plan: Plan, unit: Unit, page_of: Callable[[str], str]) -> None:
        """Show an arm that follows no plan here.

        Args:
            plan: of one step, in which the arm rests.
            unit: whose counts `reading` gets.
            page_of: makes the page, from its mark.
        """
        mark = f"{self._run}-{next(self._plans)}"
        page = page_of(mark).encode()
        self._server.put(lambda state: state.follow(mark, "place", plan, unit, page))
        self._server.put(lambda state: state.enter(plan.steps[0]))

    def reading(self, counts: Sequence[int] | None, facts: str) -> None:
        """Where that arm is; see `cell.live.state.LiveState.rest`."""
        self._server.put(lambda state: state.rest(counts, facts))

    def line(self, text: str) -> None:
        """Pass on a line of the console."""
        self._server.put(lambda state: state.say(text))


@contextmanager
def live_view(console: Console, port: int = 0) -> Iterator[Live]:
    """Inside the block, show a run in a browser on this machine.

    Args:
        console: output; prints the page's URL, and the page shows its lines.
        port: port to listen on; 0: any free port.

    Raises:
        InputError: it cannot listen on the port.
    """
    if port and not LEAST_PORT <= port <= 65535:
        why = f"--live-port = {port}: must be from {LEAST_PORT} to 65535, or 0 for any free port"
        raise InputError(why, port=port)
    server = LiveServer(port)
    live = Live(server)
    server.start()
    console.listener = live.line
    text = "not done"
    try:
        console.say(f"live view: {server.url}")
        yield live
        text = "done"
    except A465Error as error:
        text = f"{error.word}: {error}"
        raise
    except KeyboardInterrupt:
        text = "interrupted"
        raise
    finally:
        console.listener = None
        server.end(text)
