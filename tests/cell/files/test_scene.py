"""Scene files: mistakes are named, and what they may leave out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError, InputError
from arm.io.storage import data_file
from arm.robot.shapes import Shape, Torus
from cell.commands.check_scene import check_scene
from cell.console import Console
from cell.files.scene import read_scene_file, read_surroundings
from tasks.scene_files import FOLDER, changed, run

FILES = sorted(FOLDER.glob("*.toml"))


def test_the_fixtures_cover_what_they_should() -> None:
    scenes = [read_scene_file(path) for path in FILES]
    assert len(scenes) >= 12
    assert {type(b.shape) for s in scenes for b in s.bodies} == set(Shape.__args__) - {
        Torus
    }  # MuJoCo has none
    verdicts = [q.expected.verdict for s in scenes for q in s.queries]
    assert min(verdicts.count(v) for v in ("free", "collides")) >= 12
    verdicts = [m.expected.verdict for s in scenes for m in s.motions]
    assert min(verdicts.count(v) for v in ("clear", "too close")) >= 8
    assert any(s.padding for s in scenes)
    hidden = read_scene_file(FOLDER / "hidden_hit.toml")
    sweep = hidden.motions[0]
    free = [q.q[0] for q in hidden.queries if q.expected.verdict == "free"]
    for s in (0.0, 0.5, 1.0):
        assert any(np.allclose(sweep.q[0] + s * (sweep.q[1] - sweep.q[0]), q) for q in free)
    assert sweep.expected.verdict == "too close"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('unit = "crs93"', 'unit = "crs9"', "unit = 'crs9': must be one of crs93, crs97"),
        (
            "q_deg = [10, -40",
            "q_deg = [10, -140",
            r"queries\[0\].q_deg = .*J2 must be from -88.7 to 89.0 deg",
        ),
        (
            '"rail"\nshape',
            '"palm"\nshape',
            r"bodies\[1\].name = 'palm': is used twice, or is a body of the arm",
        ),
        (
            '["finger_r", "rail"]',
            '["finger_r", "rial"]',
            r"queries\[0\].pair = .*names 'rial', which is not a body",
        ),
        ('["finger_r", "rail"]', '["rail", "rail"]', r"queries\[0\].pair = .*must name two different bodies"),
        (
            'verdict = "clear"',
            'verdict = "free"',
            r"motions\[0\].verdict = 'free': must be one of clear, too close",
        ),
        (
            "asked_mm = 5",
            "asked_m = 5",
            r"motions\[0\].asked_mm: is missing.*motions\[0\].asked_m is not a known key: did you",
        ),
        ("jaw_opening_mm = 60", "jaw_opening_mm = 60\npading_mm = 1", "pading_mm = 1: is not a known key"),
        ("asked_mm = 5", 'asked_mm = 5\nallowed = ["rail"]', r"motions\[0\].allowed = .*must name two"),
        ("[[queries]]", "[queries", "is not valid TOML"),
        (
            'unit = "crs93"\n',
            '[[cubes]]\nname = "c"\ncentre_mm = [400, 300, 20]\nunit = "crs93"\n',
            r"unit: is missing; .*\(cubes\[0\].unit is there: keys of the file itself stand above its first table\)$",
        ),
        (
            "[[bodies]]",
            "[[walls]]",
            r"walls.*: is not a known key of a scene file \(its bodies are \[\[bodies\]\]\)",
        ),
        (
            "distance_mm = 18",
            "clearance_mm = 18",
            r"clearance_mm = .*of a query \(its distance is distance_mm\)",
        ),
        (
            "asked_mm = 5",
            "asked_mm = 0.005",
            r"asked_mm = 0.005: must be 0, or from 0.1 .*\(is it in metres\?\)",
        ),
        (
            "[[bodies]]",
            "padding_mm = 0.01\n[[bodies]]",
            r"padding_mm = 0.01: must be 0, .*\(is it in metres\?\)",
        ),
        ("[[bodies]]", 'allowed = ["rail", "table"]\n[[bodies]]', r"\(pairs are lists: \[\["),
        (
            "[[bodies]]",
            '[held]\nname = "c"\ncentre_mm = [0, 0, 0.003]\n[[bodies]]',
            r"held.centre_mm = .*in metres",
        ),
        (
            "[[bodies]]",
            '[[cubes]]\nname = "c"\ncentre_mm = [0.4, 0.1, 0]\n[[bodies]]',
            r"cubes\[0\].centre_mm = \[0.4, 0.1, 0\]: must be 2 mm or more .*\(is it in metres\?\)",
        ),
    ],
)
def test_mistakes_in_a_scene_are_told(old, new, message, monkeypatch, capsys, tmp_path: Path) -> None:
    path = changed(tmp_path, old, new)
    with pytest.raises(InputError, match=message):
        read_scene_file(path)
    assert run(["check", str(path)], monkeypatch) == 2
    assert str(path) in capsys.readouterr().err


def test_a_scene_may_expect_nothing_or_only_a_verdict(tmp_path: Path) -> None:
    path = changed(tmp_path, "distance_mm = 18.4368\n", "")
    report = check_scene(read_scene_file(path), Console())
    assert report["as_expected"]
    assert report["queries"][0]["expected"]["distance_mm"] is None
    assert report["queries"][0]["distance_mm"] == pytest.approx(18.4368, abs=0.01)
    path.write_text(path.read_text().split("[[queries]]")[0])
    with pytest.raises(InputError, match=r"nothing to check; add \[\[queries\]\]"):
        check_scene(read_scene_file(path), Console())


def test_a_file_of_another_kind_is_told_with_the_kinds_that_belong_there() -> None:
    hand = data_file("scenes/targets/hand.toml")
    for read, belongs in (
        (read_scene_file, "a scene file"),
        (read_surroundings, "a scene, a cell, a task or an arm file"),
    ):
        with pytest.raises(FileInputError) as refused:
            read(hand)
        told = f"{hand}: is a target file, and {belongs} belongs here (calibrate takes it)"
        assert str(refused.value) == told
