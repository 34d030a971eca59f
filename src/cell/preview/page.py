"""The page: template, style, scripts and content joined into one file that asks for nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm.board import Board
from arm.files import canonical_json, read_text, write_atomic
from arm.planfile import Plan
from arm.robot import Robot
from arm.unit import Unit
from cell.preview.clearance import CLEARANCE_EVERY_S, sample_clearance
from cell.preview.content import page_content
from cell.preview.overlays import CameraView, ExecutedMove

_HERE = Path(__file__).resolve().parent
# In the order of use: a later script may use what an earlier one defines.
SCRIPTS = (
    "palette.js",
    "motion.js",
    "shapes.js",
    "stage.js",
    "cell3d.js",
    "trace.js",
    "chart.js",
    "plots.js",
    "panels.js",
    "main.js",
)


def write_preview(
    plan: Plan,
    robot_open: Robot,
    robot_holding: Robot,
    unit: Unit,
    path: Path,
    *,
    boards: Sequence[Board] = (),
    dictionary: str = "DICT_4X4_50",
    camera: CameraView | None = None,
    clearance_every_s: float = CLEARANCE_EVERY_S,
    executed: Sequence[ExecutedMove] = (),
) -> None:
    """Write a plan as one HTML file that opens without network; the same input gives the same bytes.

    Args:
        plan, robot_open, robot_holding, unit: what is shown; see `cell.preview.content.page_content`.
        path: of the file, usually ``.html``.
        boards: known to the cell; those in the plan's scene are drawn with holes and markers.
        dictionary: of the boards' markers.
        camera: drawn with its view.
        clearance_every_s: spacing of the clearance samples along the moves; 0 shows one figure a move instead.
        executed: drawn over the plan.

    Raises:
        InputError: the plan does not fit the unit or the arms, or the file cannot be written.
    """
    sampled = (
        sample_clearance(plan, robot_open, robot_holding, unit, clearance_every_s)
        if clearance_every_s > 0.0
        else None
    )
    content = page_content(
        plan,
        robot_open,
        robot_holding,
        unit,
        boards=boards,
        dictionary=dictionary,
        camera=camera,
        clearance=sampled,
        executed=executed,
    )
    write_atomic(path, page(content))


def page(content: dict[str, Any]) -> str:
    """The HTML text around `content` (what `page_content` gives)."""
    scripts = "".join(f"<script>\n{_script(name)}</script>\n" for name in SCRIPTS)
    licence = read_text(_HERE / "vendor" / "LICENSE.three.txt").replace("--", "- -")
    parts = {
        "<!--style-->": f"<style>\n{read_text(_HERE / 'page' / 'style.css')}</style>",
        # "<" cannot end the element early, whatever a name in the plan holds.
        "<!--content-->": '<script id="content" type="application/json">'
        + canonical_json(content).replace("<", "\\u003c")
        + "</script>",
        "<!--three-->": f"<!-- three.js\n{licence}-->\n<script>{_vendored()}</script>",
        "<!--scripts-->": scripts,
    }
    text = read_text(_HERE / "page" / "page.html")
    for mark, part in parts.items():
        before, _, after = text.partition(mark)
        text = before + part + after
    return text


def _script(name: str) -> str:
    return read_text(_HERE / "page" / name)


def _vendored() -> str:
    return read_text(_HERE / "vendor" / "three.bundle.min.js").replace("</script", "<\\/script")
