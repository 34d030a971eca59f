"""Reproduce the NAO's paper in simulation: tables on the screen, figures and JSON in a folder.

python bench/nao_paper.py --out nao            (two minutes; --drawn: half a minute, no images)
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from pathlib import Path

from nao_paper_bench.paper import reproduce

from arm.io.storage import write_atomic


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--drawn",
        action="store_true",
        help="simulate vertices with the paper's noise instead of detecting them in images",
    )
    arguments = parser.parse_args()
    print(f"python {platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    began = time.perf_counter()
    told = reproduce(arguments.out, print, arguments.seed, not arguments.drawn)
    write_atomic(arguments.out / "nao_paper.json", json.dumps(told, indent=1) + "\n")
    print(f"figures in {arguments.out}; {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
