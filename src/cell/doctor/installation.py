"""``a465 doctor``: check Python, a465 and its libraries against the requirements of the package."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import Distribution, PackageNotFoundError, distribution, version

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from cell.doctor.finding import NOTE, OK, REINSTALL, WRONG, CheckResult

EXTRAS = {
    "mcap": ("a465 export --format mcap", "make mcap, or pip install 'a465[mcap]'"),
    "contact": ("a465 run --cell mujoco", "make contact, or pip install 'a465[contact]'"),
    "basler": ("Basler cameras", "make basler, or pip install 'a465[basler]'"),
}


def check_python() -> CheckResult:
    """Check the interpreter; report the platform."""
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
    if not SpecifierSet(asked).contains(now, prereleases=True):
        return CheckResult("Python", WRONG, found, f"a465 needs Python {asked}", data)
    return CheckResult("Python", OK, found, "", data)


def check_libraries() -> CheckResult:
    """Check the required libraries."""
    needed = requirements(distribution("a465"))
    there = _installed(needed)
    wrong = _complaints(needed, there)
    data = {"versions": there, "asked": {name: str(asked) for name, asked in needed.items()}}
    if wrong:
        return CheckResult("libraries", WRONG, "; ".join(wrong), REINSTALL, data)
    shown = ", ".join(f"{name} {v}" for name, v in there.items())
    return CheckResult("libraries", OK, f"{len(needed)} as required: {shown}", "", data)


def check_extras() -> Iterator[CheckResult]:
    """Check the optional libraries."""
    for extra, (what, help) in EXTRAS.items():
        needed = requirements(distribution("a465"), extra)
        there = _installed(needed)
        missing = "; ".join(_complaints(needed, there))
        if missing:
            found = f"{missing}; needed for {what}"
            yield CheckResult(f"extra {extra}", NOTE, found, help, {"versions": there})
        else:
            shown = ", ".join(f"{name} {v}" for name, v in there.items())
            yield CheckResult(f"extra {extra}", OK, shown, "", {"versions": there})


def requirements(package: Distribution, extra: str = "") -> dict[str, SpecifierSet]:
    """Return the libraries that a package requires, always or for an extra, with the accepted versions."""
    stated = [Requirement(line) for line in package.requires or ()]
    always = {r for r in stated if extra and _holds(r, "")}
    return {r.name: r.specifier for r in stated if _holds(r, extra) and r not in always}


def _holds(needed: Requirement, extra: str) -> bool:
    return needed.marker is None or needed.marker.evaluate({"extra": extra})


def _installed(names: Iterable[str]) -> dict[str, str | None]:
    """Return the installed version of each library, or None."""
    found: dict[str, str | None] = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


def _complaints(needed: Mapping[str, SpecifierSet], there: Mapping[str, str | None]) -> list[str]:
    """Return the libraries that are missing or have another version, in words."""
    return [
        f"{name} is missing" if now is None else f"{name} {now} is not {asked}"
        for name, asked in needed.items()
        if (now := there[name]) is None or not asked.contains(now, prereleases=True)
    ]
