"""Every command of README.md and docs/ does what its page says: typed in order, page by page, with no arm there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import webbrowser
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
import typer.main

import cell.cli.main
import cell.collect.collector
import cell.session.connection
import driver.mars.session
from calib.nao.chain import NaoUnknowns
from cell.files.task import read_task
from cell.session.connection import simulated_cell
from driver.line.clock import Clock
from recorded.nao import as_json, nao_recording
from tasks.small import small_scenes
from typed.doc_commands import TIME_SCALE, Reader, options_of, require_script, require_target, unknown_to
from typed.doc_output import unlike
from typed.doc_pages import ROOT, Block, Command, blocks, commands, followed, pages, told_by_the_way
from typed.steady_camera import SteadyCamera

pytestmark = pytest.mark.slow
TOGETHER = (  # pages that one reader follows one after the other: each goes on where those before it ended
    ("docs/quick-start.md", "docs/logs.md", "docs/execution.md"),
    ("docs/calibration-guide.md", "docs/calibration.md"),
)
IN_ITS_OWN_TEST = {  # pages whose commands another test types, in full
    "docs/interop.md": "tests/cell/files/test_pose_list.py",
    "docs/python.md": "tests/plan/test_api.py",
    "docs/simulated-cell.md": "tests/cell/collect/test_realistic_cell.py",
}
EMULATED = re.compile(r"the arm on \S+ \(an emulated one, unless that line leads to a real arm\)")
POOL = 60  # poses from which those for a target in the hand are chosen
GIVEN = {  # what the Python of a page has from its reader
    "docs/pose-pairs.md": """
import numpy as np
from arm.se3 import inverse, rotation, transform
rng = np.random.default_rng(4)
T_base_gripper = np.array([transform(rotation(rng.normal(0, 0.7, 3)), rng.normal(0, 0.3, 3)) for _ in range(30)])
X, Y = transform(rotation([0.1, 0.2, 0.3]), [0, 0, 0.1]), transform(rotation([3.0, 0, 0]), [1, 0, 1])
near = lambda: transform(rotation(rng.normal(0, 1e-3, 3)), rng.normal(0, 1e-4, 3))
T_camera_target = np.array([inverse(Y) @ T @ X @ near() for T in T_base_gripper])
""",
}


def of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def typed() -> list[object]:
    """Pages with something to type, each or those that belong together in a group of its own."""
    alone = [
        (of(page),)
        for page in pages()
        if of(page) not in IN_ITS_OWN_TEST and not any(of(page) in some for some in TOGETHER)
    ]
    return [
        pytest.param(some, marks=pytest.mark.xdist_group(some[0]), id="+".join(some))
        for some in (*TOGETHER, *alone)
        if any(any(followed(ROOT / page)) for page in some)
    ]


@pytest.mark.long
@pytest.mark.parametrize("some", typed())
def test_what_a_page_says_can_be_done(
    some: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (cell.session.connection, driver.mars.session):
        monkeypatch.setattr(module, "Clock", lambda scale=TIME_SCALE: Clock(scale))
    monkeypatch.setattr(webbrowser, "open", lambda *_: True)
    monkeypatch.setattr(cell.collect.collector, "POOL", POOL)
    reader = Reader(tmp_path, monkeypatch.setenv)
    if "docs/nao.md" in some:
        seen, _ = nao_recording(3, NaoUnknowns())
        (tmp_path / "recording.json").write_text(json.dumps(as_json(seen)))
    try:
        for page in some:
            names: dict[str, object] = {}
            exec(GIVEN.get(page, ""), names)
            for part in followed(ROOT / page):
                follow(reader, part, names, f"{page}:{part.line}")
            reader.turn_the_page()
    finally:
        reader.close()


def follow(reader: Reader, part: Block | Command, names: dict[str, object], where: str) -> None:
    try:
        if isinstance(part, Command):
            reader.type(part)
        elif part.file:
            (reader.folder / part.file).write_text(part.text)
        elif part.language == "text":
            # pages show what a person beside a real arm reads
            missing = unlike(part.text, EMULATED.sub("the real arm on /dev/mars", reader.said))
            assert not missing, f"nobody said {missing} in {reader.said[-3000:]}"
        else:
            code = reader.with_an_emulated_port(part.text)
            with chdir(reader.folder):
                exec(compile(code, where, "exec"), names)
    except AssertionError as error:
        raise AssertionError(f"{where}: {error}") from error


def test_the_images_of_an_emulated_unit_follow_from_the_state_of_its_cell(tmp_path: Path) -> None:
    """Not from how many there were before, which depends on the host's load."""
    task = read_task(small_scenes(tmp_path) / "task2.toml")
    simulated, counts = simulated_cell(task, None), task.cell.unit.counts(task.cell.q_start)
    camera = SteadyCamera(simulated, task.cell.camera, lambda: counts, task.cell.dictionary)
    first = camera.grab(2)
    assert np.array_equal(camera.grab(2), first)
    assert not np.array_equal(first[0], first[1])
    simulated.history.append(simulated.history[-1])
    assert not np.array_equal(camera.grab(1)[0], first[0])


