"""Mistakes that fresh eyes drew up from the docs alone: each is one line with its cause."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from typed.command_line import a465, replace_in

MIRRORED = [[1, 0, 0, 0.42], [0, 1, 0, 0], [0, 0, -1, 0.25], [0, 0, 0, 1]]


@pytest.fixture
def at(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The scenes as working folder, with files that are given in the wrong place."""
    monkeypatch.chdir(scenes)
    Path("t.json").write_text(json.dumps({"joint_names": ["J1"], "points": []}))
    Path("plan.json").write_text(json.dumps({"provenance": {}, "steps": []}))
    Path("plan.csv").write_text("time_s,J1_rad\n0,0\n")
    Path("mirrored.json").write_text(json.dumps({"entries": [{"T_base_tool": MIRRORED}]}))
    Path("metres.csv").write_text("1,0,0,0.42,0,-1,0,0.1,0,0,-1,0.25\n")
    Path("empty.toml").touch()
    Path("seen").mkdir()
    for number in (1, 2):
        cv2.imwrite(f"seen/{number}.png", np.zeros((8, 8), np.uint8))
    return scenes


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ("resume runs/task2-1", "(it is a465 execute PLAN --resume); see a465 --help"),
        ("abort", "(it is a465 stop); see a465 --help"),
        ("run task2.toml plan.json", "(a plan is executed by a465 execute plan.json TASK); see a465 run"),
        ("emulate task2.toml", "(a task is given by --task task2.toml); see a465 emulate"),
        (
            "look task2.toml --images seen/1.png seen/2.png",
            "(--images takes the folder of the images: --images seen)",
        ),
        (
            "preview plan.json task2.toml page.html",
            "(what is written is given by -o page.html); see a465 preview",
        ),
        (
            "certify cell.toml t.json",
            "t.json is a trajectory, which comes first: give a465 certify t.json cell.toml",
        ),
        (
            "execute plan.csv task2.toml",
            "plan.csv: is a table of samples, as a465 export writes it, and a JSON file",
        ),
        ("plan task2.toml --look look.json -o plan.html", "plan.html: must end in .json, as it is a plan"),
        ("look task2.toml -o look.csv", "look.csv: must end in .json, as it is a look"),
        (
            "look task2.toml --images seen --world task2.world.toml",
            "--world is of the simulated cell; there is none",
        ),
        (
            "run task2.toml -o day.html",
            "day.html: is the folder of the run, in which its page will be day/report.html",
        ),
        (
            "plan cell.toml mirrored.json -o p.json",
            "is mirrored, with determinant -1: one axis is reversed; a tool",
        ),
        (
            "plan cell.toml metres.csv --frame tool --lengths mm -o p.json",
            "(is it in m? then leave out --lengths mm)",
        ),
        ("status socket:127.0.0.1:5000", "port socket:127.0.0.1:5000: must be socket://127.0.0.1:5000"),
        ("status 192.168.0.7", "port 192.168.0.7: must be socket://192.168.0.7:PORT, or a device"),
        ("view .", ".: is a folder, must be a file"),
        ("plan empty.toml", "empty.toml: task: is missing; it must be one of clear-board, board-to-board"),
        ("plan task2.toml", "--look is missing: boards have to be seen; a465 look task2.toml -o look.json"),
        ("status /dev/mars:19200", "must be /dev/mars: the line's speed is fixed, and no part of the name"),
    ],
)
def test_one_line_tells_the_cause(typed: str, told: str, at: Path) -> None:
    said = a465(*typed.split(), code=2)[1]
    assert told in said
    assert sum(line.startswith("a465:") for line in said.splitlines()) == 1


