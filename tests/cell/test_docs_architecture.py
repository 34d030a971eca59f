"""The walks on the page on architecture: each step's modules exist, and one of them has the type that it names."""

from __future__ import annotations

import re
from importlib import import_module

import pytest

from typed.doc_pages import ROOT

PAGE = (ROOT / "docs/architecture.md").read_text()
WALK, CALIBRATION = (
    re.findall(r"^\| (.+?) \| (`[a-z][^|]*) \| (.*)\|$", section.split("\n## ")[0], re.M)
    for section in (PAGE.split(heading)[1] for heading in ("## From an image", "## From images"))
)


def test_the_walk_is_as_long_as_the_page_says() -> None:
    modules, types = ({name for row in WALK for name in re.findall(r"`([^`]+)`", row[at])} for at in (1, 2))
    assert f"The steps above are {len(modules)} modules with {len(types)} types;" in PAGE


@pytest.mark.parametrize(("step", "modules", "types"), WALK + CALIBRATION, ids=lambda text: text[:30])
def test_a_step_names_modules_and_types_that_are_there(step: str, modules: str, types: str) -> None:
    found = [import_module(name) for name in re.findall(r"`([^`]+)`", modules)]
    assert found
    for name in re.findall(r"`([^`]+)`", types):
        assert any(hasattr(module, name) for module in found), (step, name)
