"""What a value that breaks its rule was rather meant to be: text for a number, too many or too few."""

from __future__ import annotations

import re

_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*", re.ASCII)
_WITH_UNIT = re.compile(
    r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*(mm/s|mm|cm|m|deg|°|rad|ms|us|s|%|V|kg|g|N)\s*", re.ASCII
)


def as_text(value: object) -> str:
    """Say how a text, or a list of texts, would be a number; "" if it would not."""
    given = value if isinstance(value, list) else [value]
    texts = [one for one in given if isinstance(one, str)]
    if not texts or len(texts) < len(given):
        return ""
    if all(_NUMBER.fullmatch(one) for one in texts):
        return "a number stands without quotation marks"
    if any(_COMMA.fullmatch(one) for one in texts):
        return "the decimal sign is a point, and a number stands without quotation marks"
    if all(_WITH_UNIT.fullmatch(one) for one in texts):
        return "a number stands without its unit, which the key names, and without quotation marks"
    parts = re.split(r"[,;\s]+", value.strip("[]() ")) if isinstance(value, str) else []
    if len(parts) > 1 and all(map(_NUMBER.fullmatch, parts)):
        return "a list stands in square brackets, without quotation marks"
    return ""


def number_of(text: str) -> list[float]:
    """Return the number that a text is, whole if it has no point; none if it is no number."""
    if not _NUMBER.fullmatch(text):
        return []
    return [int(text) if text.strip().lstrip("+-").isdigit() else float(text)]


def other_count(given: object, wanted: int | None) -> str:
    """Say how many values a list has instead of `wanted`; "" if that is not what is wrong."""
    if wanted is None or not isinstance(given, list) or len(given) == wanted:
        return ""
    if any(isinstance(one, list | dict) for one in given):
        return ""
    return f"it has {len(given) or 'none'}"
