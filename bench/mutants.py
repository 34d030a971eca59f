"""Do the tests do their work? Mutants of the safety modules, and how many of them make a test fail.

python bench/mutants.py --jobs 2                  # all that were not tried yet
python bench/mutants.py --package plan --only subdivision   # names that hold the word
python bench/mutants.py --check                   # only whether every mutant still stands where it stood
python bench/mutants.py --draw 220                # draw the list bench/mutants_bench/drawn.json anew
python bench/mutants.py --draw 100 --seed 2 --into drawn-2.json  # others: how much is seen by tests not made for it

Each mutant is one change of one file, made in a copy of the project. Of its module's tests (`mutants_bench.tests_of`)
those that reach the changed line run, the fastest first, up to the first red one or a budget; --budget-s 1000 takes all
of them. Results go to bench/results/mutants.jsonl, a line each: a run that was ended goes on where it was. Red counts
as long as the test that saw it is there, green as long as the change and the text of its tests are the same.
"""

from __future__ import annotations

import argparse
import atexit
import json
import os
import platform
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TypedDict

sys.path.insert(0, str(Path(__file__).resolve().parent))

from mutants_bench.by_hand import BY_HAND
from mutants_bench.choice import Reached, choose, reached
from mutants_bench.mutant import FOUND, Mutant, read_list, write_list
from mutants_bench.operators import drawn
from mutants_bench.tests_of import located, tests_of
from mutants_bench.trial import GREEN, LATE, RED, ROOT, SKIPPED, Outcome, Trial

from arm.io.storage import sha256

SAFETY = {
    "driver": (
        "mars/stopping",
        "line/link",
        "execution/stream",
        "execution/stream_run",
        "mars/mars",
        "execution/pause",
        "mars/homing",
        "mars/gripper",
        "mars/startup",
        "mars/refusals",
        "mars/ready",
        "line/transport",
        "line/echo",
        "execution/feed",
        "mars/lookahead",
        "execution/path_watch",
        "line/manners",
        "line/unit_time",
        "mars/identity",
        "execution/polls",
        "mars/running",
        "execution/preload",
        "mars/registers",
        "mars/absolute_move",
    ),
    "plan": (
        "collision/certificate",
        "collision/subdivision",
        "collision/bounds",
        "verify",
        "cartesian/collision_barrier",
        "collision/world",
        "collision/separation",
        "trajectory/integer_segments",
        "motion/builder",
        "program/writer",
        "program/planned",
        "program/recovery",
        "program/setting",
        "program/stated_arm",
        "program/go_to",
        "program/grammar",
        "program/aim",
        "program/goals/attachments",
        "program/goals/target",
        "program/goals/leg_times",
        "program/goals/blending",
        "program/goals/freedom",
        "program/goals/line_chains",
        "program/sequence/planner",
        "program/sequence/search",
        "program/sequence/candidates",
        "program/sequence/times",
        "program/sequence/refusals",
        "program/sequence/layers",
        "program/assignment/legs",
        "program/assignment/search",
        "program/assignment/sequencing",
        "program/assignment/order_bound",
        "program/assignment/edge_checks",
        "program/assignment/leg_costs",
        "program/assignment/found",
        "program/assignment/worlds",
        "program/assignment/planner",
        "transit/planner",
        "transit/near_ends",
        "transit/straight",
        "transit/proofs",
        "transit/rrt_connect",
        "transit/shortcuts",
        "transit/optimise",
    ),
    "cell": (
        "task/plan_matches",
        "task/approval",
        "config/inputs",
        "config/arm_file",
        "task/resume",
        "session/dialogue",
        "session/homed",
        "task/free_cell",
        "files/board_shift",
        "session/grasp_monitor",
        "cubes/confirm_placed",
    ),
    "arm": (
        "controller/unit",
        "plan_file",
    ),
}
LISTS = Path(__file__).parent / "mutants_bench"
RESULTS = Path(__file__).parent / "results" / "mutants.jsonl"
GOAL = 0.92


def draw(count: int, seed: int) -> list[Mutant]:
    """Mutants of all safety modules, as many from each as its number of lines asks for."""
    modules = [f"{package}/{name}.py" for package, names in SAFETY.items() for name in names]
    sources = {file: (ROOT / "src" / file).read_text() for file in modules}
    whole = sum(text.count("\n") ** 0.5 for text in sources.values())
    found: list[Mutant] = []
    for file, text in sources.items():
        share = round(count * text.count("\n") ** 0.5 / whole)
        found += drawn(file, text, max(share, 3), seed)
    return found


def drawn_lists(only: str | None = None) -> dict[str, list[Mutant]]:
    """Mutants that operators drew, by the list's file."""
    files = sorted(LISTS.glob("drawn*.json"))
    return {file.name: read_list(file) for file in files if only in (None, file.name)}


