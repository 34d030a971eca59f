"""The live view of a run: a page on the loopback that follows the arm by the controller's own position samples."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

from arm.errors import A465Error, InputError
from arm.plan_file import Plan, Step
from cell.console import Console
from cell.files.task import Task
from cell.live.server import Hub, LiveServer
from cell.live.state import Begun, NewPlan, Told
from cell.preview.of_plan import live_page
from cell.session.observer import Watcher
from driver.execution.control import Control
from driver.execution.progress import Progress

LEAST_PORT = 1024  # below it a port is the system's


class Live(Watcher):
    """Tells a server of a run; only `plan` takes time, and the arm stands then.

    Args:
        hub: of the server.
    """

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._task: Task | None = None
        self._run = secrets.token_hex(4)  # a page that was left open must not take the next run for its own
        self._plans = count(1)

    def begins(self, task: Task, control: Control) -> None:
        self._task = task
        self._hub.put(Begun(control))

    def plan(self, plan: Plan, name: str) -> None:
        if self._task is None:
            return
        mark = f"{self._run}-{next(self._plans)}"
        try:
            page = live_page(self._task, plan, mark).encode()
        except A465Error as error:  # the arm is not to wait for a picture
            self.told(f"no live page of {name}: {error}")
            page = None
        self._hub.put(NewPlan(mark, name, plan, self._task.cell.unit, page))

    def step(self, step: Step) -> None:
        self._hub.put(step)

    def progress(self, progress: Progress) -> None:
        self._hub.put(progress)

    def told(self, text: str) -> None:
        """A line that the console tells."""
        self._hub.put(Told(text))


@contextmanager
def live_view(console: Console, port: int = 0) -> Iterator[Live]:
    """Inside, a run can be watched in a browser of this machine; how it ended is told there too.

    Args:
        console: told where the page is; the page is told what the console is.
        port: to listen at; 0 takes any that is free.

    Raises:
        InputError: the port cannot be listened at.
    """
    if port and not LEAST_PORT <= port <= 65535:
        raise InputError(
            f"--live-port = {port}: must be from {LEAST_PORT} to 65535, or 0 for any that is free", port=port
        )
    server = LiveServer(port)
    live = Live(server.hub)
    server.start()
    console.listener = live.told
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
