"""A user's own ``cell.py`` or ``vision/`` is told by its name, by every command, in one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(sys.executable).with_name("a465")


def _run(
    *words: str, folder: Path, module: bool = True, path: Path | None = None
) -> subprocess.CompletedProcess[str]:
    begin = [sys.executable, "-m", "a465"] if module else [sys.executable, str(PROGRAM)]
    environment = {**os.environ, **({} if path is None else {"PYTHONPATH": str(path)})}
    return subprocess.run(
        [*begin, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600.0,
        check=False,
    )


def _own(folder: Path, name: str) -> Path:
    """A module or a package of a user, which must not be run; what is told of it."""
    text = "raise SystemExit('this ran')\n"
    if name.endswith(".py"):
        (folder / name).write_text(text)
        return folder / name
    (folder / name).mkdir()
    (folder / name / "__init__.py").write_text(text)
    return folder / name


@pytest.mark.parametrize("name", ["cell.py", "plan.py", "arm.py", "driver.py", "calib.py", "vision"])
@pytest.mark.parametrize("words", [("--version",), ("doctor",)], ids=lambda words: words[0])
def test_in_the_current_folder(tmp_path: Path, name: str, words: tuple[str, ...]) -> None:
    own = _own(tmp_path, name)
    ran = _run(*words, folder=tmp_path)
    assert ran.returncode == 2
    assert ran.stdout == ""
    assert ran.stderr.count("\n") == 1
    assert ran.stderr.startswith(
        f"a465: wrong input: {own} is found instead of a465's own {own.stem}: rename it, or "
    )


@pytest.mark.parametrize("module", [False, True])
def test_on_pythons_path(tmp_path: Path, module: bool) -> None:
    if not module and not PROGRAM.is_file():
        pytest.skip("a465 is not installed")
    own, other = _own(tmp_path, "cell.py"), tmp_path / "elsewhere"
    other.mkdir()
    ran = _run("doctor", "--json", folder=other, module=module, path=tmp_path)
    assert ran.returncode == 2
    assert str(own) in ran.stderr
    assert json.loads(ran.stdout)["error"]["exit_code"] == 2


def test_all_of_several_are_told(tmp_path: Path) -> None:
    own = [_own(tmp_path, name) for name in ("cell.py", "vision")]
    told = _run("--version", folder=tmp_path).stderr
    assert all(str(file) in told for file in own)


def test_the_program_in_the_current_folder_is_not_hindered_by_it(tmp_path: Path) -> None:
    """As installed, it does not look there."""
    if not PROGRAM.is_file():
        pytest.skip("a465 is not installed")
    _own(tmp_path, "cell.py")
    ran = _run("--version", folder=tmp_path, module=False)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_a_folder_that_is_no_package_hides_nothing(tmp_path: Path) -> None:
    (tmp_path / "vision").mkdir()
    (tmp_path / "plan").mkdir()
    ran = _run("--version", folder=tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.startswith("a465 ")
