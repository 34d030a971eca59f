"""``report.html`` of a run: the task, the result of every cube, images, plans and provenance."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path
from typing import Any

import cv2

from arm.errors import InputError
from arm.plan_file import Plan
from cell.files.task import Task
from cell.report.html import bullets, page, section, table
from cell.scene.arm_shape import arm_shape

_WIDTH, _QUALITY = 960, 82  # of an image in the page: px, and JPEG quality
_HEADER = ("cube", "from", "to", "placed", "planned s", "clearance mm", "error mm", "tilt deg", "remarks")


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
) -> str:
    """Return the page's text, self-contained.

    Args:
        task: the task of the run.
        report: content of ``report.json``.
        pictures: in order.
        plans: in order.
        began, ended: by the host's clock.
    """
    return page(
        f"{task.name} · a465",
        [
            _heading(task, report, began, ended),
            section(
                "Cubes",
                table(_HEADER, _rows(report["cubes"])) if report["cubes"] else "<p>No cube was moved.</p>",
            ),
            _remarks(report),
            *_pictures(pictures),
            section("Plans", _plans(plans)),
            section("Provenance", _provenance(task, plans)),
        ],
    )


def _heading(task: Task, report: dict[str, Any], began: datetime, ended: datetime) -> str:
    cubes = report["cubes"]
    placed = sum(cube["placed"] for cube in cubes)
    error = report.get("error")
    wanted = max(len(cubes), report["cubes_planned"])
    good = error is None and placed == wanted
    verdict = "done" if good else (error["word"] if error else "not done")
    where = f"simulated cell, time scale {report['time_scale']:g}" if report["simulated"] else "real cell"
    lowered = f", override {report['override']:g}" if report["override"] < 1.0 else ""
    figures = [
        *([(f"{placed} of {wanted}", "cubes placed")] if wanted else []),
        (f"{report['motion_s']:.1f} s", "of planned motion"),
        *_extreme(cubes, "min_clearance_mm", min, "mm least clearance", 1),
        *_extreme(cubes, "error_mm", max, "mm largest error (truth)", 3),
        *_extreme(cubes, "tilt_error_deg", max, "deg largest tilt (truth)", 3),
    ]
    shown = "".join(f"<div><b>{value}</b>{escape(name)}</div>" for value, name in figures)
    message = "" if error is None else f"<p><b>{escape(error['message'])}</b></p>"
    return section(
        "",
        f'<h1>{escape(task.name)} <span class="badge{"" if good else " no"}">{escape(verdict)}</span></h1>'
        f'<p class="muted">{escape(task.kind)} · {escape(report["unit"])} · {where} · speed {report["speed"]:g}'
        f"{lowered} · {began:%Y-%m-%d %H:%M:%S} to {ended:%H:%M:%S}</p>{message}"
        f'<div class="figures">{shown}</div>',
    )


def _extreme(
    cubes: Sequence[dict[str, Any]], key: str, of: Any, name: str, decimals: int
) -> Iterator[tuple[str, str]]:
    values = [cube[key] for cube in cubes if cube[key] is not None]
    if values:
        yield f"{of(values):.{decimals}f}", name


def _rows(cubes: Sequence[dict[str, Any]]) -> Iterator[tuple[str, Sequence[str]]]:
    for number, cube in enumerate(cubes, start=1):
        yield (
            "",
            (
                str(number),
                cube["from"],
                cube["to"],
                "yes" if cube["placed"] else "NO",
                f"{cube['motion_s']:.1f}",
                _shown(cube["min_clearance_mm"], 1),
                _shown(cube["error_mm"], 3),
                _shown(cube["tilt_error_deg"], 3),
                "; ".join(cube["remarks"]),
            ),
        )


def _shown(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _remarks(report: dict[str, Any]) -> str:
    return section("", bullets(report["remarks"], "Remarks")) if report["remarks"] else ""


def _pictures(pictures: Sequence[Picture]) -> list[str]:
    shown = [_figure(number, picture) for number, picture in enumerate(pictures, start=1)]
    return [section("Images", f'<div class="looks">{"".join(shown)}</div>')] if shown else []


def _figure(number: int, picture: Picture) -> str:
    caption = f"<figcaption>Look {number}: {escape(picture.why)}</figcaption>"
    if not picture.file.is_file():
        return f"<figure>{caption}<p>The look was not finished.</p></figure>"
    image = cv2.imread(str(picture.file), cv2.IMREAD_COLOR)
    if image is None:
        return f"<figure>{caption}<p>{escape(picture.file.name)} cannot be read</p></figure>"
    scale = min(1.0, _WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    made, coded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not made:
        raise InputError(f"{picture.file}: cannot be encoded for the report", file=str(picture.file))
    data = base64.b64encode(coded.tobytes()).decode()
    return f'<figure><img alt="look {number}" src="data:image/jpeg;base64,{data}">{caption}</figure>'


def _plans(plans: Sequence[KeptPlan]) -> str:
    if not plans:
        return "<p>No plan was made.</p>"
    rows = [
        (
            "",
            (
                f"{kept.name}.json",
                str(len(kept.plan.task["cubes"])),
                f"{kept.plan.duration_s:.1f}",
                f"{1e3 * min((m.clearance for m in kept.plan.moves), default=0.0):.1f}",
                kept.plan.sha256[:12],
            ),
        )
        for kept in plans
    ]
    pages = [kept.name.replace("plan", "preview") + ".html" for kept in plans if kept.name.startswith("plan")]
    links = " · ".join(f'<a href="{escape(name)}">{escape(name)}</a>' for name in pages)
    return table(("file", "cubes", "motion s", "clearance mm", "hash"), rows) + (
        f"<p>3D previews beside this file: {links}</p>" if links else ""
    )


def _provenance(task: Task, plans: Sequence[KeptPlan]) -> str:
    cell = task.cell
    calibration = "none" if cell.calibration is None else cell.calibration.id
    known = [
        ("task file", task.file.name),
        ("cell file", cell.file.name),
        ("camera file", cell.camera_file.name),
        ("hand-eye calibration", calibration),
        ("arm's shape", arm_shape(cell)),
        ("task and cell", task.digest[:12]),
    ]
    last = plans[-1].plan if plans else None
    rest = [] if last is None else [*_flat(last.provenance), *_flat(last.notes, "notes")]
    inputs = [row for row in rest if row[0].startswith("inputs.")]
    others = [row for row in rest if row not in inputs]
    keys = [(key.removeprefix("inputs."), value) for key, value in inputs]
    return table(("what", "value"), [("", row) for row in known]) + "".join(
        f"<details><summary>{summary}</summary>{table(('key', 'value'), [('', row) for row in rows])}</details>"
        for summary, rows in (("Provenance of the plan", others), ("Values of the input files", keys))
        if rows
    )


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else key)
    else:
        text = str(value)
        yield path, text[:12] if len(text) == 64 else text