class Row(TypedDict):
    """The result of one mutant, a line of `RESULTS`."""

    digest: str
    tests_digest: str
    name: str
    file: str
    result: str
    tests: int
    seen_by: str
    seconds: float


def _known() -> dict[str, list[Row]]:
    """Results by the digest of what is changed, the newest last."""
    known: dict[str, list[Row]] = defaultdict(list)
    if RESULTS.is_file():
        for line in RESULTS.read_text().splitlines():
            if line.endswith("}"):
                row: Row = json.loads(line)
                known[row["digest"]].append(row)
    return known


def _tests_digest(tests: Sequence[str]) -> str:
    return sha256([(ROOT / "tests" / name).read_text() for name in tests])[:20]


def _holding(mutant: Mutant, known: dict[str, list[Row]]) -> Row | None:
    """The result that still holds: red while the test that saw it is there, green while its tests are the same."""
    for row in reversed(known.get(mutant.digest, [])):
        file, _, test = row["seen_by"].removeprefix("tests/").partition("::")
        there = located([file], ROOT / "tests") if test else ()
        if row["result"] == LATE:
            return row
        if row["result"] == RED and any(
            f"def {test.partition('[')[0]}(" in (ROOT / "tests" / name).read_text() for name in there
        ):
            return row
        ended = row["result"] == RED and not test  # what it breaks has ended pytest itself
        if (row["result"] == GREEN or ended) and row["tests_digest"] == _tests_digest(mutant.tests):
            return row
    return None


class Worker:
    """One process with a copy of its own."""

    def __init__(self, budget_s: float, marks: str) -> None:
        self.trial, self.budget_s = Trial(marks), budget_s
        self.reach: dict[tuple[str, str], Reached] = {}

    def row(self, mutant: Mutant) -> Row:
        """Try one with one file of tests after another, until one is red; its result."""
        outcome, tried, seconds = Outcome(GREEN, "no test of its list reaches it", 0.0), 0, 0.0
        for test in mutant.tests:
            if (test, mutant.file) not in self.reach:
                self.reach[test, mutant.file] = reached(self.trial, test, mutant.file)
            reach = self.reach[test, mutant.file]
            choice = choose(mutant, reach, self.budget_s)
            if not reach["seconds"]:
                outcome = Outcome(f"{SKIPPED}: {test} is red without it", "", 0.0)
            elif choice.tests or mutant.place(ROOT / "src")[0] is None:
                outcome = self.trial.try_one(mutant, choice.tests, 60.0 + 6.0 * choice.seconds)
            tried, seconds = tried + len(choice.tests), seconds + outcome.seconds
            if outcome.result != GREEN:
                break
        return {
            "digest": mutant.digest,
            "tests_digest": _tests_digest(mutant.tests),
            "name": mutant.name,
            "file": mutant.file,
            "result": outcome.result,
            "tests": tried,
            "seen_by": outcome.seen_by,
            "seconds": round(seconds, 1),
        }


_worker: Worker | None = None


def _begin(budget_s: float, marks: str) -> None:
    global _worker
    _worker = Worker(budget_s, marks)
    atexit.register(_worker.trial.close)


def _row(mutant: Mutant) -> Row:
    if _worker is None:
        raise RuntimeError("the worker was not begun")
    return _worker.row(mutant)


