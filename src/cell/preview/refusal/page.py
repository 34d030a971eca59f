"""The page of a refusal to plan: the arm at the nearest miss, with both bodies in red, or the place out of reach."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from arm.controller.segments import CountPath, Segment
from arm.errors import A465Error, ImpossibleError
from arm.io.outputs import keep_page
from arm.io.storage import keep_unread, write_atomic
from arm.plan_file import Move
from cell.preview.content import page_content
from cell.preview.of_place import Shown, place_shown
from cell.preview.overlays import pose_numbers, shape_numbers
from cell.preview.page import page
from cell.preview.refusal.misses import Miss, at_start, misses_of
from plan.program.goals.attachments import AttachmentState
from plan.program.planned import Planned

SEEN = {"board", "hole", "below_mm"}  # data of refusals of what was seen
SHOWN_MS = 1000  # each miss on the page's clock


@contextmanager
def refusal_shown(output: Path, file: Path, look: Path | None, plan: Path | None = None) -> Iterator[None]:
    """Write a page if what is done inside is refused, and say in the refusal where it is.

    Args:
        output: page to write.
        file: task, program, cell or arm file that is planned.
        look: boards and cubes that were detected.
        plan: that is written inside.

    Raises:
        InputError: the page would replace one of these files.
    """
    keep_page(output, file, look, plan)
    keep_unread(output)
    try:
        yield
    except ImpossibleError as error:
        try:
            write_refusal(error, file, look, output)
        except A465Error as wrong:
            raise ImpossibleError(f"{error}; it is not shown: {wrong}", **error.data) from wrong
        raise ImpossibleError(f"{error}; {output} shows it", **{**error.data, "page": str(output)}) from error


def write_refusal(error: ImpossibleError, file: Path, look: Path | None, output: Path) -> None:
    """Write the page of a refusal."""
    place = place_shown(file, look, whole=False)
    advice = [str(piece["text"]) for piece in error.data.get("advice", ())]
    misses = misses_of(error, place.setting, place.q_start, place.known)
    looked = bool(SEEN & error.data.keys())
    write_atomic(output, refusal_page(str(error), file.stem, place, misses, advice, looked))


def refusal_page(
    what: str,
    title: str,
    place: Shown,
    misses: Sequence[Miss],
    advice: Sequence[str] = (),
    looked: bool = False,
) -> str:
    """Return a refusal as HTML text. The same input gives the same text.

    Args:
        what: the refusal, in words.
        title: of the page.
        place: what is drawn around the misses.
        misses: to show; the first is shown at once. If there are none, the arm is at q_start.
        advice: what would help.
        looked: whether it shows what the camera sees.
    """
    setting, q_start = place.setting, place.q_start
    misses = misses or [at_start(what, setting, q_start)]
    unit, moves = setting.unit, list[Move]()
    for miss in misses:
        counts = tuple(unit.counts(miss.q).tolist())
        rest = CountPath(counts, (Segment(SHOWN_MS, ((0,) * len(counts),) * 3),))
        moves.append(Move(miss.name, "transit", None, rest, None, 0.0, 0.0, ("", "")))
    nothing = AttachmentState(None, None, ())
    planned = Planned(setting, q_start, q_start, tuple(moves), (), 0.0, nothing, task={"name": title})
    opened, holding = setting.scene.robot_open, setting.scene.robot_holding
    other = next((m.robot for m in misses if m.robot.digest not in (opened.digest, holding.digest)), None)
    content = page_content(planned.plan(), other or opened, other or holding, unit, **place.drawn)
    for step, miss in zip(content["steps"], misses, strict=True):
        closed = float(miss.robot.digest == holding.digest != opened.digest)
        held = next((body.name for body, _, in_tool in miss.cubes if in_tool), None)
        step |= {"jaws": [closed, closed], "held": held, "clearance": None}
    shown = {"misses": [miss.to_json() for miss in misses], "cubes": _cubes(misses)}
    return page({**content, "what": what, "advice": list(advice), "looked": looked, **shown})


def _cubes(misses: Sequence[Miss]) -> list[dict[str, Any]]:
    """Return the cubes of all misses for the page; one that is not there has no pose for that time."""
    bodies = {body.name: body for miss in misses for body, _, _ in miss.cubes}
    tracks: dict[str, list[dict[str, Any]]] = {name: [] for name in bodies}
    for number, miss in enumerate(misses):
        there = {body.name: (T, held) for body, T, held in miss.cubes}
        for name, track in tracks.items():
            T, held = there.get(name, (None, False))
            start = number * SHOWN_MS / 1e3
            track.append({"start": start, "held": held, "T": None if T is None else pose_numbers(T)})
    return [
        {"name": name, "shape": shape_numbers(b.shape), "padding": b.padding, "track": tracks[name]}
        for name, b in bodies.items()
    ]
