"""Former names of public modules are found, give the same objects, and say where these stand now."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from arm.former import PLACES


@pytest.mark.parametrize("name", sorted(PLACES))
def test_a_former_name_gives_the_same_objects_and_says_where_they_are(name: str) -> None:
    now = importlib.import_module(PLACES[name])
    sys.modules.pop(name, None)
    with pytest.warns(DeprecationWarning, match=f"{name} is {PLACES[name]} now"):
        former = importlib.import_module(name)
    public = [n for n in vars(now) if not n.startswith("_")]
    assert public
    assert all(getattr(former, n) is getattr(now, n) for n in public)


def test_what_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("plan.never_was")


def test_a_program_of_the_version_before_imports_as_it_did() -> None:
    program = "from plan.check import check_move; import driver.stepped; print(check_move.__module__)"
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert ran.stdout.strip() == "plan.collision.certificate"