@pytest.mark.parametrize(
    ("file", "old", "new", "typed", "told"),
    [
        (
            "task2.toml",
            "task = ",
            "speed = 0.2\ntask = ",
            "reach task2.toml",
            "(it belongs in [motion] of a cell file)",
        ),
        (
            "targets/hand.toml",
            "centre_mm = [110, 0, 100]",
            "centre_mm = [0.11, 0, 0.1]",
            "calibrate hand-eye r.json --collect task2.toml --target targets/hand.toml",
            "hand.centre_mm = [0.11, 0, 0.1]: must be [0, 0, 0], or 0.5 mm or more from there (is it in metres?)",
        ),
        (
            "pallet.toml",
            "[70, 52, 36]",
            "[70, 52, 0]",
            "plan pallet.toml -o p.json",
            "or correct part.box_mm, part.at_mm or grid.step_mm",
        ),
        (
            "task2.world.toml",
            "[[boards]]",
            'camera = "small.toml"\n[[boards]]',
            "look task2.toml",
            "task2.world.toml: camera: takes 1280 x 800 px, and the cell's camera 1920 x 1200: the lens may differ",
        ),
    ],
)
def test_one_line_tells_the_key(file: str, old: str, new: str, typed: str, told: str, at: Path) -> None:
    small = Path("cameras/lab.toml").read_text().replace("[1920, 1200]", "[1280, 800]")
    Path("small.toml").write_text(small)
    replace_in(Path(file), old, new)
    ended = a465(*typed.split(), code=3 if "pallet" in file else 2)[1]
    assert told in ended


def test_images_of_another_time_are_told(at: Path, tmp_path: Path) -> None:
    folder = tmp_path / "one"
    a465("render", "task2.toml", "-o", folder, "--count", "5")
    dark = np.zeros((1200, 1920), np.uint8)
    cv2.imwrite(str(folder / "photograph-002.png"), dark)
    cv2.imwrite(str(folder / "yesterday.png"), dark)
    said, _ = a465("look", "task2.toml", "--images", folder)
    assert "one: image 2 of 5 shows no marker, and the others do: do all show the cell now?" in said
    assert (
        "one: has 6 images, of which the first 5 by name were used, photograph-001.png to photograph-005.png"
        in said
    )
    said, _ = a465("render", "task2.toml", "-o", folder, "--count", "1")
    assert f"NOTE: {folder} has 5 other images, which stay, and are read with these" in said
    for command in (("render", "task2.toml"), ("snap", "cell.toml", "--camera", "name:a")):
        told = a465(*command, "-o", tmp_path / "a.png", code=2)[1]
        assert "a.png: is the name of an image; give that of a folder for images" in told


def test_copies_of_one_photograph_are_told(at: Path, tmp_path: Path) -> None:
    a465("render", "task2.toml", "-o", str(tmp_path / "one"), "--count", "5")
    images = sorted((tmp_path / "one").glob("*.png"))
    said, _ = a465("look", "task2.toml", "--images", str(tmp_path / "one"))
    assert "NOTE" not in said
    shutil.copy(images[0], images[1])
    said, _ = a465("look", "task2.toml", "--images", str(tmp_path / "one"))
    assert "one: images 1 and 2 of 5 are the same to the bit, so their noise is not measured" in said
    folder = tmp_path / "one"
    asked = "look", "task2.toml", "--images", folder, "-o", "look.json", "--picture", folder / "look.png"
    told = a465(*asked, code=2)[1]
    assert "look.png: is in the folder of --images, and would be read as one of them" in told
    assert not (folder / "look.png").exists()


def test_a_look_writes_its_picture_beside_it(at: Path) -> None:
    a465("look", "task2.toml", "-o", "new.json", "--picture", "new.png")
    assert Path("new.json").exists()
    assert Path("new.png").exists()


@pytest.mark.parametrize("name", ["plan.trajectory.json", "plan.mcap"])
def test_an_export_by_the_suffix_of_another_format_is_told_the_option(name: str, at: Path) -> None:
    told = a465("export", "plan.json", "-o", name, code=2)[1]
    assert f"{name}: is of --format {'mcap' if 'mcap' in name else 'trajectory'}, which is not given" in told