def test_commands_are_found_where_a_reader_sees_them() -> None:
    text = """Words.
```
a465 look x.toml   # a comment, exit code 3
not a command
```
```sh
$ make run
```
<!-- file: a.csv -->
```sh
a465 is a file here
```
```toml
a465 = 1
```
"""
    found = [command for block in blocks(text) for command in commands(block)]
    assert found == [Command(3, ("a465", "look", "x.toml"), 3), Command(7, ("make", "run"), 0)]
    with pytest.raises(ValueError, match="line 2: nobody knows how to check 'rm -r x'"):
        commands(blocks("```sh\nrm -r x\n```\n")[0])


def test_every_page_that_this_one_leaves_out_is_in_the_other_test() -> None:
    for page, test in IN_ITS_OWN_TEST.items():
        assert page in (ROOT / test).read_text()


def test_many_commands_are_typed_here() -> None:
    verbs = [
        part.words[1]
        for page in pages()
        for part in followed(page)
        if isinstance(part, Command) and part.words[0] == "a465"
    ]
    told = subprocess.run(
        [sys.executable, "-c", "from cell.cli.start import main; main()", "--help"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert set(verbs) == set(re.findall(r"^  ([a-z][a-z-]*) ", told, re.MULTILINE))


def test_commands_inside_sentences_have_verbs_and_options_that_there_are() -> None:
    command = typer.main.get_command(cell.cli.main.app)
    known = ("look TASK", "calibrate --collect", "check X --q=-60,-40", "run --json", "--install-completion")
    assert [unknown_to(command, tuple(line.split())) for line in known] == [[]] * len(known)
    for line, unknown in (("lok TASK", "lok"), ("calibrate eye", "eye"), ("look --prt=/dev/mars", "--prt")):
        assert unknown_to(command, tuple(line.split())) == [unknown]
    told = [(of(page), words) for page in pages() for words in told_by_the_way(page.read_text())]
    assert len(told) > 50
    assert [(page, words) for page, words in told if unknown_to(command, words)] == []


@pytest.mark.parametrize(
    ("words", "offered"), [("a465 cal", "calibrate"), ("a465 execute --res", "--resume")]
)
def test_a_shell_can_complete_commands_and_options(words: str, offered: str) -> None:
    asked = {"_A465_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    told = subprocess.run(
        [Path(sys.executable).with_name("a465")],
        env=os.environ | asked,
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.split() == [offered]


def test_a_script_a_target_and_an_option_that_are_not_there_are_told() -> None:
    assert {"--scenes"} <= options_of(ROOT / "bench/boards.py")
    checks: list[tuple[Callable[[], None], str]] = [
        (lambda: require_script(("python", "bench/none.py")), "there is no bench/none.py"),
        (lambda: require_script(("python", "bench/boards.py", "--none=3")), "bench/boards.py has no --none"),
        (lambda: require_target("nothing"), "no target nothing"),
    ]
    for check, told in checks:
        with pytest.raises(AssertionError, match=told):
            check()


def test_what_is_shown_must_have_been_said() -> None:
    said = "[  0.4 s] plan 8d29db7de06c: 7 moves hold\ncube  from\n   1  01-02/1"
    assert unlike("[ 12.0 s] plan 0029db7de06c: 28 moves hold\n----  ---\n1  03-04/2\n...", said) == []
    assert unlike("plan ... 3 moves hold", said) == []
    assert unlike("cube  to\n7 moves fail", said) == ["cube  to", "7 moves fail"]
