"""The README's commands in a path with spaces, and with a Python that is too old; Python and pip are stand-ins here."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from typed.doc_pages import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="needs make")

NEW = """#!/bin/sh
case "$*" in
  "-c "*) exit 0 ;;
  "-m venv "*) mkdir -p "$4/bin" && cp "$0" "$4/bin/python" ;;
  "-m pip "*)
    [ -f "$PIP_CONSTRAINT" ] && [ -f "$PIP_BUILD_CONSTRAINT" ] || { echo "no constraints: $PIP_CONSTRAINT"; exit 1; }
    "$4" -c "" || exit 1
    printf '#!/bin/sh\\necho "a465 $*"\\n' > "$(dirname "$4")/a465"
    chmod +x "$(dirname "$4")/a465" ;;
  *) echo "asked for $*"; exit 1 ;;
esac
"""
OLD = """#!/bin/sh
[ "$1" = --version ] && echo "Python 3.10.12" && exit 0
[ "$1" = -c ] || echo "ResolutionImpossible"
exit 1
"""


def _make(folder: Path, python: str, *words: str) -> subprocess.CompletedProcess[str]:
    folder.mkdir(parents=True)
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, folder / name)
    interpreter = folder.parent / "python of mine"
    interpreter.write_text(python)
    interpreter.chmod(0o755)
    plain = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "PIP_"))}
    return subprocess.run(
        ["make", "run", f"PYTHON={interpreter}", *words],
        cwd=folder,
        env=plain,
        capture_output=True,
        text=True,
        timeout=600.0,
        check=False,
    )


def test_make_run_works_in_a_path_with_spaces(tmp_path: Path) -> None:
    ran = _make(tmp_path / "my cell of today", NEW)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "a465 run scenes/realistic/task2.toml" in ran.stdout.splitlines()
    assert (tmp_path / "my cell of today/.venv/installed").is_file()


def test_the_environment_may_have_spaces_too_and_is_made_once(tmp_path: Path) -> None:
    venv = tmp_path / "my environments/one"
    ran = _make(tmp_path / "project", NEW, f"VENV={venv}")
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert (venv / "installed").is_file()
    again = subprocess.run(
        ["make", "run", "PYTHON=false", f"VENV={venv}"],
        cwd=tmp_path / "project",
        capture_output=True,
        text=True,
        timeout=600.0,
        check=False,
    )
    assert again.returncode == 0, again.stdout + again.stderr
    assert "installing" not in again.stdout


def test_a_python_that_is_too_old_is_told_in_one_line(tmp_path: Path) -> None:
    ran = _make(tmp_path / "project", OLD)
    assert ran.returncode != 0
    assert "ResolutionImpossible" not in ran.stdout + ran.stderr
    said = [line for line in (ran.stdout + ran.stderr).splitlines() if not line.startswith("make")]
    assert len(said) == 1
    assert "needs Python 3.11 or later" in said[0]
    assert "Python 3.10.12" in said[0]
    assert "make PYTHON=python3.11" in said[0]
    assert not (tmp_path / "project/.venv").exists()


def test_an_environment_of_an_old_python_is_told_too(tmp_path: Path) -> None:
    project = tmp_path / "project"
    old = tmp_path / "venv/bin/python"
    old.parent.mkdir(parents=True)
    old.write_text(OLD)
    old.chmod(0o755)
    ran = _make(project, NEW, f"VENV={tmp_path / 'venv'}")
    assert ran.returncode != 0
    assert f"needs Python 3.11 or later, and {old} is Python 3.10.12" in ran.stdout
    assert f"remove {tmp_path / 'venv'}" in ran.stdout
