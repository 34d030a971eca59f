"""``a465 doctor``: Python, a465 and its libraries, against what the package says it needs."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution, version

from cell.doctor.finding import NOTE, OK, REINSTALL, WRONG, Finding

EXTRAS = {
    "mcap": ("a465 export --format mcap", "make mcap, or pip install 'a465[mcap]'"),
    "basler": ("Basler cameras", "make basler, or pip install 'a465[basler]'"),
}
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)\s*\(?([^;)]*)\)?\s*(?:;\s*extra == ['\"]([^'\"]+)['\"])?")
_CLAUSE = re.compile(r"(>=|<=|==|!=|>|<)\s*([0-9][0-9.]*)")


@dataclass(frozen=True)
class Requirement:
    """A library that a465 needs.

    Attributes:
        name: of its distribution.
        asked: versions that do, such as ``<5,>=4.14``; "" for any.
        extra: that needs it; "" if all do.
    """

    name: str
    asked: str
    extra: str

    def there(self) -> str | None:
        """The version that is installed, or None."""
        try:
            return version(self.name)
        except PackageNotFoundError:
            return None


def python_finding() -> Finding:
    """The interpreter and what it runs on."""
    package = distribution("a465")
    asked = package.metadata["Requires-Python"] or ""
    now = platform.python_version()
    found = f"Python {now} on {platform.system()} {platform.machine()}; a465 {package.version}"
    data = {
        "python": now,
        "requires_python": asked,
        "system": platform.system(),
        "machine": platform.machine(),
        "a465": package.version,
    }
    if not fits(".".join(map(str, sys.version_info[:3])), asked):
        return Finding("Python", WRONG, found, f"a465 needs Python {asked}", data)
    return Finding("Python", OK, found, "", data)


def libraries_finding() -> Finding:
    """The libraries that everything needs."""
    needed = [r for r in requirements(distribution("a465")) if not r.extra]
    there = {r.name: r.there() for r in needed}
    wrong = [_complaint(r, there[r.name]) for r in needed if not _good(r, there[r.name])]
    data = {"versions": there, "asked": {r.name: r.asked for r in needed}}
    if wrong:
        return Finding("libraries", WRONG, "; ".join(wrong), REINSTALL, data)
    shown = ", ".join(f"{name} {v}" for name, v in there.items())
    return Finding("libraries", OK, f"{len(needed)} as needed: {shown}", "", data)


def extra_findings() -> Iterator[Finding]:
    """What may be added."""
    needed = requirements(distribution("a465"))
    for extra, (what, help) in EXTRAS.items():
        of = [r for r in needed if r.extra == extra]
        there = {r.name: r.there() for r in of}
        shown = ", ".join(f"{name} {v}" for name, v in there.items() if v)
        if all(_good(r, there[r.name]) for r in of):
            yield Finding(f"extra {extra}", OK, shown, "", {"versions": there})
        else:
            missing = "; ".join(_complaint(r, there[r.name]) for r in of if not _good(r, there[r.name]))
            yield Finding(f"extra {extra}", NOTE, f"{missing}; needed for {what}", help, {"versions": there})


def requirements(package: Distribution) -> list[Requirement]:
    """What a package says that it needs."""
    return list(_read(package.requires or ()))


def _read(lines: Iterable[str]) -> Iterator[Requirement]:
    for line in lines:
        match = _REQUIREMENT.fullmatch(line.strip())
        if match:
            yield Requirement(match[1], match[2].strip(), match[3] or "")


def fits(installed: str, asked: str) -> bool:
    """Whether a version satisfies clauses such as ``<5,>=4.14``; only leading numbers are compared."""
    now = _numbers(installed)
    return all(_holds(now, mark, _numbers(than)) for mark, than in _CLAUSE.findall(asked))


def _holds(now: tuple[int, ...], mark: str, than: tuple[int, ...]) -> bool:
    length = max(len(now), len(than))
    a, b = (numbers + (0,) * (length - len(numbers)) for numbers in (now, than))
    return {">=": a >= b, "<=": a <= b, "==": a == b, "!=": a != b, ">": a > b, "<": a < b}[mark]


def _numbers(text: str) -> tuple[int, ...]:
    leading = re.match(r"\d+(?:\.\d+)*", text)
    return tuple(int(part) for part in leading[0].split(".")) if leading else ()


def _good(needed: Requirement, there: str | None) -> bool:
    return there is not None and fits(there, needed.asked)


def _complaint(needed: Requirement, there: str | None) -> str:
    return f"{needed.name} is missing" if there is None else f"{needed.name} {there} is not {needed.asked}"
