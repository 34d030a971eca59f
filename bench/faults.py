"""Every fault at every moment with varied seeds: outcomes against the expected ones.

python bench/faults.py --cases 1000

A case in which the arm leaves its certified path is expected only if its mechanics or the unit itself fail.
The matrix and the runner are tests/support/wire/fault_matrix.py; its outcomes are explained in docs/faults.md.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from wire.fault_matrix import EXPECTED, MOMENTS, NAMES, Outcome, run_case


def main() -> None:
    """Run cases, print the matrix and what is not as expected."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--faults", nargs="*", choices=NAMES, metavar="FAULT", default=list(NAMES))
    parser.add_argument("--moments", nargs="*", choices=MOMENTS, metavar="MOMENT", default=list(MOMENTS))
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    cells = list(product(options.faults, options.moments))
    cases = [(*cells[i % len(cells)], options.first_seed + i // len(cells)) for i in range(options.cases)]
    print(
        f"Python {platform.python_version()}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; "
        f"{len(cases)} cases in {len(cells)} cells; stepped time; unit crs93; "
        f"{time.strftime('%Y-%m-%d')}, commit {commit()}",
        flush=True,
    )
    began = time.monotonic()
    done: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(options.jobs) as pool:
        work = ((*case, Path(folder)) for case in cases)
        for outcome in pool.map(_run, work):
            done.append(outcome)
            if not outcome.as_expected:
                wanted = " or ".join(sorted(outcome.expected))
                print(
                    f"NOT AS EXPECTED: {outcome.name}, {outcome.moment}, seed {outcome.seed}: {outcome.seen}, "
                    f"not {wanted}; {outcome.off_deg:.3f} deg off its path; moved {outcome.moved_after} after; "
                    f"{outcome.message}",
                    flush=True,
                )
            if len(done) % 100 == 0:
                print(f"{len(done)} cases, {time.monotonic() - began:.0f} s", flush=True)
    report(done)
    if options.json:
        options.json.write_text(json.dumps([asdict(o) for o in done], indent=1) + "\n")


def commit() -> str:
    """What was measured."""
    here = Path(__file__).parent
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=here, capture_output=True, text=True, check=False
    )
    return said.stdout.strip() or "unknown"


def _run(work: tuple[str, str, int, Path]) -> Outcome:
    return run_case(*work)


def report(done: list[Outcome]) -> None:
    """The matrix: how many cases of each cell ended how."""
    print(f"{'fault':26s}" + "".join(f"{moment:>22s}" for moment in MOMENTS))
    for name in EXPECTED:
        cells = []
        for moment in MOMENTS:
            own = [o.seen for o in done if (o.name, o.moment) == (name, moment)]
            cells.append(", ".join(f"{seen} {own.count(seen)}" for seen in dict.fromkeys(own)))
        print(f"{name:26s}" + "".join(f"{cell:>22s}" for cell in cells))
    print("farthest from the certified path, deg (** not allowed):")
    for name in EXPECTED:
        cells = []
        for moment in MOMENTS:
            outcomes = [o for o in done if (o.name, o.moment) == (name, moment)]
            worst = max((o.off_deg for o in outcomes), default=0.0)
            cells.append(f"{worst:.3f}{'' if all(o.certified for o in outcomes) else ' **'}")
        print(f"{name:26s}" + "".join(f"{cell:>22s}" for cell in cells))
    stops = [o.after_s for o in done if o.seen in ("stops", "refuses", "unknown")]
    played = [o.played_s for o in done if o.seen == "unknown"]
    print(
        f"{len(done)} cases, {sum(o.as_expected for o in done)} as expected; from fault to the end of the call at most "
        f"{max(stops, default=0.0):.1f} s (controller); after a lost link the arm went on for at most "
        f"{max(played, default=0.0):.2f} s; logs whole: {sum(o.log_whole for o in done)}"
    )


if __name__ == "__main__":
    main()
