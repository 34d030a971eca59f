"""Words of a command line that the shell, a word processor or a web page has changed: refused before they are read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from arm.errors import InputError

_DASHES = {
    "\N{EN DASH}": "an en dash",
    "\N{EM DASH}": "an em dash",
    "\N{MINUS SIGN}": "a minus sign of mathematics",
    "\N{HYPHEN}": "a typographic hyphen",
}
_DASH = re.compile(rf"^[{''.join(_DASHES)}]|(?<=[=,\s])[{''.join(_DASHES)}](?=[\d.])")
MOST_WORDS = 4  # of a path with spaces
_QUOTES = "\u201c\u201d\u201e\u201f\u2018\u2019\u201a\u00ab\u00bb"  # double, single, angular


def refuse_mistyped(typed: Sequence[str]) -> None:
    """Refuse empty words, and dashes and quotation marks as a word processor writes them.

    Args:
        typed: the command line after the program's name.

    Raises:
        InputError: names the word, or both halves of a path that the shell split, and what to type.
    """
    if split := _split_path(typed):
        raise InputError(f"a path with a space needs quotes: '{split}'", argument=split)
    for before, word in pairwise(["", *typed]):
        if not word or (word.startswith("--") and word.endswith("=")):
            after = before if before.startswith("-") else f"the argument after {before or 'a465'}"
            where = word.removesuffix("=") or after
            raise InputError(f"{where} is empty; is a variable of the shell not set?", option=where)
        if Path(word.partition("=")[2] or word).exists():  # a name may have any sign
            continue
        if found := _DASH.search(word):
            what = f"{_DASHES[found[0]]} where the keyboard's - belongs, as a word processor makes it"
            raise InputError(f"{word}: has {what}; type it again", option=word)
        if found := re.search(f"^[{_QUOTES}]|[{_QUOTES}]$|=[{_QUOTES}]", word):
            what = "a typographic quotation mark, as a word processor makes it, which the shell does not know"
            raise InputError(f"{word}: has {what}; type ' or \"", option=word)


def _split_path(typed: Sequence[str]) -> str:
    """Return a path with spaces of which the shell made several words; "" if there is none."""
    for first in range(len(typed)):
        for count in range(2, MOST_WORDS + 1):
            path = " ".join(typed[first : first + count])
            if not typed[first].startswith("-") and not Path(typed[first]).exists() and Path(path).is_file():
                return path
    return ""
