"""One mutant: a text of one file, and what stands there instead."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from arm.io.storage import read_json, sha256, write_atomic

FOUND, MISSING, AMBIGUOUS = "found", "old text not found", "old text not unique"


@dataclass(frozen=True)
class Mutant:
    """A change that some test has to see.

    Attributes:
        name: of the mutant; no two have one.
        file: below ``src``, such as ``driver/mars/stopping.py``.
        old, new: the text and what it becomes; `old` stands once in the file.
        what: in a few words.
        tests: files below ``tests``, fastest first; none: those of the module (`mutants_bench.tests_of`).
        equivalent: why no test can see it; "" if one has to.
        listed: the file that the list names, if the file has moved since.
    """

    name: str
    file: str
    old: str
    new: str
    what: str
    tests: tuple[str, ...] = field(default=())
    equivalent: str = ""
    listed: str = ""

    @property
    def package(self) -> str:
        """``driver``, ``plan`` .."""
        return self.file.partition("/")[0]

    @property
    def digest(self) -> str:
        """Of what is changed: a result is of this very mutant."""
        return sha256([self.listed or self.file, self.old, self.new])[:16]

    def found(self, src: Path) -> Mutant:
        """The same where its file is now."""
        path, _ = self.place(src)
        now = self.file if path is None else path.relative_to(src).as_posix()
        return self if now == self.file else replace(self, file=now, listed=self.file)

    def place(self, src: Path) -> tuple[Path | None, str]:
        """The file that holds the old text once, and `FOUND`; or None and why not.

        A file that has moved is found by its old text, if one file alone of its name has it.
        """
        path = src / self.file
        files = [path] if path.is_file() else sorted(src.rglob(path.name))
        counts = {file: file.read_text().count(self.old) for file in files}
        holding = [file for file, count in counts.items() if count]
        if not holding:
            return None, MISSING
        if len(holding) > 1 or counts[holding[0]] > 1:
            return None, AMBIGUOUS
        return holding[0], FOUND

    def apply(self, path: Path) -> str:
        """The text of the changed file."""
        return path.read_text().replace(self.old, self.new)


def read_list(path: Path) -> list[Mutant]:
    """Mutants of a list file."""
    entries = read_json(path)
    return [Mutant(**{"new": "", **entry, "tests": tuple(entry.get("tests", ()))}) for entry in entries]


def write_list(path: Path, mutants: Iterable[Mutant]) -> None:
    """Write a list file: one mutant a line, so that changes can be read."""
    rows = [json.dumps({key: value for key, value in asdict(m).items() if value}) for m in mutants]
    write_atomic(path, "[\n" + ",\n".join(rows) + "\n]\n")
