"""Comments of a new cell's files and rows of docs/formats.md, from the declared keys and their texts in keys.toml.

A text has `what` (a phrase: the key's meaning), and may have `measure` (sentences for the comment: how to find the
value, and what a wrong one causes), `docs` (what else the row says), `example` (a value for the comment where the
key is left out), and `left_out` (what the row says in that column instead). The text `_` of a table is its comment.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from arm.calibration_file import CalibrationKeys
from arm.controller.unit_keys import UnitKeys
from arm.io.keys import Key, Keys
from arm.io.node import REQUIRED
from arm.io.toml_reader import read_toml
from arm.io.toml_writer import toml_value
from cell.config.cell_file import CellKeys, FixedToolCellKeys
from cell.config.fixed_tool import FixedToolKeys
from cell.config.plain_board import PlainBoardKeys
from cell.files.hand_target import HandCharucoKeys
from cell.files.study import StudyKeys
from cell.files.task import Task1Keys, Task2Keys
from cell.files.world import WorldKeys
from cell.program.points import WireKeys
from cell.program.program_file import ProgramKeys
from vision.camera.model import CameraKeys

Texts = Mapping[str, Mapping[str, str]]
FILES: dict[str, tuple[type[Keys], ...]] = {
    "cell": (FixedToolCellKeys, CellKeys),  # the later one's defaults are those of the rows
    "unit": (UnitKeys,),
    "tool": (FixedToolKeys,),
    "task": (Task1Keys, Task2Keys),
    "board": (PlainBoardKeys,),
    "program": (ProgramKeys,),
    "wire": (WireKeys,),
    "world": (WorldKeys,),
    "study": (StudyKeys,),
    "camera": (CameraKeys,),
    "target": (HandCharucoKeys,),
    "calibration": (CalibrationKeys,),
}
"""Declarations of the keys of each file, by the name of its texts."""
_COLUMNS, _VALUES = 110, 35  # width of comments, and of a value before its comment


def declared_keys(*kinds: type[Keys]) -> dict[str, Key]:
    """Return the keys of a file by dotted name, ``[]`` after the name of an array of tables."""
    found: dict[str, Key] = {}
    for key in (key for kind in kinds for key in kind.declared().values()):
        inner = declared_keys(*key.rule.tables)
        found |= {f"{key.name}[].{name}": one for name, one in inner.items()} if inner else {key.name: key}
    return found


@cache
def texts_of(file: str) -> Texts:
    """Return the texts of a file's keys and tables by dotted name."""
    every = read_toml(Path(__file__).with_name("keys.toml"))
    return dict(_texts("", every[file]))


def _texts(prefix: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, str]]]:
    for name, value in table.items():
        if name == "_":
            yield prefix.removesuffix("."), {"what": value}
        elif "what" in value:
            yield prefix + name, value
        else:
            yield from _texts(f"{prefix}{name}.", value)


def rows_of(file: str) -> dict[str, str]:
    """Return the rows of a file's table in docs/formats.md by key: key, rule, default, meaning."""
    declared = {name.replace("[]", ""): (name, key) for name, key in declared_keys(*FILES[file]).items()}
    rows = {}
    for plain, text in texts_of(file).items():
        if plain in declared:
            name, key = declared[plain]
            if key.default is REQUIRED:
                usual = "refused"
            else:
                usual = f"`{_written(key.default)}`" if key.default or key.default == 0 else "none"
            usual = text.get("left_out", usual)
            meaning = "; ".join(filter(None, (text["what"], text.get("docs"))))
            rows[name] = f"| `{name}` | {key.rule.words} | {usual} | {meaning} |"
    return rows


def commented(values: Mapping[str, Any], file: str, kind: type[Keys], name: str) -> str:
    """Return a TOML file with a comment above every key, and a commented line for every key that may be added.

    Args:
        values: of the file.
        file: name of its texts.
        kind: declaration of its keys.
        name: of the cell, for the comment at the head.
    """
    texts = texts_of(file)
    head = _comment(texts.get("", {}), name)
    return "\n".join([*head, *_table(values, texts, declared_keys(kind), "")]) + "\n"


def _table(
    values: Mapping[str, Any], texts: Texts, declared: Mapping[str, Key], prefix: str
) -> Iterator[str]:
    """Yield the lines of a table, its own keys before its sub-tables, as TOML requires."""
    tables = {key: value for key, value in values.items() if _is_tables(value)}
    for key, value in values.items():
        if key not in tables:
            yield from ("", *_comment(texts.get(prefix + key, {})), f"{key} = {_value(value)}")
    yield from _offers(values, texts, declared, prefix)
    for key, value in tables.items():
        many = isinstance(value, list)
        for one in value if many else [value]:
            yield from ("", *_comment(texts.get(prefix + key, {})))
            yield f"[[{prefix}{key}]]" if many else f"[{prefix}{key}]"
            yield from _table(one, texts, declared, f"{prefix}{key}.")


def _offers(
    values: Mapping[str, Any], texts: Texts, declared: Mapping[str, Key], prefix: str
) -> Iterator[str]:
    """Yield commented lines for the keys of a table that may be added, and for its optional tables."""
    head = [""]
    for dotted, key in declared.items():
        name, text = dotted.removeprefix(prefix), texts.get(dotted, {})
        offer = text.get("example", "" if isinstance(key.default, dict) else _written(key.default))
        if not dotted.startswith(prefix) or "." in name or name in values or not (offer and text):
            continue
        yield from head
        yield from textwrap.wrap(
            f"{name} = {offer} ".ljust(_VALUES) + "# " + _sentences(text),
            _COLUMNS,
            initial_indent="# ",
            subsequent_indent="# ".ljust(_VALUES + 2) + "# ",
            break_on_hyphens=False,
        )
        head = []
    inner = {name.removeprefix(prefix).partition(".")[0] for name in declared if name.startswith(prefix)}
    for table in sorted(name for name in inner if f"{prefix}{name}" not in declared and name not in values):
        below = f"{prefix}{table}."
        if all(key.default is not REQUIRED for name, key in declared.items() if name.startswith(below)):
            yield from ("", *_comment(texts.get(prefix + table, {})), f"# [{prefix}{table}]")
            yield from list(_offers({}, texts, declared, below))[1:]


def _is_tables(value: object) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and any(isinstance(v, dict) for v in value))


def _value(value: Any) -> str:
    if isinstance(value, list) and any(isinstance(v, str | list) for v in value):
        return "[\n" + "".join(f"  {toml_value(v)},\n" for v in value) + "]"
    return toml_value(value)


def _written(default: Any) -> str:
    """Return a default as in a file; "" if there is none."""
    if isinstance(default, list | tuple):
        return f"[{', '.join(map(_written, default))}]"
    if default is None or default is REQUIRED:
        return ""
    return toml_value(default) if isinstance(default, str | bool) else f"{default:g}"


def _sentences(text: Mapping[str, str]) -> str:
    return f"{text['what'].removesuffix('.')}. {text.get('measure', '')}".rstrip() if text else ""


def _comment(text: Mapping[str, str], name: str = "") -> list[str]:
    return textwrap.wrap(
        _sentences(text).replace("{name}", name),
        _COLUMNS,
        initial_indent="# ",
        subsequent_indent="# ",
        break_on_hyphens=False,
        break_long_words=False,
    )
