"""TOML files as Python values, with limits that keep any file fast and small in memory."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from arm.errors import FileInputError
from arm.io.foreign import markup, table, yaml
from arm.io.slips.syntax import place_of
from arm.io.storage import leaves, read_text, require_64_bits

MOST_PARTS = 16  # parts of a dotted key; those of this project have 4


def read_toml(path: Path) -> dict[str, Any]:
    """Return the values in a TOML file.

    Raises:
        FileInputError: the file is unreadable, or not TOML (the message has line and column).
    """
    return parse_toml(path, read_text(path, "TOML"))


def parse_toml(path: Path, text: str) -> dict[str, Any]:
    """Return the values in a text of TOML; `path` is for messages.

    Raises:
        FileInputError: it is not TOML.
    """
    try:
        _require_short_keys(path, text)
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        if text.lstrip().startswith(("{", '[{"')):
            rule = (
                "is JSON, such as a look or a plan, and a TOML file belongs here (are two arguments swapped?)"
            )
            raise FileInputError(path, "", None, rule) from error
        if foreign := markup(text) or table(text) or yaml(text):
            raise FileInputError(path, "", None, f"{foreign}, and a TOML file belongs here") from error
        raise FileInputError(
            path, "", None, f"is not valid TOML: {error}{place_of(text, str(error))}"
        ) from error
    except RecursionError as error:
        raise FileInputError(path, "", None, "is nested too deeply") from error
    except ValueError as error:  # thousands of digits
        raise FileInputError(path, "", None, f"has a number that is too long: {error}") from error
    for key, value in leaves(values):
        require_64_bits(path, key, value)
    return values


# Strings and comments. An unclosed string ends with its line, which keeps the search linear in the file's length.
_TEXT = re.compile(r'"(?:[^"\\\n]|\\.)*+"?|\'[^\'\n]*+\'?|#[^\n]*+')
_PARTS = re.compile(rf"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){{{MOST_PARTS}}}", re.ASCII)


def _require_short_keys(path: Path, text: str) -> None:
    """Require dotted keys of at most `MOST_PARTS` parts, because the memory of `tomllib` grows with their square.

    Raises:
        FileInputError: a key has more; the message names the line.
    """
    # replace quoted parts by words and remove comments
    plain = _TEXT.sub(lambda found: "" if found[0].startswith("#") else "_", text)
    if (found := _PARTS.search(plain)) is not None:
        line = plain.count("\n", 0, found.start()) + 1
        raise FileInputError(path, f"line {line}", None, f"has a key of more than {MOST_PARTS} parts")
