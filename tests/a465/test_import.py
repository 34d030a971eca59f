"""`import a465`: the names of the front door, loaded at their first use."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import a465
import plan.api

ROOT = Path(a465.__file__).resolve().parents[2]


def _python(program: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=folder, timeout=600, check=False
    )


@pytest.mark.parametrize("name", a465.__all__)
def test_every_name_is_found_and_described(name: str) -> None:
    assert getattr(a465, name).__doc__
    assert f"`{name}`" in (a465.__doc__ or "")


@pytest.mark.parametrize("name", plan.api.__all__)
def test_names_of_the_planner_are_the_same_objects(name: str) -> None:
    assert getattr(a465, name) is getattr(plan.api, name)
    assert name in dir(a465)


def test_certify_is_the_proof_over_a_curve() -> None:
    assert a465.certify is plan.api.certify is plan.api.certify_curve


def test_what_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'never_was'; dir"):
        importlib.import_module("a465").never_was  # noqa: B018


def test_an_import_loads_nothing_and_the_driver_no_planner(tmp_path: Path) -> None:
    program = (
        "import sys, a465\n"
        "print(any(room in sys.modules for room in ('arm', 'plan', 'numpy')))\n"
        "a465.Mars, a465.load_unit('crs93')\n"
        "print('pinocchio' in sys.modules or 'coal' in sys.modules)"
    )
    assert _python(program, tmp_path).stdout.split() == ["False", "False"]


def test_a_shadowed_room_is_named_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "plan.py").write_text("")
    ran = _python("import a465; a465.load_unit('crs93')", tmp_path)
    assert ran.returncode == 1
    assert f"{tmp_path / 'plan.py'} is found instead of a465's own plan" in ran.stderr.splitlines()[-1]


def test_types_are_shipped() -> None:
    rooms = [path.parent for path in (ROOT / "src").glob("*/__init__.py")]
    assert len(rooms) == 8
    assert all((room / "py.typed").is_file() for room in rooms)
