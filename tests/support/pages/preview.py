"""Preview pages in a browser."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from arm.board import Board
from arm.controller.unit import Unit
from arm.plan_file import Plan
from arm.robot.model import Robot
from arm.se3 import Array
from cell.preview.clearance import CLEARANCE_EVERY_S
from cell.preview.overlays import ExecutedMove, Refused
from cell.preview.page import write_preview
from pages.browsers import DEADLINE_MS, complaints_of, until
from vision.camera.model import Camera

if TYPE_CHECKING:  # tests run without playwright too
    from playwright.sync_api import Browser, Page


CAMERA = Camera(
    np.array([[4717.0, 0.0, 1010.0], [0.0, 4717.0, 580.0], [0.0, 0.0, 1.0]]),
    np.zeros(5),
    (1920, 1200),
    np.array([[0.0, -1.0, 0.0, 0.47], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.18], [0.0, 0.0, 0.0, 1.0]]),
)


@dataclass(frozen=True)
class PlacedTestBoard:
    """A board and where it stands."""

    board: Board
    T_base_board: Array


@dataclass(frozen=True, eq=False)
class PreviewCase:
    """All that `write_preview` takes."""

    plan: Plan
    robot_open: Robot
    robot_holding: Robot
    unit: Unit
    boards: tuple[PlacedTestBoard, ...]


def write_case(
    case: PreviewCase,
    path: Path,
    clearance_every_s: float = CLEARANCE_EVERY_S,
    executed: Sequence[ExecutedMove] = (),
    refused: Refused | None = None,
) -> None:
    boards = [place.board for place in case.boards]
    write_preview(
        case.plan,
        case.robot_open,
        case.robot_holding,
        case.unit,
        path,
        boards=boards,
        camera=CAMERA,
        clearance_every_s=clearance_every_s,
        executed=executed,
        refused=refused,
    )


@contextmanager
def opened(
    browser: Browser,
    path: Path,
    width: int = 1280,
    height: int = 800,
    scheme: Literal["light", "dark"] = "light",
    at: str = "",
) -> Iterator[Page]:
    """The page, ready; on leaving, nothing may have been asked of the network or complained of."""
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    page = context.new_page()
    page.set_default_timeout(DEADLINE_MS)
    asked: list[str] = []
    complaints = complaints_of(page)
    context.set_offline(True)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri() + at)
    until(page, "window.a465 !== undefined")
    try:
        yield page
    finally:
        context.close()
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert complaints == []


def time_of(page: Page) -> float:
    return float(page.evaluate("a465.state.time"))
