"""Files as people spoil them, drawn from seeds: one line that names the file and, where there is one, the key; exit
code 2 or 3; never a traceback."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from typed.command_line import ended

pytestmark = pytest.mark.xdist_group("seeded_mistakes")

Q = "-60,-40,-80,0,-60,0"
COMMANDS: dict[str, Callable[[Path], tuple[object, ...]]] = {
    "cell.toml": lambda at: ("check", at / "cell.toml", f"--q={Q}"),
    "cameras/lab.toml": lambda at: ("check", at / "cell.toml", f"--q={Q}"),
    "boards/positions_plate_01-02.csv": lambda at: ("check", at / "cell.toml", f"--q={Q}"),
    "task2.toml": lambda at: ("reach", at / "task2.toml", "--look", at / "look.json"),
    "task2.world.toml": lambda at: ("look", at / "task2.toml", "-o", at / "again.json"),
    "look.json": lambda at: ("reach", at / "task2.toml", "--look", at / "look.json"),
    "plan.json": lambda at: ("check", at / "plan.json", at / "task2.toml"),
}
COUNTS = {
    "cell.toml": 24,
    "cameras/lab.toml": 8,
    "boards/positions_plate_01-02.csv": 8,
    "task2.toml": 10,
    "task2.world.toml": 10,
    "look.json": 12,
    "plan.json": 12,
}


# -- mistakes: the text with one in it, and what the message has to name besides the file

_LINE = re.compile(r"^(?P<key>\w+)(?P<is> *= *)(?P<value>[^\s#][^#\n]*?)(?P<rest> *(?:#.*)?)$", re.MULTILINE)
_WRONG = ("nan", "inf", "-1e9", "1e12", '"many"', "true", "[]", "[1, 2, 3, 4, 5, 6, 7, 8]", '""', "{ a = 1 }")


def spoilt_toml(text: str, rng: np.random.Generator) -> tuple[str, str]:
    lines = [m for m in _LINE.finditer(text) if m["value"].count("[") == m["value"].count("]")]
    line = lines[int(rng.integers(len(lines)))]
    before, after, key = text[: line.start()], text[line.end() :], line["key"]
    kind = rng.choice(["value", "value", "value", "name", "gone", "cut", "sign", "byte"])
    if kind == "value":
        value = str(rng.choice([v for v in _WRONG if v != line["value"]]))
        return f"{before}{key}{line['is']}{value}{line['rest']}{after}", key
    if kind == "name":
        return f"{before}{key}x{line['is']}{line['value']}{after}", key
    if kind == "gone":
        return before + after, key
    if kind == "cut":
        return before + line[0][: len(key) + 2], ""
    if kind == "sign":
        return f"{before}{key} {line['value']}{after}", ""
    return f"{before}{key}{line['is']}\udcff{after}", ""


def spoilt_csv(text: str, rng: np.random.Generator) -> tuple[str, str]:
    lines = text.splitlines()
    at = int(rng.integers(len(lines)))
    lines[at] = str(
        rng.choice(["80,sixty", "", "nan,20", "1e9,1e9", "80", "80;60", "80,60,40,20", "\udcff,2"])
    )
    return "\n".join(lines) + "\n", ""


def spoilt_json(text: str, rng: np.random.Generator) -> tuple[str, str]:
    if rng.random() < 0.15:
        return text[: int(rng.integers(1, len(text) - 2))], ""
    value = json.loads(text)
    node, key = value, ""
    while isinstance(node, dict | list) and node:
        inner = rng.choice(sorted(node)) if isinstance(node, dict) else int(rng.integers(len(node)))
        name = str(inner) if isinstance(node, dict) else ""
        if not isinstance(node[inner], dict | list) or not node[inner] or rng.random() < 0.2:
            key = name or key
            if rng.random() < 0.25 and isinstance(node, dict):
                del node[inner]
            else:
                node[inner] = _other(node[inner], rng)
            break
        key, node = name or key, node[inner]
    return json.dumps(value), key


def _other(old: object, rng: np.random.Generator) -> Any:
    others: list[Any] = [None, "many", -1e9, 1e300, True, [], {}, [1, 2], float("nan"), float("inf")]
    kept = [v for v in others if type(v) is not type(old) or v != old]
    return kept[int(rng.integers(len(kept)))]


SPOILERS = {".toml": spoilt_toml, ".csv": spoilt_csv, ".json": spoilt_json}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "seed"), [(file, seed) for file, count in COUNTS.items() for seed in range(count)]
)
def test_a_spoilt_file_is_one_line_with_file_and_key(
    planned_scenes: Path, tmp_path: Path, file: str, seed: int
) -> None:
    scenes = Path(shutil.copytree(planned_scenes, tmp_path / "scenes"))
    rng = np.random.default_rng([seed, sum(map(ord, file))])
    text, key = SPOILERS[Path(file).suffix]((scenes / file).read_text(), rng)
    (scenes / file).write_bytes(text.encode(errors="surrogateescape"))
    code, told = ended(*COMMANDS[file](scenes), cwd=scenes)
    if code == 0:  # what may be left out, or be so: then nothing is said
        assert "a465:" not in told
        return
    assert code in (2, 3)
    (line,) = [line for line in told.splitlines() if line.startswith("a465:")]
    if code == 2:
        assert Path(file).name in line
        assert key in line
    assert len(line) < 600
