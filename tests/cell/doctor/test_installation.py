"""Versions and libraries as `a465 doctor` finds them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cell.doctor import installation as doctorinstall
from cell.doctor.finding import NOTE, OK, WRONG

pytestmark = pytest.mark.xdist_group("doctor")


def test_libraries_that_are_missing_or_too_old_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [
        "numpy>=99",
        "typer<99,>=0.1",
        "no-such-library",
        "scipy",
        "never-on-this-system; sys_platform == 'never'",
        "mcap>=99; extra == 'mcap'",
        "mujoco-core>=99; extra == 'contact'",
        "pypylon; extra == 'basler'",
    ]
    package = SimpleNamespace(requires=lines, metadata={"Requires-Python": ">=99.1"}, version="0")
    monkeypatch.setattr(doctorinstall, "distribution", lambda name: package)
    found = doctorinstall.check_libraries()
    assert found.verdict == WRONG
    assert found.found == f"numpy {np.__version__} is not >=99; no-such-library is missing"
    mcap, contact, basler = doctorinstall.check_extras()
    assert (mcap.verdict, contact.verdict, basler.verdict) == (NOTE, NOTE, OK)
    assert "is not >=99; needed for a465 export --format mcap" in mcap.found
    assert "a465[mcap]" in mcap.help
    python = doctorinstall.check_python()
    assert (python.verdict, python.help) == (WRONG, "a465 needs Python >=99.1")


def test_what_pyproject_asks_for_is_what_is_looked_at() -> None:
    package = doctorinstall.distribution("a465")
    always = doctorinstall.requirements(package)
    assert {"numpy", "typer", "pyserial"} <= always.keys()
    assert str(always["pin"]) == ">=4"
    assert doctorinstall.requirements(package, "basler").keys() == {"pypylon"}
    assert doctorinstall.requirements(package, "contact").keys() == {"mujoco-core"}


@pytest.mark.parametrize(
    ("now", "good"), [("4.13.9", False), ("4.14", True), ("4.14.1rc1", True), ("5.0", False)]
)
def test_versions_are_compared_as_pip_does(now: str, good: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    package = SimpleNamespace(requires=["numpy>=4.14,<5"], metadata={}, version="0")
    monkeypatch.setattr(doctorinstall, "distribution", lambda name: package)
    monkeypatch.setattr(doctorinstall, "version", lambda name: now)
    assert doctorinstall.check_libraries().verdict == (OK if good else WRONG)
