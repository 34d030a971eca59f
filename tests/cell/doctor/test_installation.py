"""Versions and libraries as `a465 doctor` finds them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cell.doctor import installation as doctorinstall
from cell.doctor.finding import NOTE, OK, WRONG

pytestmark = pytest.mark.xdist_group("doctor")


@pytest.mark.parametrize(
    ("installed", "asked", "good"),
    [
        ("4.14.0.94", "<5,>=4.14", True),
        ("4.13.9", "<5,>=4.14", False),
        ("5.0", "<5,>=4.14", False),
        ("5", "<5.0", False),
        ("4.10", ">=4.9", True),
        ("3.11.7", ">=3.11", True),
        ("2.0.1", "==2.0.1", True),
        ("2.0.2", "==2.0.1", False),
        ("2.0.1", "!=2.0.1", False),
        ("4.0rc1", ">=4", True),
        ("3", ">3", False),
        ("3.1", "<=3", False),
        ("1.0", "", True),
    ],
)
def test_versions_are_compared_by_their_numbers(installed: str, asked: str, good: bool) -> None:
    assert doctorinstall.fits(installed, asked) is good


def test_libraries_that_are_missing_or_too_old_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [
        "numpy>=99",
        "no-such-library",
        "scipy",
        "mcap>=99; extra == 'mcap'",
        "pypylon; extra == 'basler'",
    ]
    package = SimpleNamespace(requires=lines, metadata={"Requires-Python": ">=99.1"}, version="0")
    monkeypatch.setattr(doctorinstall, "distribution", lambda name: package)
    found = doctorinstall.libraries_finding()
    assert found.verdict == WRONG
    assert found.found == f"numpy {np.__version__} is not >=99; no-such-library is missing"
    mcap, basler = doctorinstall.extra_findings()
    assert (mcap.verdict, basler.verdict) == (NOTE, OK)
    assert "is not >=99; needed for a465 export --format mcap" in mcap.found
    assert "a465[mcap]" in mcap.help
    python = doctorinstall.python_finding()
    assert (python.verdict, python.help) == (WRONG, "a465 needs Python >=99.1")


def test_what_pyproject_asks_for_is_what_is_looked_at() -> None:
    of = doctorinstall.requirements(doctorinstall.distribution("a465"))
    assert {"numpy", "typer", "pyserial"} <= {r.name for r in of if not r.extra}
    assert {r.name for r in of if r.extra == "basler"} == {"pypylon"}
    assert next(r.asked for r in of if r.name == "pin" and not r.extra) == ">=4"
