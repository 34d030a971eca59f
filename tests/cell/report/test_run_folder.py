"""A folder is one run's alone, also where several begin at the same moment."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.report.run_folder import LOG, require_new_folder, require_no_pictures, run_folder
from typed.command_line import a465

TAKE = """
import sys, time
from pathlib import Path
from arm.errors import InputError
from cell.report.run_folder import run_folder

asked = Path(sys.argv[1]) if len(sys.argv) > 1 else None
print("ready", flush=True)
sys.stdin.readline()
try:
    with run_folder(asked, "task2") as folder:
        (folder / "wire.jsonl").write_text("mine")
        print(folder, flush=True)
except InputError as error:
    print(f"refused: {error}", flush=True)
"""


def _at_once(count: int, folder: Path, *asked: str) -> list[str]:
    """What so many programs say that take a folder at the same moment."""
    children = [
        subprocess.Popen(
            [sys.executable, "-c", TAKE, *asked],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(count)
    ]
    try:
        for child in children:
            assert child.stdout is not None
            assert child.stdout.readline() == "ready\n"
        for child in children:
            assert child.stdin is not None
            child.stdin.write("go\n")
            child.stdin.flush()
        return [child.communicate(timeout=600.0)[0].strip() for child in children]
    finally:
        for child in children:
            child.kill()
            child.wait()


def test_four_runs_at_once_have_four_folders(tmp_path: Path) -> None:
    assert sorted(_at_once(4, tmp_path)) == [f"runs/task2-{n}" for n in (1, 2, 3, 4)]


@pytest.mark.parametrize("there", [False, True])
def test_of_four_that_ask_for_the_same_one_has_it(tmp_path: Path, there: bool) -> None:
    if there:
        (tmp_path / "mine").mkdir()
    told = _at_once(4, tmp_path, "mine")
    assert sorted(told)[0] == "mine"
    assert all(
        line.startswith("refused: mine: ") and "runs are not mixed" in line for line in sorted(told)[1:]
    )


def test_runs_are_not_mixed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for number in (1, 2):
        with run_folder(None, "task2") as folder:
            assert folder == Path(f"runs/task2-{number}")
            (folder / "plan.json").touch()
    with run_folder(tmp_path / "a/new", "task2") as folder:
        assert folder == tmp_path / "a/new"
    (tmp_path / "full").mkdir()
    (tmp_path / "full/plan.json").touch()
    for taken in (tmp_path / "full", tmp_path / "full/plan.json"):
        with pytest.raises(InputError, match="new or empty folder"):
            require_new_folder(taken)
        with pytest.raises(InputError, match="new or empty folder"), run_folder(taken, "task2"):
            pass
    with pytest.raises(InputError, match="cannot be made"), run_folder(Path("full/plan.json/in"), "task2"):
        pass


def test_a_run_that_writes_nothing_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for asked in (None, tmp_path / "empty", tmp_path / "new"):
        with run_folder(asked, "task2") as folder:
            assert [p.name for p in folder.iterdir()] == [LOG]
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["empty", "runs"]
    with run_folder(None, "task2") as folder:
        (folder / LOG).write_text("{}")
    assert (tmp_path / "runs/task2-1" / LOG).read_text() == "{}"


def test_what_killed_runs_left_half_written_is_removed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = tmp_path / "runs/task2-1"
    before.mkdir(parents=True)
    (before / ".report.json.a465-0123456789ab").touch()
    (before / LOG).touch()
    with run_folder(None, "task2"):
        pass
    assert [p.name for p in before.iterdir()] == [LOG]


def test_of_two_that_look_at_the_same_moment_one_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cell.report.run_folder.require_new_folder", lambda asked: None)
    with run_folder(tmp_path / "mine", "task2") as folder:
        refusal = pytest.raises(InputError, match="another run has just begun there; runs are not mixed")
        with refusal, run_folder(tmp_path / "mine", "task2"):
            pass
        assert [p.name for p in folder.iterdir()] == [LOG]


def test_pictures_of_a_run_are_no_images_of_the_camera(tmp_path: Path) -> None:
    (tmp_path / LOG).touch()
    for name in ("seen-1.png", "photograph-001.png"):
        (tmp_path / name).touch()
    require_no_pictures(tmp_path)  # images that were put beside a log
    (tmp_path / "look-1.png").touch()
    rule = "is the folder of a run: its look-N.png are drawn over, and of different moments; give a folder of images"
    with pytest.raises(InputError, match=rule):
        require_no_pictures(tmp_path)
    _, told = a465("look", data_file("scenes/task2.toml"), "--images", tmp_path, code=2)
    assert rule in told
    (tmp_path / LOG).unlink()
    require_no_pictures(tmp_path)
