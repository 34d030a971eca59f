"""The documentation's pages, and what stands in them to be typed, kept or seen."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
SHELL = ("", "sh", "bash", "shell", "console")
FIRST = ("a465", "python", "make", "cp", ".", "export", ".venv/bin/pytest", "dask")
_FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>[\w{}-]*)[^\n]*\n(?P<text>.*?)^(?P=indent)```", re.M | re.S
)
_FILE = re.compile(r"<!-- file: (\S+) -->\s*\Z")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Attributes:
        line: of the page on which its first line stands, from 1.
        language: that its fence names.
        text: between the fences.
        file: name under which the page says that it is to be kept, or "".
    """

    line: int
    language: str
    text: str
    file: str


@dataclass(frozen=True)
class Command:
    """A line to type: its words without the comment, and the exit code that the comment tells."""

    line: int
    words: tuple[str, ...]
    code: int


def pages() -> list[Path]:
    """Of the documentation, the README first; not those that Sphinx makes."""
    docs = ROOT / "docs"
    made = (docs / "_build", docs / "api")
    found = (page for page in sorted(docs.rglob("*.md")) if not any(page.is_relative_to(m) for m in made))
    return [ROOT / "README.md", *found]


def blocks(text: str) -> list[Block]:
    """All fenced blocks, in order."""
    found = []
    for fence in _FENCE.finditer(text):
        kept = _FILE.search(text[: fence.start()])
        line = text[: fence.start("text")].count("\n") + 1
        inside = re.sub(rf"^{fence['indent']}", "", fence["text"], flags=re.M)
        found.append(Block(line, fence["language"], inside, kept[1] if kept else ""))
    return found


def commands(block: Block) -> list[Command]:
    """The lines of a block that are to be typed. Of a block that says it is a shell's, every line must be one.

    Raises:
        ValueError: a line of a shell's block begins with no command that is known.
    """
    if block.language not in SHELL or block.file:
        return []
    found = []
    for number, line in enumerate(block.text.splitlines(), start=block.line):
        words = tuple(shlex.split(line.removeprefix("$ "), comments=True))
        if not words:
            continue
        if words[0] not in FIRST:
            if block.language:
                raise ValueError(f"line {number}: nobody knows how to check {line!r}")
            continue
        told = re.search(r"#.*exit code (\d)", line)
        found.append(Command(number, words, int(told[1]) if told else 0))
    return found


def told_by_the_way(text: str) -> list[tuple[str, ...]]:
    """Words of the commands that stand inside sentences of a page, as ``a465 look`` may."""
    prose = re.sub(r"^ *```.*?^ *```", "", text, flags=re.M | re.S)
    return [tuple(shlex.split(found)[1:]) for found in re.findall(r"`(a465 [^`|]+)", prose)]


def followed(page: Path) -> Iterator[Block | Command]:
    """What a page has its reader do, in order: lines to type, files to keep, and what is to be seen then."""
    for block in blocks(page.read_text()):
        if block.file or block.language in ("python", "text"):
            yield block
        yield from commands(block)
