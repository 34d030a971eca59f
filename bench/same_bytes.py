"""Do plans have the same bytes with every BLAS kernel, every number of threads and without numpy's fast paths?

python bench/same_bytes.py --easy 50 --hard 50

Scenes are drawn once, four queries each, which takes 15 to 20 s of processor time a scene (``--keep FILE`` keeps them).
Every variant then plans the same 400 queries in its own process, and the SHA-256 of each whole plan is compared with
that of the first variant. OpenBLAS takes its kernels from OPENBLAS_CORETYPE; a kernel that the processor cannot run
(SkylakeX without AVX-512) ends its process and is reported.
"""

from __future__ import annotations

import argparse
import os
import pickle
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from planning_bench.ours import Ours
from planning_bench.query import Query
from planning_bench.scenes import draw

from arm.errors import A465Error

KERNELS = ("Haswell", "Prescott", "Nehalem", "Sandybridge", "SkylakeX")
THREADS = (1, 2)
FAILED = "refused"


@dataclass(frozen=True)
class Variant:
    """What a process is told of the processor."""

    name: str
    environment: tuple[tuple[str, str], ...]


def variants() -> list[Variant]:
    """All that are compared, the first with all others."""
    found = [
        Variant(
            f"{kernel}, {threads} thread{'s' * (threads > 1)}",
            (("OPENBLAS_CORETYPE", kernel), ("OPENBLAS_NUM_THREADS", str(threads))),
        )
        for kernel in KERNELS
        for threads in THREADS
    ]
    lacks = {
        "AVX-512": "AVX512_SPR AVX512_ICL X86_V4",
        "AVX-512, AVX2 and FMA": "AVX512_SPR AVX512_ICL X86_V4 X86_V3",
    }
    return [
        *found,
        *(
            Variant(f"numpy without {name}", (("NPY_DISABLE_CPU_FEATURES", off),))
            for name, off in lacks.items()
        ),
        Variant(
            "C library without FMA and AVX2",
            (("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX,-AVX512F"),),
        ),
    ]


def queries_of(scene: tuple[str, int]) -> list[Query]:
    """The four queries of one scene."""
    drawn = draw(*scene)
    return [drawn.query(i) for i in range(4)]


def plan_all(queries: Path, output: Path) -> None:
    """Plan every query of a file; a digest a line, or the refusal."""
    planner = Ours()
    lines = []
    for query in pickle.loads(queries.read_bytes()):  # written by this program a moment ago
        try:
            lines.append(planner.plan(query).sha256)
        except A465Error as error:
            lines.append(f"{FAILED}: {error}".splitlines()[0])
    output.write_text("\n".join(lines) + "\n")


def run_variant(variant: Variant, queries: Path, folder: Path) -> list[str] | str:
    """Digests of a process of its own, or why it ended."""
    output = folder / "digests.txt"
    output.unlink(missing_ok=True)
    ran = subprocess.run(
        [sys.executable, __file__, "--plan", str(queries), str(output)],
        env={**os.environ, **dict(variant.environment)},
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode == -signal.SIGILL:
        return "illegal instruction: this processor lacks it"
    if ran.returncode:
        return f"ended with {ran.returncode}: {ran.stderr.strip().splitlines()[-1:]}"
    return output.read_text().splitlines()


def main() -> None:
    """Draw, plan under each variant, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--easy", type=int, default=50, help="scenes, four queries each")
    parser.add_argument("--hard", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="processes that draw scenes")
    parser.add_argument(
        "--keep", type=Path, help="file of the drawn queries: read if it exists, else written"
    )
    parser.add_argument("--plan", nargs=2, type=Path, metavar=("QUERIES", "DIGESTS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.plan:
        plan_all(*options.plan)
        return
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "pin", "coal", "toppra"))
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {libraries}",
        flush=True,
    )
    scenes = [
        (kind, seed)
        for kind, count in (("easy", options.easy), ("hard", options.hard))
        for seed in range(options.first_seed, options.first_seed + count)
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        queries = options.keep or folder / "queries.pickle"
        if not queries.exists():
            with ProcessPoolExecutor(options.jobs) as pool:
                some = [query for found in pool.map(queries_of, scenes) for query in found]
            queries.write_bytes(pickle.dumps(some))
        drawn: list[Query] = pickle.loads(queries.read_bytes())  # written by this program
        of = Counter(name.split()[0] for name in {query.name.split("/")[0] for query in drawn})
        print(f"{len(drawn)} queries of {of['easy']} easy and {of['hard']} hard scenes", flush=True)
        first: list[str] = []
        worst = 0
        for variant in variants():
            began = time.perf_counter()
            digests = run_variant(variant, queries, folder)
            if isinstance(digests, str):
                print(f"{variant.name}: not run: {digests}", flush=True)
                continue
            first = first or digests
            other = [query.name for query, a, b in zip(drawn, first, digests, strict=True) if a != b]
            worst = max(worst, len(other))
            refused = sum(line.startswith(FAILED) for line in digests)
            print(
                f"{variant.name}: {len(digests) - len(other)} of {len(digests)} the same bytes, {refused} refused, "
                f"{time.perf_counter() - began:.0f} s"
                + (f"; others: {', '.join(other[:8])}" if other else ""),
                flush=True,
            )
    sys.exit(1 if worst else 0)


if __name__ == "__main__":
    main()
