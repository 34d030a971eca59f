"""Records as markdown tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from planning_bench.campaign import Record


def markdown(head: list[str], rows: Iterable[list[str]]) -> str:
    """A markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def pct(values: list[float], *at: float, digits: int = 3, scale: float = 1.0) -> str:
    """Percentiles, or a dash if there is nothing."""
    if not values:
        return "-"
    return ", ".join(f"{scale * float(np.percentile(values, p)):.{digits}f}" for p in at)


def query_table(records: list[Record], whole: bool = False) -> str:
    """The table of the facts, one row a planner."""
    head = [
        "planner", "n", "returned", "clean", "penetrating", "CPU s med, p95", "T s med",
        "T/LB med, p95", "T/LB0 med, p95", "T/LB1 med, p95",
        "path rad med",
        "transit clearance mm med, p5", "certified mm min", "deepest mm", "grasp mm max", "line mm med, max",
        "peak v", "peak a", "join",
    ]  # fmt: skip
    rows = []
    for name in names(records):
        mine = [r for r in records if r["planner"] == name and r["whole"] == whole]
        returned = [r for r in mine if r["returned"]]
        clean = [r for r in mine if r["clean"]]
        judged = [r for r in returned if "duration" in r]
        certified = [r["certified"] for r in judged if r["certified"] is not None]
        rows.append(
            [
                name,
                str(len(mine)),
                str(len(returned)),
                f"{len(clean)} ({100 * len(clean) / max(len(mine), 1):.1f} %)",
                str(sum(not r["clean"] for r in returned)),
                pct([r["cpu"] for r in mine], 50, 95),
                pct([r["duration"] for r in clean], 50, digits=2),
                pct([r["duration"] / r["LB"] for r in clean], 50, 95),
                pct([r["duration"] / r["LB0"] for r in clean], 50, 95),
                pct([r["duration"] / r["LB1"] for r in clean], 50, 95),
                pct([r["path"] for r in clean], 50, digits=2),
                pct([r["clearance"] for r in judged], 50, 5, digits=1, scale=1e3),
                f"{1e3 * min(certified):.2f}" if certified else "-",
                f"{-1e3 * max((r['deepest'] for r in judged), default=0.0):.1f}",
                pct([r["grasp"] for r in clean], 100, scale=1e3),
                pct([r["line"] for r in clean], 50, 100, scale=1e3),
                pct([r["velocity"] for r in clean], 100, digits=4),
                pct([r["acceleration"] for r in clean], 100, digits=4),
                pct([r["join"] for r in clean if not np.isnan(r["join"])], 100),
            ]
        )
    return markdown(head, rows)


def reasons(records: list[Record]) -> str:
    """What went wrong, per planner, most frequent first."""
    lines = []
    for name in names(records):
        found = Counter(str(r["reason"])[:160] for r in records if r["planner"] == name and not r["clean"])
        if found:
            lines.append(f"- {name}: " + " | ".join(f"{k} x{v}" for k, v in found.most_common(6)))
    return "\n".join(lines)


def cpu_ratio(records: list[Record], ours: str, peer: str) -> str:
    """Median over queries of the ratio of CPU times."""
    ratios = paired(records, ours, peer, "cpu", whole=False, clean=False)
    return (
        f"CPU {ours} / {peer}, per query: median {pct(ratios, 50)}, p95 {pct(ratios, 95)} (n = {len(ratios)})"
    )


def time_ratio(records: list[Record], name: str, reference: str, whole: bool) -> str:
    """Ratio of motion times, on what both solve cleanly and on all that both answer."""
    parts = []
    for clean, what in ((True, "both clean"), (False, "whatever they hit")):
        ratios = paired(records, name, reference, "duration", whole, clean)
        parts.append(f"{what} {pct(ratios, 50)} (p95 {pct(ratios, 95)}, n = {len(ratios)})")
    return f"{name} / {reference}: {', '.join(parts)}"


def paired(records: list[Record], a: str, b: str, key: str, whole: bool, clean: bool) -> list[float]:
    """Values of a over those of b on common queries."""
    of = {
        n: {
            r["query"]: r[key]
            for r in records
            if r["planner"] == n
            and r["whole"] == whole
            and key in r
            and r["returned"]
            and (r["clean"] or not clean)
        }
        for n in (a, b)
    }
    return [of[a][q] / of[b][q] for q in of[a] if q in of[b]]


def names(records: list[Record]) -> list[str]:
    """Planners in the order they were run."""
    return list(dict.fromkeys(r["planner"] for r in records if r["planner"] != "control"))


def control_line(records: list[Record]) -> str:
    """Whether the judge caught what it must."""
    rows = [r for r in records if r["planner"] == "control"]
    depths = [r["depth"] for r in rows]
    return (
        f"positive control: {sum(r['caught'] for r in rows)} of {len(rows)} caught "
        f"(depths {pct(depths, 0, 50, 100, digits=1, scale=1e3)} mm)"
    )
