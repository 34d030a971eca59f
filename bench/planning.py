"""The planner against its peers on seeded scenes, judged by MuJoCo.

python bench/planning.py --easy 50 --hard 50 --peers roboplan ompl seed

Needs the extra `bench` (roboplan, ompl, mujoco). Every planner gets the same queries: fetch a cube from a hole of
one board, bring it to a hole of the other, with 100 mm along the board's normal at each, from home to home.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from planning_bench import tables
from planning_bench.campaign import GROUPS, PLANNERS, Record, run_scenes
from planning_bench.query import CLEARANCE

ROWS = ("queries", "whole", "certificate", "infeasible", "scaling", "walls", "crowd")
LIBRARIES = ("a465", "numpy", "pin", "coal", "mujoco", "toppra", "roboplan", "ompl", "cmeel-toppra")


def main() -> None:
    """Draw, plan, judge, print."""
    options = _options()
    peers = [name for group in options.peers for name in GROUPS.get(group, (group,))]
    planners = tuple(dict.fromkeys((*(() if options.no_ours else ("ours",)), *peers)))
    print(conditions(options, planners), flush=True)
    records: dict[str, list[Record]] = {}
    if {"queries", "whole"} & set(options.rows):
        for kind in ("easy", "hard"):
            count = getattr(options, kind)
            if count:
                seeds = range(options.first_seed, options.first_seed + count)
                records[kind] = run_scenes(
                    kind, seeds, planners, "whole" in options.rows, options.jobs, options.keep
                )
    more: dict[str, Any] = {}
    if "certificate" in options.rows:
        from planning_bench.certificate import certificate_row

        more["certificate"] = certificate_row(min(options.hard or 5, 10), options.first_seed)
    if "infeasible" in options.rows:
        from planning_bench.infeasible import infeasible_row

        more["infeasible"] = infeasible_row(options.infeasible, options.first_seed)
    if "scaling" in options.rows:
        from planning_bench.scaling import scaling_row

        more["scaling"] = scaling_row(options.first_seed, options.plot)
    if "walls" in options.rows:
        from planning_bench.scaling import walls_row

        more["walls"] = walls_row()
    if "crowd" in options.rows:
        from planning_bench.crowd import crowd_row

        more["crowd"] = crowd_row(options.first_seed)
    report(records, more)
    if options.json:
        options.json.write_text(json.dumps({"records": records, **more}, indent=1, default=str) + "\n")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--easy", type=int, default=50, help="scenes, four queries each")
    parser.add_argument("--hard", type=int, default=50)
    parser.add_argument(
        "--peers",
        nargs="*",
        default=["roboplan", "ompl", "seed"],
        choices=[*GROUPS, *PLANNERS],
        metavar="PEER",
    )
    parser.add_argument("--no-ours", action="store_true")
    parser.add_argument("--rows", type=lambda s: s.split(","), default=list(ROWS), help=",".join(ROWS))
    parser.add_argument("--infeasible", type=int, default=10, help="scenes of each infeasible kind")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="processes; CPU times are fairest with 1")
    parser.add_argument("--plot", type=Path, help="SVG of the scaling row")
    parser.add_argument("--json", type=Path, help="all records")
    parser.add_argument(
        "--keep",
        type=Path,
        help="file to which each scene is added; a later run with it continues there",
    )
    options = parser.parse_args()
    unknown = set(options.rows) - set(ROWS)
    if unknown:
        parser.error(f"--rows: {', '.join(sorted(unknown))}: must be among {', '.join(ROWS)}")
    return options


def conditions(options: argparse.Namespace, planners: tuple[str, ...]) -> str:
    """All that the figures rest on."""
    root = Path(__file__).resolve().parents[1]

    def git(*words: str) -> str:
        ran = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False)
        return ran.stdout.strip()

    found = []
    for name in LIBRARIES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} -")
    changed = " with changes" if git("status", "--porcelain", "--", "src", "bench") else ""
    return "\n".join(
        [
            f"conditions: commit {git('rev-parse', '--short', 'HEAD')}{changed}; Python {platform.python_version()}; "
            + ", ".join(found),
            f"  machine: {os.cpu_count()} processors, load {', '.join(f'{x:.1f}' for x in os.getloadavg())}; "
            f"{options.jobs} jobs; one thread each for BLAS and OpenMP",
            f"  scenes: {options.easy} easy, {options.hard} hard, four queries each, from seed {options.first_seed}; "
            f"rows {', '.join(options.rows)}",
            f"  planners: {', '.join(planners)}",
            "  unit crs93 at its default registers, speed 1, velocity and acceleration fractions 1.0, asked clearance "
            f"{CLEARANCE * 1e3:g} mm (peers cannot be asked), lines of 100 mm, home only at both ends, no looks; "
            "whole tasks: order and assignment free in ours and in both bounds, as given for the peers",
            "  CPU: process time over all threads from scene and query in memory to the timed plan (ours: certified), "
            "after one query to warm up",
            "  judge: MuJoCo each 1 ms; a cube may touch a plate only inside its own pocket; clearance each 20 ms, "
            "at most 60 mm; peaks: ours exact inside segments, seed by differences of 1 ms, "
            "others at their own samples of 10 ms",
        ]
    )


def report(records: dict[str, list[Record]], more: dict[str, Any]) -> None:
    """Markdown."""
    for kind, rows in records.items():
        print(f"\n### {kind}: queries\n\n{tables.query_table(rows)}\n")
        print(tables.control_line(rows))
        known = tables.names(rows)
        for peer in ("roboplan-fine", "ompl-fine"):
            if "ours" in known and peer in known:
                print(tables.cpu_ratio(rows, "ours", peer))
        print(tables.reasons(rows))
        if any(r["whole"] for r in rows):
            print(f"\n### {kind}: whole transfer of four cubes\n\n{tables.query_table(rows, whole=True)}\n")
            if "seed+retract" in known:
                for name in known:
                    print("- motion " + tables.time_ratio(rows, name, "seed+retract", whole=True))
    for name, text in more.items():
        print(f"\n### {name}\n\n{text}")


if __name__ == "__main__":
    main()
