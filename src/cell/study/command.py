"""``a465 study``."""

from __future__ import annotations

import csv
import io
import os
import shlex
import time
from collections.abc import Iterable, Iterator, Sequence, Set
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.io.storage import canonical_json, write_atomic
from cell.commands.steps import look_step, plan_step
from cell.console import Console
from cell.files.observation import observation_to_json
from cell.files.study import Study, read_study
from cell.files.task import read_task
from cell.files.world import read_world
from cell.study.answer.answers import Best, best_of, columns, influences, read_points, shares, shown, unsaid
from cell.study.answer.page import study_page
from cell.study.question.points import points_of
from cell.study.question.scratch import Bundle, bundle_of, write_point
from cell.study.work.chunks import FOLDER, Chunk, Store, chunks_of
from cell.study.work.engine import AnyExecutor, InThisProcess, Lane, OneProcess, Work, compute_all
from cell.study.work.stages import exact_look

TABLE, PAGE = "table.csv", "study.html"
_MOST_NAMED = 5  # chunks in a line
_LINE_S = 60.0  # between two lines of progress where there is no terminal


def study_step(
    file: Path,
    folder: Path | None,
    workers: int | None,
    scheduler: str | None,
    best: Path | None,
    console: Console,
) -> dict[str, Any]:
    """Compute what is left of a study, and write its table and page.

    Args:
        file: study file.
        folder: of its results; None: one named after the file, in the present folder.
        workers: processes; 0: this one alone; None: one per processor.
        scheduler: address of a Dask scheduler, whose workers compute; None: processes of this machine.
        best: new folder for the files of the best point; None: none.
        console: for output.

    Raises:
        InputError: a file, a value or an option is wrong.
        ImpossibleError: no point passed, and `best` was asked for.
        ExecutionStopped: chunks were skipped, because the processes that computed them died.
    """
    study = read_study(file)
    if best is not None and best.exists():
        raise InputError(f"{best}: is there already; give a new folder", file=str(best))
    folder = Path(f"study-{file.stem}") if folder is None else folder
    _require_own(folder)
    with console.doing("reading the study's files"):
        bundle = bundle_of(study)
    store, chunks = Store(folder), chunks_of(study, bundle)
    console.say(f"{study.count} points in {_chunks(len(chunks))}: {', '.join(study.stages)}")
    with _lanes(study, bundle, folder, workers, scheduler, len(chunks)) as lanes:
        try:
            work = compute_all(chunks, store, lanes, _Progress(study, len(chunks), console))
        except KeyboardInterrupt:
            there = sum(map(store.has, chunks))
            console.say(
                f"{there} of {_chunks(len(chunks))} are in {store.folder}; the same command goes on with the rest"
            )
            raise
    if work.found:
        console.say(f"{_chunks(work.found)} {_were(work.found)} there already")
    if work.lost:
        console.say(f"{work.lost} processes died; their chunks were computed again, once each")
    aside = {chunk.number for chunk in work.aside}
    result = _tell(study, file, bundle, folder, store, chunks, aside, console, best)
    if aside:
        why = next(iter(work.failed.values()), "their processes died")
        points = ", ".join(f"{c.first} to {c.first + c.count - 1}" for c in work.aside[:_MOST_NAMED])
        points += ", ..." if len(work.aside) > _MOST_NAMED else ""
        raise ExecutionStopped(
            f"{_chunks(len(aside))} {_were(len(aside))} skipped ({why}): points {points}; the same command tries "
            f"{'it' if len(aside) == 1 else 'them'} again",
            reason="aside",
            points=[[c.first, c.count] for c in work.aside],
        )
    if best is not None and result["best"] is None:
        raise ImpossibleError("no point passed, so there is no most robust point to write")
    return result


