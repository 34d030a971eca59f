"""What tests of the preview in a browser share."""

from __future__ import annotations

from pathlib import Path

import pytest

from pages.preview import write_case


@pytest.fixture(scope="module")
def page_file(preview_case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("preview") / "plan.html"
    write_case(preview_case, path)
    return path
