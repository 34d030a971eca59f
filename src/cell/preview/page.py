"""Assemble the page: template, style, scripts and content in one self-contained file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, Unpack

from arm.board import Board
from arm.controller.unit import Unit
from arm.io.storage import canonical_json, read_text, write_atomic
from arm.plan_file import Plan
from arm.robot.model import Robot
from cell.accuracy.picture import BudgetPicture
from cell.preview.clearance import CLEARANCE_EVERY_S, sample_clearance
from cell.preview.content import page_content
from cell.preview.overlays import ExecutedMove, Refused
from cell.report.html import Table, render
from vision.camera.model import Camera, Image

_HERE = Path(__file__).resolve().parent
# Ordered: a later script may use what an earlier one defines.
SCRIPTS = (
    *("palette.js", "motion.js", "shapes.js", "stage.js", "cell3d.js"),
    *("trace.js", "chart.js", "plots.js", "panels.js", "marks.js", "aids.js", "main.js"),
)
LIVE_SCRIPTS = ("live.js",)


class Drawn(TypedDict, total=False):
    """What a page draws besides the plan and the arm; see `cell.preview.content.page_content`."""

    boards: Sequence[Board]
    dictionary: str
    camera: Camera | None
    photograph: Image | None
    executed: Sequence[ExecutedMove]
    erring: Sequence[float]
    refused: Refused | None
    resting: bool


class Accuracy(NamedTuple):
    """Predicted accuracy of a plan's placements: a table, and pictures of the boards."""

    table: Table
    boards: Sequence[BudgetPicture]


def write_preview(
    plan: Plan,
    robot_open: Robot,
    robot_holding: Robot,
    unit: Unit,
    path: Path,
    *,
    clearance_every_s: float = CLEARANCE_EVERY_S,
    **drawn: Unpack[Drawn],
) -> None:
    """Write a plan as one self-contained HTML file. The same input gives the same bytes.

    Args:
        plan, robot_open, robot_holding, unit, drawn: see `cell.preview.content.page_content`.
        path: of the file, usually ``.html``.
        clearance_every_s: see `preview_page`.

    Raises:
        InputError: the plan does not fit the unit or the arms, or the file cannot be written.
    """
    arms = robot_open, robot_holding
    write_atomic(path, preview_page(plan, *arms, unit, clearance_every_s=clearance_every_s, **drawn))


def preview_page(
    plan: Plan,
    robot_open: Robot,
    robot_holding: Robot,
    unit: Unit,
    *,
    clearance_every_s: float = CLEARANCE_EVERY_S,
    live: str | None = None,
    accuracy: Accuracy | None = None,
    **drawn: Unpack[Drawn],
) -> str:
    """Return a plan as HTML text. The same input gives the same text.

    Args:
        plan, robot_open, robot_holding, unit, drawn: see `cell.preview.content.page_content`.
        clearance_every_s: spacing of the clearance samples along the moves; 0 shows the plan's figures instead.
        live: the mark of a page that follows the state of its server (`cell.live.server`).
        accuracy: shown below the steps.

    Raises:
        InputError: the plan does not fit the unit or the arms.
    """
    arms = robot_open, robot_holding
    sampled = sample_clearance(plan, *arms, unit, clearance_every_s) if clearance_every_s > 0.0 else None
    content = page_content(plan, *arms, unit, clearance=sampled, **drawn)
    return page(content if live is None else content | {"live": live, "code": None}, accuracy)


def page(content: dict[str, Any], accuracy: Accuracy | None = None) -> str:
    """Return the HTML text for `content` (of `page_content`, plus the mark of a live page)."""
    live = "live" in content
    return render(
        "preview/page/page.html.j2",
        live=live,
        style=_part("page/style.css"),
        content=canonical_json(content).replace("<", "\\u003c"),  # no name in the plan ends the element early
        licence=_part("vendor/LICENSE.three.txt").replace("--", "- -"),
        three=_part("vendor/three.bundle.min.js").replace("</script", "<\\/script"),
        accuracy=accuracy,
        scripts=_scripts((*LIVE_SCRIPTS, *SCRIPTS) if live else SCRIPTS),
    )


def waiting_page() -> str:
    """Return the page of a run without a plan yet; it follows the same state as a live page."""
    scripts = _scripts((*LIVE_SCRIPTS, "waiting.js"))
    return render("preview/page/waiting.html.j2", live=True, style=_part("page/style.css"), scripts=scripts)


def _scripts(names: Sequence[str]) -> list[str]:
    return [_part(f"page/{name}") for name in names]


def _part(name: str) -> str:
    return read_text(_HERE / name)
