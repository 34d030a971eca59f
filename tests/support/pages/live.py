"""A live page without a browser: what it asks and is told."""

from __future__ import annotations

import http.client
import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from arm.controller.unit import load_unit
from arm.plan_file import Plan
from cell.live.state import LiveState

UNIT = load_unit("crs93")
SOON_S = 60.0
Change = Callable[[LiveState], None]


def until(holds: Callable[[], bool]) -> None:
    over = time.monotonic() + SOON_S
    while not holds():
        assert time.monotonic() < over
        time.sleep(0.005)


def new_plan(plan: Plan, name: str = "plan", text: bytes | None = b"<p>plan</p>") -> Change:
    return lambda state: state.follow(f"run-{name}", name, plan, UNIT, text)


def line(text: str) -> Change:
    return lambda state: state.say(text)


OPENED = ExitStack()


def ask(port: int, method: str, path: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=SOON_S)
    OPENED.callback(connection.close)
    connection.putrequest(method, path, skip_host=True)
    for name, value in {"Host": f"127.0.0.1:{port}", **headers}.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    OPENED.callback(answer.close)
    return answer


class Reader:
    """A page that polls the state of a run."""

    def __init__(self, port: int) -> None:
        self.port, self.version = port, 0
        self.lines: list[str] = []
        self.samples: list[dict[str, Any]] = []

    def read(self) -> dict[str, Any]:
        """The state now or when there is news; lines and samples are kept."""
        answer = ask(self.port, "GET", f"/state?after={self.version}")
        assert answer.status == 200
        state: dict[str, Any] = json.loads(answer.read())
        self.version = state["version"]
        self.lines += state["lines"]
        self.samples += state["samples"]
        return state

    def until(self, holds: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """The first state of which something holds."""
        over = time.monotonic() + SOON_S
        while not holds(state := self.read()):
            assert time.monotonic() < over, state
        return state

    def end(self) -> str:
        """How the run ended."""
        return str(self.until(lambda state: state["state"] == "ended")["text"])
