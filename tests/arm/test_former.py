"""Former names of public modules are found, give the same objects, and say where these stand now."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.former import PLACES, FormerNames
from calib.model.chain import Chain, Fixed
from calib.nao.chain import NaoUnknowns
from plan.program.goals.target import Target

SOURCE = Path(importlib.import_module("arm").__file__ or "").parents[1]
MODULES = sorted(
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")
    for path in SOURCE.rglob("*.py")
    if re.search(r"^former_names\(", path.read_text(), re.M)
)


@pytest.mark.parametrize("name", sorted(PLACES))
def test_a_former_name_gives_the_same_objects_and_says_where_they_are(name: str) -> None:
    now = importlib.import_module(PLACES[name])
    sys.modules.pop(name, None)
    with pytest.warns(DeprecationWarning, match=f"{name} is {PLACES[name]} now"):
        former = importlib.import_module(name)
    public = [n for n in vars(now) if not n.startswith("_")]
    assert public
    assert all(getattr(former, n) is getattr(now, n) for n in public)


def test_an_unknown_module_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("plan.never_was")


def test_a_program_of_the_version_before_imports_as_it_did() -> None:
    program = "from plan.check import check_move; import driver.stepped; print(check_move.__module__)"
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=600
    )
    assert ran.stdout.strip() == "plan.collision.certificate"


@pytest.mark.parametrize("module", MODULES)
def test_a_module_gives_the_names_that_it_had(module: str) -> None:
    now = importlib.import_module(module)
    former = vars(now)["__getattr__"]
    assert isinstance(former, FormerNames)
    assert former.module == module
    assert former.names
    for name, new in former.names.items():
        with pytest.warns(DeprecationWarning, match=f"{module}.{name} is {former.place}.{new} now"):
            assert getattr(now, name) is getattr(importlib.import_module(former.place), new)


@pytest.mark.parametrize("module", MODULES)
def test_other_names_raise_attribute_error(module: str) -> None:
    with pytest.raises(AttributeError, match=f"{module}' has no attribute 'never_was'"):
        getattr(importlib.import_module(module), "never_was")  # noqa: B009  (mypy knows that it is not there)


def test_former_arguments_and_attributes_of_a_target() -> None:
    pairs = {("table", "cup")}
    with (
        pytest.warns(DeprecationWarning, match="Target: within is blend_radius now"),
        pytest.warns(DeprecationWarning, match="Target: touching is allowed_collisions now"),
    ):
        target = Target("a", np.eye(4), by="line", within=0.01, touching=pairs)  # type: ignore[call-arg]
    assert target.blend_radius == 0.01
    with pytest.warns(DeprecationWarning, match="Target: touching is allowed_collisions now"):
        assert target.touching == target.allowed_collisions  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="blend_radius = -1"):
        replace(target, blend_radius=-1.0)


def test_former_names_of_a_chain_and_of_its_unknowns() -> None:
    with (
        pytest.warns(DeprecationWarning, match="NaoUnknowns: springs is compliance now"),
        pytest.warns(DeprecationWarning, match="NaoUnknowns: play is backlash now"),
    ):
        unknowns = NaoUnknowns(springs=True, play=True)  # type: ignore[call-arg]
    assert unknowns == NaoUnknowns(compliance=True, backlash=True)
    chain = Chain((Fixed(np.diag([1.0, -1.0, -1.0, 1.0])),))
    with pytest.warns(DeprecationWarning, match="Chain: turned_round is inverse now"):
        back = chain.turned_round()  # type: ignore[attr-defined]
    assert np.array_equal(back.elements[0].T, chain.inverse().elements[0].T)
