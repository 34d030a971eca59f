"""``report.html`` of a run: the task, the result of every cube, images, plans and provenance."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2

from arm.errors import InputError
from arm.plan_file import Plan
from cell.accuracy.budget_report import HEADER, budget_rows
from cell.accuracy.picture import budget_pictures
from cell.accuracy.placement import PlacementBudget
from cell.accuracy.plan_budgets import pocket_fit
from cell.files.task import Task
from cell.report.html import Table, render

_WIDTH, _QUALITY = 960, 82  # of an image in the page: px, and JPEG quality
_HEADER = ("cube", "from", "to", "placed", "planned s", "clearance mm", "error mm", "tilt deg", "remarks")
_PLAN_HEADER = ("file", "cubes", "motion s", "clearance mm", "hash")


@dataclass(frozen=True)
class Picture:
    """The first image of a look, with the detections drawn in.

    Attributes:
        why: reason of the look.
        file: PNG beside the report.
    """

    why: str
    file: Path


@dataclass(frozen=True)
class KeptPlan:
    """A plan that was made or executed in the run; `name` is that of its file, without suffix."""

    name: str
    plan: Plan


def run_page(
    task: Task,
    report: dict[str, Any],
    pictures: Sequence[Picture],
    plans: Sequence[KeptPlan],
    began: datetime,
    ended: datetime,
    budgets: Sequence[PlacementBudget] = (),
) -> str:
    """Return the page's text, self-contained.

    Args:
        task: task of the run.
        report: content of ``report.json``.
        pictures: images of the looks, in order.
        plans: plans of the run, in order.
        began, ended: times of the host's clock.
        budgets: predicted errors of the placements, in order.
    """
    cubes, error = report["cubes"], report.get("error")
    placed = sum(cube["placed"] for cube in cubes)
    wanted = max(len(cubes), report["cubes_planned"])
    good = error is None and placed == wanted
    figures = [
        *([(f"{placed} of {wanted}", "cubes placed")] if wanted else []),
        *([(f"{report['motion_s']:.1f} s", "of planned motion")] if report["motion_s"] else []),
        *_extreme(cubes, "min_clearance_mm", min, "mm least clearance", 1),
        *_extreme(cubes, "error_mm", max, "mm largest error (truth)", 3),
        *_extreme(cubes, "tilt_error_deg", max, "deg largest tilt (truth)", 3),
        *((str(wire["touches"]), f"touches of wire {wire['wire']} (truth)") for wire in report["wires"]),
        *_extreme(report["wires"], "least_mm", min, "mm from ring to wire (truth)", 1),
    ]
    previews = [k.name.replace("plan", "preview") + ".html" for k in plans if k.name.startswith("plan")]
    cell = task.cell
    provenance = [
        ("task file", task.file.name),
        ("cell file", cell.file.name),
        ("camera file", cell.camera_file.name),
        ("hand-eye calibration", "none" if cell.calibration is None else cell.calibration.id),
        ("arm's shape", cell.arm_shape()),
        ("task and cell", task.digest[:12]),
    ]
    return render(
        "report/templates/run.html.j2",
        title=f"{task.name} · a465",
        task=task,
        report=report,
        good=good,
        verdict="done" if good else (error["word"] if error else "not done"),
        error=error,
        began=began,
        ended=ended,
        figures=figures,
        cubes=Table(_HEADER, [_row(number, cube) for number, cube in enumerate(cubes, start=1)]),
        looks=[_look(picture) for picture in pictures],
        plans=Table(_PLAN_HEADER, [_plan_row(kept) for kept in plans]),
        previews=previews,
        budgets=Table(HEADER, budget_rows(budgets)),
        boards=budget_pictures(cell.boards, budgets, pocket_fit(cell)),
        provenance=Table(("what", "value"), provenance),
        details=_details(plans),
    )


def _extreme(
    cubes: Sequence[dict[str, Any]], key: str, of: Any, name: str, decimals: int
) -> Iterator[tuple[str, str]]:
    values = [cube[key] for cube in cubes if cube[key] is not None]
    if values:
        yield _shown(of(values), decimals), name


def _row(number: int, cube: dict[str, Any]) -> Sequence[str]:
    return (
        str(number),
        cube["from"],
        cube["to"],
        "yes" if cube["placed"] else "NO",
        _shown(cube["motion_s"], 1),
        _shown(cube["min_clearance_mm"], 1),
        _shown(cube["error_mm"], 3),
        _shown(cube["tilt_error_deg"], 3),
        "; ".join(cube["remarks"]),
    )


def _shown(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _look(picture: Picture) -> dict[str, str]:
    """Return the reason of a look, and its image (JPEG, base 64) or why there is none."""
    if not picture.file.is_file():
        return {"why": picture.why, "jpeg": "", "fault": "The look was not finished."}
    image = cv2.imread(str(picture.file), cv2.IMREAD_COLOR)
    if image is None:
        return {"why": picture.why, "jpeg": "", "fault": f"{picture.file.name} cannot be read"}
    scale = min(1.0, _WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    made, coded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not made:
        raise InputError(f"{picture.file}: cannot be encoded for the report", file=str(picture.file))
    return {"why": picture.why, "jpeg": base64.b64encode(coded.tobytes()).decode(), "fault": ""}


def _plan_row(kept: KeptPlan) -> Sequence[str]:
    return (
        f"{kept.name}.json",
        str(len(kept.plan.task["cubes"])),
        f"{kept.plan.duration_s:.1f}",
        f"{1e3 * min((m.clearance for m in kept.plan.moves), default=0.0):.1f}",
        kept.plan.sha256[:12],
    )


def _details(plans: Sequence[KeptPlan]) -> list[tuple[str, Table]]:
    """Return titles and tables of what the last plan depends on."""
    last = plans[-1].plan if plans else None
    found = [] if last is None else [*_flat(last.provenance), *_flat(last.notes, "notes")]
    inputs = [(key.removeprefix("inputs."), v) for key, v in found if key.startswith("inputs.")]
    others = [(key, v) for key, v in found if not key.startswith("inputs.")]
    header = ("key", "value")
    return [
        ("Provenance of the plan", Table(header, others)),
        ("Values of the input files", Table(header, inputs)),
    ]


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else key)
    else:
        text = str(value)
        yield path, text[:12] if len(text) == 64 else text