def run(mutants: Sequence[Mutant], jobs: int, budget_s: float, marks: str) -> None:
    """Try all; results are appended as they come. Those of one file go to one process, which knows its tests."""
    by_file = sorted(mutants, key=lambda m: m.file)
    with ProcessPoolExecutor(jobs, get_context("spawn"), _begin, (budget_s, marks)) as workers:
        for number, (mutant, row) in enumerate(
            zip(by_file, workers.map(_row, by_file), strict=True), start=1
        ):
            RESULTS.parent.mkdir(exist_ok=True)
            handle = os.open(RESULTS, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
            os.write(handle, json.dumps(row).encode() + b"\n")
            os.close(handle)
            print(
                f"{number:4} {row['result']:16} {row['seconds']:6.1f} s {mutant.name}: {mutant.what}",
                flush=True,
            )


def _first_tries(mutants: Sequence[Mutant], known: dict[str, list[Row]]) -> str:
    """What the tests saw that were there when a mutant was first tried."""
    rows = [known[m.digest][0]["result"] for m in mutants if known.get(m.digest) and not m.equivalent]
    tried = [result for result in rows if not result.startswith(SKIPPED)]
    red = sum(result in (RED, LATE) for result in tried)
    return f"{red} of {len(tried)} red" + (f" ({100.0 * red / len(tried):.1f} %)" if tried else "")


def _score(mutants: Sequence[Mutant], known: dict[str, list[Row]]) -> Iterator[str]:
    """The table of packages, and what survived."""
    counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    survivors = []
    for mutant in mutants:
        row = _holding(mutant, known)
        result = "not tried" if row is None else row["result"]
        kind = "equivalent" if mutant.equivalent else RED if result in (RED, LATE) else result
        kind = SKIPPED if kind.startswith(SKIPPED) else kind
        for place in (mutant.package, "all"):
            counts[place][kind] += 1
        if kind == GREEN:
            survivors.append(mutant)
    yield "| package | red | green | equivalent | not tried, or gone | red of the non-equivalent |"
    yield "|---|---|---|---|---|---|"
    for place in (*sorted(set(counts) - {"all"}), "all"):
        c = counts[place]
        tried = c[RED] + c[GREEN]
        share = f"{100.0 * c[RED] / tried:.1f} %" if tried else "-"
        rest = c["not tried"] + c[SKIPPED]
        yield f"| {place} | {c[RED]} | {c[GREEN]} | {c['equivalent']} | {rest} | {share} |"
    yield ""
    yield f"asked: {100 * GOAL:.0f} %"
    yield ""
    for mutant in survivors:
        yield f"- green: `{mutant.name}` ({mutant.what}): `{_line(mutant)}`"


def _line(mutant: Mutant) -> str:
    """The line that differs."""
    old, new = mutant.old.splitlines(), mutant.new.splitlines()
    differing = next((b for a, b in zip(old, new, strict=False) if a != b), "(left out)")
    return " ".join(differing.split())[:120]


def _conditions() -> str:
    git = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return (
        f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores; "
        f"commit {git.stdout.strip()}; {len(BY_HAND)} mutants by hand, "
        + ", ".join(f"{len(found)} of {name}" for name, found in drawn_lists().items())
    )


def main() -> None:
    """Try mutants that were not tried, and print the scores."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--package", help="driver, plan ..")
    parser.add_argument("--room", dest="package", help=argparse.SUPPRESS)  # its former name
    parser.add_argument("--only", help="mutants whose name or file contains this")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--budget-s", type=float, default=20.0, help="time of the tests per mutant; the fastest run first"
    )
    parser.add_argument("--green", action="store_true", help="repeat only those that were green")
    parser.add_argument("--fast", action="store_true", help="only with tests that `make test` runs")
    parser.add_argument("--hand", action="store_true", help="only those by hand")
    parser.add_argument("--list", help="only those of one list: drawn-2.json ..")
    parser.add_argument(
        "--check", action="store_true", help="run nothing; list the mutants whose line is gone"
    )
    parser.add_argument("--score", action="store_true", help="run nothing; print the scores so far")
    parser.add_argument(
        "--draw", type=int, help="draw a new list of about so many; marks of equivalents stay"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--into", default="drawn.json", help="file of the list that --draw writes")
    parser.add_argument("--report", type=Path, help="write the scores there")
    options = parser.parse_args()
    if options.draw:
        lists = drawn_lists()
        marks = {m.digest: m.equivalent for m in lists.get(options.into, ())}
        others = {m.digest for name, found in lists.items() if name != options.into for m in found}
        others |= {m.digest for m in BY_HAND}
        found = [m for m in draw(options.draw, options.seed) if m.digest not in others]
        write_list(
            LISTS / options.into,
            [Mutant(**{**vars(m), "equivalent": marks.get(m.digest, "")}) for m in found],
        )
        print(f"{len(found)} drawn")
        return
    every = [] if options.list else [*BY_HAND]
    if not options.hand:
        every += [m for found in drawn_lists(options.list).values() for m in found]
    tests = ROOT / "tests"
    mutants = []
    for m in every:
        own = located(m.tests, tests) or tests_of(m.file, tests)
        if (options.package in (None, m.package)) and (options.only or "") in f"{m.name} {m.file}":
            mutants.append(Mutant(**{**vars(m.found(ROOT / "src")), "tests": own}))
    if options.check:
        places = [(m, m.place(ROOT / "src")[1]) for m in mutants]
        for m, place in places:
            if place != FOUND:
                print(f"{m.name}: {place} in {m.file}: {m.old.strip()[:100]!r}")
        print(f"{sum(place == FOUND for _, place in places)} of {len(mutants)} stand where they stood")
        sys.exit(any(place != FOUND for _, place in places))
    print(_conditions(), flush=True)
    if not options.score:
        known = _known()

        def is_due(m: Mutant) -> bool:
            row = _holding(m, known)
            return not m.equivalent and (row is None or (options.green and row["result"] == GREEN))

        due = [m for m in mutants if is_due(m)]
        print(f"{len(due)} of {len(mutants)} to try", flush=True)
        run(due, options.jobs, options.budget_s, "not slow" if options.fast else "")
    lines = [_conditions(), "", *_score(mutants, _known())]
    if not (options.package or options.only or options.list):
        firsts = {"by hand": BY_HAND, **drawn_lists()}
        lines += ["", "when first tried:", ""]
        lines += [f"- {name}: {_first_tries(found, _known())}" for name, found in firsts.items()]
    print("\n".join(lines[1:]))
    if options.report is not None:
        options.report.write_text("# Mutants\n\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
