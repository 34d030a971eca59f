"""How fast is a study, by how many processes, and is it the same whoever computes, is killed, or plans by hand?

python bench/study.py --reach 20000 --grow 1000000 --grow-plans 10000 --tasks 100000 --plans 1000 --kills 30

- `--reach`: placements of one board in the shipped cell, by reach. The same study is computed by one process, by two,
  and by Dask clusters of one and of two workers on this machine. Efficiency is the time of one over twice that of two.
  Start-up, which a long study has once, is taken out: each first computes a chunk or two. CPU is that of the scheduler
  and the program, of each chunk, as a share of a chunk's time; what a cluster needs that does nothing is left out, and
  told below.
- `--grow`: the same study by a process per processor, whole, with its start, table and page, of a hundredth of the
  placements, a tenth, and all.
- `--grow-plans`: the same of plans of Task 2, of boards near those of the shipped cell, where nearly all have a plan.
- `--tasks`: so many chunks of one placement, by two processes and by a cluster of two workers; `--dask-alone` leaves
  out the processes.
- `--plans`: points of scenes/where-boards-may-stand.toml, by the stage plan alone. The files of each are written, and
  `a465 plan --no-advice` plans them, two at a time. They disagree if one plans and the other refuses, if time or
  clearance differ, or if a refusal has other words.
- `--kills`: a study by two processes, in which one of these, or the program, is killed with SIGKILL after 1 to 6 s, so
  many times; then it is computed to its end. Its chunks are compared with those of a study that nobody disturbed.
  Lost chunks are those that a kill leaves begun, not finished, and held by no process; they are computed twice.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from run_conditions import run_conditions
from study_processes import abandoned, children, cpu_s, memory_mb, wait_for_end

from arm.io.storage import data_file
from cell.files.observation import observation_to_json
from cell.files.study import read_study
from cell.files.task import read_task
from cell.files.world import read_world
from cell.study.question.scratch import bundle_of, write_point
from cell.study.work.stages import exact_look
from studies.cluster import cluster_here

FAR = {
    "boards[0].centre_mm[0]": (250, 650),
    "boards[0].centre_mm[1]": (-300, 300),
    "boards[0].centre_mm[2]": (30, 150),
    "boards[0].yaw_deg": (-180, 180),
}
NEAR = {
    "boards[0].centre_mm[0]": (455, 465),
    "boards[0].centre_mm[1]": (105, 115),
    "boards[0].yaw_deg": (173, 178),
    "boards[1].centre_mm[1]": (-150, -138),
}
COMMAND = [sys.executable, "-m", "a465", "study"]
CHUNK = 1000  # points of a chunk of reach
_IDLE_S = 15.0


def main() -> None:
    """Run, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--reach", type=int, default=0, help="placements")
    parser.add_argument("--grow", type=int, default=0, help="placements")
    parser.add_argument("--grow-plans", type=int, default=0, help="points that are planned")
    parser.add_argument("--tasks", type=int, default=0, help="chunks of one placement")
    parser.add_argument("--dask-alone", action="store_true")
    parser.add_argument(
        "--plans", type=int, default=0, help="points that are planned, and planned again by hand"
    )
    parser.add_argument("--kills", type=int, default=0)
    options = parser.parse_args()
    print(__doc__)
    print(f"{run_conditions()}\n", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        scenes = Path(shutil.copytree(data_file("scenes"), Path(folder) / "scenes"))
        if options.reach:
            _tell_reach(scenes, options.reach)
        if options.grow:
            _tell_growth("reach", [reach_study(scenes, n) for n in _decades(options.grow)])
        if options.grow_plans:
            _tell_growth("plans", [plan_study(scenes, n) for n in _decades(options.grow_plans)])
        if options.tasks:
            _tell_tasks(scenes, options.tasks, options.dask_alone)
        if options.plans:
            _tell_plans(scenes, options.plans)
        if options.kills:
            _tell_kills(scenes, options.kills)


def reach_study(scenes: Path, points: int, more: str = "") -> Path:
    """A study of placements of one board; `more`: other lines of its file."""
    return _study(scenes / f"reach-{points}.toml", points, more, FAR)


def plan_study(scenes: Path, points: int) -> Path:
    """A study of plans of Task 2 for boards near those of the shipped cell."""
    return _study(scenes / f"plans-{points}.toml", points, 'stages = ["reach", "plan"]\n', NEAR)


def _study(file: Path, points: int, more: str, ranges: Mapping[str, tuple[float, float]]) -> Path:
    vary = [f'[[vary]]\nkey = "{key}"\nfrom = {low}\nto = {high}\n' for key, (low, high) in ranges.items()]
    file.write_text(f'task = "task2.toml"\npoints = {points}\nseed = 1\n{more}' + "".join(vary))
    return file


def _decades(most: int) -> list[int]:
    return [most // 100, most // 10, most]


def _tell_reach(scenes: Path, points: int) -> None:
    print("| computed by | placements | s | ms of each | efficiency | CPU of the others, % | same bytes |")
    print("|---|---|---|---|---|---|---|")
    alone: dict[str, bytes] = {}
    one_s = idle = 0.0
    for name, workers, dask in (
        ("one process", 1, False),
        ("two processes", 2, False),
        ("Dask, one worker", 1, True),
        ("Dask, two workers", 2, True),
    ):
        first = CHUNK * max(workers, 2)
        with _cluster(workers) if dask else contextlib.nullcontext("") as address:
            how = ["--scheduler", address] if dask else ["--workers", str(workers)]
            if dask:
                idle = _idle_share()
            begun = _computed(reach_study(scenes, first), scenes / f"first-{name}", how)
            whole = _computed(reach_study(scenes, points), scenes / f"all-{name}", how)
        took_s, counted = whole.took_s - begun.took_s, points - first
        files = _chunks(scenes / f"all-{name}")
        alone = alone or files
        one_s = took_s if workers == 1 else one_s
        efficiency = f"{100.0 * one_s / (2.0 * took_s):.0f} %" if workers == 2 else ""
        others_s = whole.others_s - begun.others_s - (idle * took_s if dask else 0.0)
        others = 100.0 * others_s / (took_s * workers)
        row = f"| {name} | {points} | {took_s:.1f} | {1e3 * took_s / counted:.2f} | {efficiency} "
        print(f"{row}| {others:.1f} | {files == alone} |", flush=True)
    print(f"\nA scheduler that does nothing takes {100.0 * idle:.1f} % of a core.\n")


def _tell_growth(what: str, files: Sequence[Path]) -> None:
    print(
        f"| {what} | s | ms of each | largest process, MB | program, MB | passed |\n|---|---|---|---|---|---|"
    )
    for file in files:
        folder = file.with_suffix("")
        ran = _computed(file, folder, [])
        with (folder / "table.csv").open() as table:
            rows = [row["ok"] for row in csv.DictReader(table)]
        row = f"| {len(rows)} | {ran.took_s:.0f} | {1e3 * ran.took_s / len(rows):.2f} | {ran.worker_mb:.0f} "
        print(f"{row}| {ran.program_mb:.0f} | {rows.count('1')} |", flush=True)
    print()


def _tell_tasks(scenes: Path, tasks: int, dask_alone: bool) -> None:
    print(
        "| computed by | chunks | s | largest process after 1, 2, 4, 6, 8 tenths and all, MB | program, MB |"
    )
    print("|---|---|---|---|---|")
    file = reach_study(scenes, tasks, "chunk = 1\n")
    for name, dask in (("two processes", False), ("Dask, two workers", True))[dask_alone:]:
        with _cluster(2) if dask else contextlib.nullcontext("") as address:
            how = ["--scheduler", address] if dask else ["--workers", "2"]
            ran = _computed(file, scenes / f"tasks-{name}", how, [tasks * k // 10 for k in (1, 2, 4, 6, 8)])
        grown = ", ".join(f"{mb:.0f}" for mb in (*ran.early_mb, ran.worker_mb))
        print(f"| {name} | {tasks} | {ran.took_s:.0f} | {grown} | {ran.program_mb:.0f} |", flush=True)
    print()


class _Ran(NamedTuple):
    """How long a study took, the CPU of those that do not compute, and the largest memory of processes."""

    took_s: float
    others_s: float
    worker_mb: float
    program_mb: float
    early_mb: tuple[float, ...]


def _computed(file: Path, folder: Path, how: Sequence[str], early: Sequence[int] = ()) -> _Ran:
    """Compute a study; `early`: numbers of chunks after which memory is noted."""
    begun, others_before_s = time.monotonic(), _cluster_s()
    program = subprocess.Popen([*COMMAND, file, "-o", folder, *how], stdout=subprocess.DEVNULL)
    worker_mb = program_mb = own_s = 0.0
    early_mb: list[float] = []
    while program.poll() is None:
        program_mb = max(program_mb, memory_mb(program.pid))
        computing = [*children(program.pid), *children(os.getpid())]
        worker_mb = max([worker_mb, *map(memory_mb, computing)])
        own_s = max(own_s, cpu_s(program.pid))
        if len(early_mb) < len(early) and len(_chunk_files(folder)) >= early[len(early_mb)]:
            early_mb.append(worker_mb)
        time.sleep(1.0 if early else 0.2)
    if program.returncode:
        raise RuntimeError(f"a465 study ended with {program.returncode}")
    others_s = own_s + _cluster_s() - others_before_s
    return _Ran(time.monotonic() - begun, others_s, worker_mb, program_mb, tuple(early_mb))


def _idle_share() -> float:
    """Share of a core that a cluster takes which does nothing."""
    time.sleep(3.0)
    begun_s, before_s = time.monotonic(), _cluster_s()
    time.sleep(_IDLE_S)
    return (_cluster_s() - before_s) / (time.monotonic() - begun_s)


def _cluster_s() -> float:
    """Seconds of CPU of the scheduler, which runs in this process beside the thread that measures."""
    return time.process_time() - time.thread_time()


@contextlib.contextmanager
def _cluster(workers: int) -> Iterator[str]:
    with cluster_here(workers) as cluster:
        yield cluster.scheduler_address


def _chunks(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in _chunk_files(folder)}


def _chunk_files(folder: Path) -> list[Path]:
    return list((folder / "chunks").glob("*.csv"))


def _tell_plans(scenes: Path, points: int) -> None:
    file = scenes / "where-boards-may-stand.toml"
    text = file.read_text().replace("points = 256", f"points = {points}")
    file.write_text(text.replace('stages = ["reach", "look", "plan"]', 'stages = ["plan"]'))
    took_s = _computed(file, scenes / "plans", []).took_s
    print(f"{points} points planned in {took_s:.0f} s, {1e3 * took_s / points:.0f} ms of each", flush=True)
    rows = list(csv.DictReader(io.StringIO((scenes / "plans" / "table.csv").read_text())))
    study = read_study(file)
    bundle = bundle_of(study)

    def agrees(row: dict[str, str]) -> bool:
        with tempfile.TemporaryDirectory() as folder:
            task = write_point(study, bundle, int(row["point"]), Path(folder) / "point")
            world = read_world(task.with_suffix(".world.toml"), read_task(task).cell.marker_size)
            look = task.with_name("look.json")
            seen = observation_to_json(exact_look(read_task(task), world), read_task(task).cell.camera)
            look.write_text(json.dumps(seen))
            command = [
                sys.executable,
                "-m",
                "a465",
                "plan",
                str(task),
                "--look",
                str(look),
                "--no-advice",
                "--json",
            ]
            ran = subprocess.run(
                [*command, "-o", str(task.with_name("plan.json"))],
                capture_output=True,
                text=True,
                check=False,
            )
            return _agree(row, ran, f"{task.parent}{os.sep}")

    with ThreadPoolExecutor(2) as two:
        differ = [row["point"] for row, same in zip(rows, two.map(agrees, rows), strict=True) if not same]
    planned = sum(row["ok"] == "1" for row in rows)
    print(f"{planned} have a plan; {len(differ)} of {points} disagree with a465 plan {differ}\n", flush=True)


def _agree(row: dict[str, str], ran: subprocess.CompletedProcess[str], folder: str) -> bool:
    found = json.loads(ran.stdout)
    if row["ok"] != "1":
        words = " ".join(found["error"]["message"].replace(folder, "").split())
        return ran.returncode == 3 and words.startswith(row["detail"].removesuffix("..."))
    if ran.returncode:
        return False
    of_row = [float(row[name]) for name in ("motion_s", "clearance_mm")]
    return np.allclose(of_row, [found["motion_s"], found["min_clearance_mm"]], rtol=0.0, atol=1e-5)


def _tell_kills(scenes: Path, kills: int) -> None:
    rng = np.random.default_rng(1)
    file, folder = reach_study(scenes, 40 * CHUNK), scenes / "killed"
    _computed(file, scenes / "undisturbed", ["--workers", "2"])
    killed: list[_Killed] = []
    while len(killed) < kills:
        command = [*COMMAND, str(file), "-o", str(folder), "--workers", "2"]
        program = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        killer = threading.Thread(target=_kill, args=(program, folder, rng, kills - len(killed), killed))
        killer.start()
        program.wait()
        killer.join()
        if program.returncode == 0:  # again from a third of its chunks
            for path in sorted(_chunk_files(folder))[::3]:
                path.unlink()
    subprocess.run([*COMMAND, file, "-o", folder], check=True, stdout=subprocess.DEVNULL)
    same = _chunks(folder) == _chunks(scenes / "undisturbed")
    print(
        "| killed | times | chunks lost, together | at most, of one kill |\n|---|---|---|---|\n"
        + "".join(
            f"| {what} | {len(lost)} | {sum(lost)} | {max(lost, default=0)} |\n"
            for what in ("process", "program")
            for lost in [[one.lost for one in killed if one.what == what]]
        )
        + f"\nsame bytes {same}",
        flush=True,
    )


class _Killed(NamedTuple):
    """What was killed, and how many chunks have to be computed again."""

    what: str
    lost: int


def _kill(
    program: subprocess.Popen[bytes], folder: Path, rng: np.random.Generator, most: int, killed: list[_Killed]
) -> None:
    """Kill processes of a program, or itself, until it ends."""
    for _ in range(most):
        time.sleep(float(rng.uniform(1.0, 6.0)))
        computing = children(program.pid)
        if program.poll() is not None:
            return
        before = abandoned(folder)
        if rng.random() < 0.5 or not computing:
            program.kill()
            wait_for_end(computing)  # each finishes what it is at
            killed.append(_Killed("program", len(abandoned(folder) - before)))
            return
        victim = int(rng.choice(computing))
        with contextlib.suppress(OSError):
            os.kill(victim, signal.SIGKILL)
            wait_for_end([victim])
            killed.append(_Killed("process", len(abandoned(folder) - before)))


if __name__ == "__main__":
    main()
