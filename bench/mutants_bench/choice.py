"""Which tests a mutant is tried with: those of its list that reach its line, the fastest first."""

from __future__ import annotations

import ast
import json
from dataclasses import dataclass
from typing import TypedDict

from arm.io.storage import sha256, write_atomic
from mutants_bench.mutant import Mutant
from mutants_bench.trial import ROOT, Trial

CACHE = ROOT / "bench" / "results" / ".reach"  # of test files, made anew where they or the sources change
LONGEST_S = 900.0  # of one file of tests, traced


@dataclass(frozen=True)
class Choice:
    """Tests, and what they take without a mutant, s."""

    tests: tuple[str, ...]
    seconds: float


class Reached(TypedDict):
    """What `mutants_bench.reach` wrote of one file of tests: s by test, tests by ``file:line``, digests by source."""

    seconds: dict[str, float]
    tests: dict[str, list[str]]
    texts: dict[str, str]


def reached(trial: Trial, test: str, file: str) -> Reached:
    """Seconds by test and tests by line, of one file of tests; from the cache, or by running it once."""
    known = CACHE / f"{sha256((ROOT / 'tests' / test).read_text() + trial.marks)[:20]}.json"
    if known.is_file():
        cached: Reached = json.loads(known.read_text())
        if cached["texts"].get(file) == _text(file):
            return cached
    output = trial.root / "reach.json"
    output.unlink(missing_ok=True)
    package = file.partition("/")[0]
    files = [p.relative_to(ROOT / "src").as_posix() for p in (ROOT / "src" / package).rglob("*.py")]
    outcome = trial.run([f"tests/{test}"], LONGEST_S, (files, output))
    written = json.loads(output.read_text()) if output.is_file() else {"seconds": {}, "tests": {}}
    found: Reached = {
        "seconds": written["seconds"],
        "tests": written["tests"],
        "texts": {name: _text(name) for name in files},
    }
    good = len(found["seconds"])
    print(f"  {test}: {outcome.result} in {outcome.seconds:.0f} s, {good} good", flush=True)
    write_atomic(known, json.dumps(found))
    return found


def _text(file: str) -> str:
    return sha256((ROOT / "src" / file).read_text())[:20]


def choose(mutant: Mutant, reach: Reached, budget_s: float) -> Choice:
    """Tests that reach the statement that is changed, up to a budget; outside of functions, those of its file."""
    path, _ = mutant.place(ROOT / "src")
    if path is None:
        return Choice((), 0.0)
    first, last = _statement(path.read_text(), mutant)
    seconds, by_line = reach["seconds"], reach["tests"]
    tests = {test for line in range(first, last + 1) for test in by_line.get(f"{mutant.file}:{line}", ())}
    if first == 0:
        tests = {t for line, names in by_line.items() if line.startswith(f"{mutant.file}:") for t in names}
        tests = tests or set(
            seconds
        )  # it only declares: its lines run while it is imported, and are nobody's
    chosen: list[str] = []
    total = 0.0
    for test in sorted(tests, key=lambda t: (seconds[t], t)):
        if chosen and total + seconds[test] > budget_s:
            break
        chosen.append(test)
        total += seconds[test]
    return Choice(tuple(chosen), total)


def _statement(text: str, mutant: Mutant) -> tuple[int, int]:
    """First and last line of what is changed inside a function; (0, 0) outside of any."""
    begin = text[: text.index(mutant.old)].count("\n") + 1
    old, new = mutant.old.splitlines(), mutant.new.splitlines()
    same = next(
        (i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), min(len(old), len(new))
    )
    line = begin + min(same, len(old) - 1)
    best: ast.stmt | None = None
    inside = False
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and node.body[0].lineno <= line <= (node.end_lineno or 0):
            inside = True
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0):
            smaller = best is None or (node.lineno, -(node.end_lineno or 0)) >= (
                best.lineno,
                -(best.end_lineno or 0),
            )
            best = node if smaller else best
    if not inside or best is None:
        return 0, 0
    body = getattr(best, "body", None)
    last = body[0].lineno - 1 if isinstance(body, list) else best.end_lineno or line
    return best.lineno, max(last, line if last < line else best.lineno)
