"""A live page without a browser: what it asks and is told."""

from __future__ import annotations

import http.client
import json
import re
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from arm.controller.unit import load_unit
from arm.plan_file import Plan
from cell.live.state import NewPlan

UNIT = load_unit("crs93")
SOON_S = 60.0


def until(holds: Callable[[], bool]) -> None:
    over = time.monotonic() + SOON_S
    while not holds():
        assert time.monotonic() < over
        time.sleep(0.005)


def new_plan(plan: Plan, name: str = "plan", text: bytes | None = b"<p>plan</p>") -> NewPlan:
    return NewPlan(f"run-{name}", name, plan, UNIT, text)


def told_by(events: list[bytes]) -> list[tuple[str, dict[str, Any]]]:
    found = re.findall(r"event: (\w+)\ndata: (.*)\n\n", b"".join(events).decode())
    return [(name, json.loads(data)) for name, data in found]


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
    """A page's stream of events."""

    def __init__(self, port: int) -> None:
        self.answer = ask(port, "GET", "/events")
        assert self.answer.status == 200

    def event(self) -> tuple[str, dict[str, Any]] | None:
        """The next event, or None at the end."""
        name, over = "", time.monotonic() + SOON_S
        for raw in self.answer:
            assert time.monotonic() < over, "nothing is told"  # though the stream lives
            line = raw.decode().rstrip("\n")
            if line.startswith("event: "):
                name = line.removeprefix("event: ")
            if line.startswith("data: "):
                return name, json.loads(line.removeprefix("data: "))
        return None

    def until(self, name: str, **values: object) -> dict[str, Any]:
        while (got := self.event()) is not None:
            if got[0] == name and values.items() <= got[1].items():
                return got[1]
        raise AssertionError(f"the stream ended without {name} {values}")

    def rest(self) -> list[tuple[str, dict[str, Any]]]:
        return list(iter(self.event, None))

    def close(self) -> None:
        self.answer.close()
