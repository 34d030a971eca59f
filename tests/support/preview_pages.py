"""Preview pages in a browser."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from browsers import DEADLINE_MS, complaints_of, until
from cell.preview.page import write_preview


@dataclass(frozen=True)
class Camera:
    """Above the boards, looking down."""

    K: np.ndarray
    size: tuple[int, int]
    T_base_camera: np.ndarray


CAMERA = Camera(
    np.array([[4717.0, 0.0, 1010.0], [0.0, 4717.0, 580.0], [0.0, 0.0, 1.0]]),
    (1920, 1200),
    np.array([[0.0, -1.0, 0.0, 0.47], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.18], [0.0, 0.0, 0.0, 1.0]]),
)


def write_case(case, path: Path, **options) -> None:
    boards = [place.board for place in case.boards]
    write_preview(
        case.plan,
        case.robot_open,
        case.robot_holding,
        case.unit,
        path,
        boards=boards,
        camera=CAMERA,
        **options,
    )


@contextmanager
def opened(browser, path: Path, width: int = 1280, height: int = 800, scheme: str = "light", at: str = ""):
    """The page, ready; on leaving, nothing may have been asked of the network or complained of."""
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    page = context.new_page()
    page.set_default_timeout(DEADLINE_MS)
    asked, complaints = [], complaints_of(page)
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


def time_of(page) -> float:
    return float(page.evaluate("a465.state.time"))