def _require_own(folder: Path) -> None:
    """Refuse a file, and a folder with a table or page that no study wrote: they would be replaced."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; give a folder for the results", file=str(folder))
    for path in (folder / TABLE, folder / PAGE):
        if path.exists() and not (folder / FOLDER).is_dir():
            why = f"{path}: is there already, and no study wrote it; give another folder"
            raise InputError(why, file=str(path))


def point_step(file: Path, number: int, folder: Path | None, console: Console) -> dict[str, Any]:
    """Write the files of one point of a study, and plan it as `a465 plan` does.

    Raises:
        InputError: a file or the number is wrong, or the folder is there.
        ImpossibleError: there is no plan; the files are written.
    """
    study = read_study(file)
    folder = Path(f"study-{file.stem}-{number}") if folder is None else folder
    task_file = write_point(study, bundle_of(study), number, folder)
    for one, value in zip(study.vary, points_of(study, number, 1)[0], strict=True):
        console.say(f"{one.name}: {value}")
    console.say(f"files written to {folder}; the task is {task_file}")
    look, world_file = folder / "look.json", _beside(study, task_file)
    if "look" in study.stages:
        look_step(task_file, None, world_file, look, None, console)
    else:
        task = read_task(task_file)
        world = read_world(world_file, task.cell.marker_size)
        seen = observation_to_json(exact_look(task, world), task.cell.camera)
        write_atomic(look, canonical_json(seen) + "\n")
    planned = plan_step(task_file, look, folder / "plan.json", None, console)
    return {"point": number, "task": str(task_file), "look": str(look), **planned}


def _beside(study: Study, task_file: Path) -> Path:
    """The world file of a study, where its task file was written anew."""
    return Path(os.path.normpath(task_file.parent / os.path.relpath(study.world, study.task.parent)))


@contextmanager
def _lanes(
    study: Study, bundle: Bundle, folder: Path, workers: int | None, scheduler: str | None, chunks: int
) -> Iterator[list[Lane]]:
    if scheduler is None:
        count = min(chunks, os.cpu_count() or 1 if workers is None else workers)
        lanes: list[Lane] = [OneProcess(bundle, folder) for _ in range(count)]
        yield lanes or [InThisProcess(bundle, folder)]
        return
    if workers is not None:
        raise InputError(
            "--workers: must be left out with --scheduler, whose workers compute", option="workers"
        )
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        why = "--scheduler: needs the extra study: pip install 'a465[study]'"
        raise InputError(why, option="scheduler") from error
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--scheduler {scheduler}: {error}", option="scheduler") from error
    with client:
        processes = client.ncores()  # of each worker
        start = f"dask worker {scheduler} --nthreads 1 --nworkers {os.cpu_count() or 1}"
        if not processes:
            why = f"--scheduler {scheduler}: has no worker; start some: {start}"
            raise InputError(why, option="scheduler")
        if max(processes.values()) > 1:
            why = (
                f"--scheduler {scheduler}: has a worker with several threads, of which one computes: {start}"
            )
            raise InputError(why, option="scheduler")
        executor = client.get_executor(pure=False)

        def connected() -> int:
            try:
                return len(client.ncores())
            except (
                OSError,
                TimeoutError,
            ):  # the scheduler does not answer: no worker can be asked for either
                return 0

        yield [AnyExecutor(executor, bundle, connected, (KilledWorker,))]


class _Progress:
    """Shows how far a study is, its rate, and the time that is left; in a file or a pipe a line a minute."""

    def __init__(self, study: Study, chunks: int, console: Console) -> None:
        self._study, self._chunks, self._console = study, chunks, console
        self._began = self._told_s = time.monotonic()

    def __call__(self, work: Work) -> None:
        done = work.found + work.done
        now = time.monotonic()
        took_s = now - self._began
        hint = ""
        if work.done and took_s > 0.0:
            rate = work.done * self._study.chunk / took_s
            left_s = (self._chunks - done - len(work.aside)) * took_s / work.done
            hint = f"{rate:.3g} points/s, {_duration(left_s)} left"
        if work.aside:
            hint += f", {_chunks(len(work.aside))} skipped"
        if self._console.at_terminal:
            self._console.progress("study", done / max(1, self._chunks), hint)
        elif now - self._told_s >= _LINE_S:
            self._told_s = now
            self._console.step(
                f"{done} of {_chunks(self._chunks)}, {hint.removeprefix(', ') or 'none computed yet'}"
            )


def _chunks(count: int) -> str:
    return "1 chunk" if count == 1 else f"{count} chunks"


def _were(count: int) -> str:
    return "was" if count == 1 else "were"


def _duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def _write_table(path: Path, study: Study, tables: Iterable[str]) -> None:
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(columns(study))
    write_atomic(path, chain([head.getvalue()], tables))


def _tell(
    study: Study,
    file: Path,
    bundle: Bundle,
    folder: Path,
    store: Store,
    chunks: Sequence[Chunk],
    aside: Set[int],
    console: Console,
    best_folder: Path | None,
) -> dict[str, Any]:
    with console.doing("reading the results"):
        there = [chunk for chunk in chunks if chunk.number not in aside]
        _write_table(folder / TABLE, study, map(store.read, there))
        points = read_points(study, ((c, None if c.number in aside else store.read(c)) for c in chunks))

        def values_of(number: int) -> tuple[Any, ...]:
            return points_of(study, number, 1)[0]

        best, matters = best_of(study, points, values_of), influences(study, points)
        write_atomic(folder / PAGE, study_page(study, points, best, matters, values_of, str(file)))
    passed = int(points.ok.sum())
    console.say(f"{passed} of {len(points.ok)} points passed")
    reasons = shares(points)
    if reasons:
        console.table(("reason", "points", "%"), [(why, n, 100.0 * share) for why, n, share in reasons])
    if matters:
        console.say()
        console.table(
            ("value", "sensitivity index", "95 % from", "to"),
            [(one.name, one.share, one.low, one.high) for one in matters],
        )
    if words := unsaid(study, points, matters):
        console.say(words)
    if best is not None:
        console.say(
            f"\nmost robust: point {best.number}; between these values no computed point was refused:"
        )
        rows = [(one.name, *shown(one, best, k)) for k, one in enumerate(study.vary)]
        console.table(("value", "most robust", "from", "to"), rows)
    if best_folder is not None and best is not None:
        task = write_point(study, bundle, best.number, best_folder)
        named, look = (shlex.quote(str(one)) for one in (task, best_folder / "look.json"))
        console.say(
            f"its task: {task}\nplan it: a465 look {named} -o {look} && a465 plan {named} --look {look}"
        )
    console.say(f"table: {folder / TABLE}\npage: {folder / PAGE}")
    return {
        "points": len(points.ok),
        "passed": passed,
        "reasons": {why: n for why, n, _ in reasons},
        "influence": {one.name: [one.share, one.low, one.high] for one in matters},
        "best": None if best is None else _best_json(study, best),
        "table": str(folder / TABLE),
        "page": str(folder / PAGE),
    }


def _best_json(study: Study, best: Best) -> dict[str, Any]:
    names = [varied.name for varied in study.vary]
    return {
        "point": best.number,
        "values": dict(zip(names, best.values, strict=True)),
        "between": dict(zip(names, best.between, strict=True)),
    }
