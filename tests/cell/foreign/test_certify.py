"""Trajectories of other programs are proved or refuted, with the pair and the moment; limits are judged exactly."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from arm.plan_file import read_plan
from arms.trajectories import CELL, OVER, START, trajectory, world
from cell.console import Console
from cell.foreign.certify import certify_step
from cell.foreign.judge import certified
from cell.foreign.trajectory_file import JointTrajectory
from plan.collision.certificate import certify_curve
from typed.command_line import a465

JOINTS = [f"J{k}" for k in range(1, 7)]


def written(folder: Path, of: JointTrajectory) -> Path:
    """The trajectory as a file."""
    rates = np.zeros((len(of.q), 0)) if of.velocity is None else of.velocity
    points = [
        {"positions": q.tolist(), "velocities": rate.tolist(), "time_from_start": float(t)}
        for t, q, rate in zip(of.times, of.q, rates, strict=True)
    ]
    file = folder / "other.json"
    file.write_text(json.dumps({"joint_names": JOINTS, "points": points}))
    return file


def test_what_the_whole_leaves_open_is_decided_in_parts_or_said_to_be_undecided(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of, cell = trajectory([START, OVER, START], [0.0, 20.0, 40.0]), world()
    least = min(cell.distance(q).value for q in of.at(np.linspace(0.0, 40.0, 2000))[0])
    monkeypatch.setattr("plan.collision.certificate.BUDGET", 16)
    assert not certify_curve(cell, of.curve, least - 1e-4, tight=True).proved
    assert certified(cell, of.curve, least - 1e-4).proved
    assert not certified(cell, of.curve, least + 5e-4).proved
    monkeypatch.setattr("plan.collision.certificate.BUDGET", 1)
    open_ = certified(cell, of.curve, least - 1e-5)
    assert not open_.proved
    assert open_.seen >= least - 1e-5
    with pytest.raises(
        ImpossibleError, match=r"undecided: .* mm are proved, .* required, and nothing nearer"
    ) as caught:
        _certified(tmp_path, of, clearance=least - 1e-5)
    assert caught.value.data["verdict"] == "undecided"


def _certified(folder: Path, of: JointTrajectory, **options: Any) -> dict[str, Any]:
    given = {
        "look": None,
        "clearance": None,
        "speed": None,
        "output": None,
        "page": None,
        "place": CELL,
    } | options
    place = given.pop("place")
    return certify_step(written(folder, of), place, **given, console=Console(True))


def test_a_refusal_names_what_is_wrong_by_the_files_own_limits(tmp_path: Path) -> None:
    with pytest.raises(
        ImpossibleError, match=r"J\d needs \d+ % of its velocity limit at speed 0.5; make .* as slow"
    ):
        _certified(tmp_path, trajectory([START, OVER], [0.0, 0.5]))
    clear = _certified(tmp_path, trajectory([START, OVER], [0.0, 20.0]))
    assert (clear["verdict"], clear["required_mm"], clear["between_points"]) == ("clear", 10.0, "cubics")
    assert clear["proved_mm"] >= 10.0
    with pytest.raises(ImpossibleError, match=r"refuted: .* s after the start .* comes within") as caught:
        _certified(tmp_path, trajectory([START, OVER], [0.0, 20.0]), clearance=0.5)
    assert caught.value.data["verdict"] == "refuted"
    assert caught.value.data["distance_m"] < 0.5
    far = OVER + np.array([4.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ImpossibleError, match="J1 is beyond its position limits by"):
        _certified(tmp_path, trajectory([START, far], [0.0, 60.0]))
    lines = _certified(tmp_path, trajectory([START, OVER], [0.0, 20.0], cubics=False))
    assert lines["acceleration_share"] is None
    same = tmp_path / "same"
    for option in ({"clearance": -0.001}, {"speed": 2.0}, {"output": same, "page": same}):
        with pytest.raises(InputError):
            _certified(tmp_path, trajectory([START, OVER], [0.0, 20.0]), **option)


def test_what_is_certified_becomes_a_plan_that_check_verifies(tmp_path: Path) -> None:
    file, plan = (
        written(tmp_path, trajectory([START, OVER, START], [0.0, 20.0, 40.0])),
        tmp_path / "plan.json",
    )
    said, _ = a465("certify", file, CELL, "-o", plan, "--json")
    assert json.loads(said)["plan_sha256"] == read_plan(plan).sha256
    said, _ = a465("check", plan, CELL, "--json")
    assert json.loads(said)["moves"][0]["proved_mm"] >= 10.0


def test_a_plan_needs_velocities_and_at_most_an_hour(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--output needs points with velocities"):
        _certified(tmp_path, trajectory([START, OVER], [0.0, 20.0], cubics=False), output=tmp_path / "p.json")
    with pytest.raises(ImpossibleError, match=r"takes 4000 s; a plan takes at most 3600 s"):
        _certified(tmp_path, trajectory([START, OVER], [0.0, 4000.0]), output=tmp_path / "p.json")
    assert not (tmp_path / "p.json").exists()


def test_a_trajectory_in_a_scene_of_another_clearance(tmp_path: Path) -> None:
    scene = data_file("scenes/fixtures/mesh.toml")
    found = _certified(tmp_path, trajectory([START, START + 0.05], [0.0, 2.0]), place=scene, clearance=1e-3)
    assert found["required_mm"] == 1.0
    for option, rule in (
        ({"speed": 0.5}, "has no speed"),
        ({"output": tmp_path / "p.json"}, "which .* lacks"),
    ):
        with pytest.raises(InputError, match=rule):
            _certified(tmp_path, trajectory([START, START + 0.05], [0.0, 2.0]), place=scene, **option)


@pytest.mark.parametrize(
    ("place", "blind"),
    [("task2.toml", 1), ("cell.toml", 1), ("pen/drawing.toml", 0), ("fixtures/mesh.toml", 0)],
)
def test_without_a_look_it_is_told_that_boards_and_cubes_are_left_out(
    tmp_path: Path, place: str, blind: int
) -> None:
    file = written(tmp_path, trajectory([START, START + 0.05], [0.0, 4.0]))
    said, _ = a465("certify", file, data_file(f"scenes/{place}"), "--clearance-mm", 1)
    told = (
        "boards and cubes are not among the bodies, only the table and the walls; add them with --look FILE\n"
    )
    assert said.count(told) == said.count("--look") == blind
    if place == "cell.toml":
        (tmp_path / "look.json").write_text('{"scenes": [{"boards": []}]}')
        said, _ = a465("certify", file, CELL, "--look", tmp_path / "look.json", "--clearance-mm", 1)
        assert "are not among the bodies" not in said


def test_a_first_point_that_is_not_at_0_is_told(tmp_path: Path) -> None:
    for first, told in ((0.0, False), (2.0, True)):
        file = written(tmp_path, trajectory([START, START + 0.05], [first, first + 4.0]))
        said, _ = a465("certify", file, CELL)
        assert ("its first point is at 2 s, and the way there is not judged" in said) == told


def test_a_clearance_below_that_of_the_file_is_told(tmp_path: Path) -> None:
    file = written(tmp_path, trajectory([START, START + 0.05], [0.0, 4.0]))
    for asked, told in ((0, 1), (0.1, 1), (9.99, 1), (10, 0), (12, 0)):
        said, _ = a465("certify", file, CELL, "--clearance-mm", asked)
        line = f"the clearance of {asked:g} mm is less than the 10 mm of motion.clearance_mm in {CELL}\n"
        assert said.count(line) == said.count("is less than") == told
    assert "is less than" not in a465("certify", file, CELL)[0]
    program = tmp_path / "scenes/pen/drawing.toml"
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    said, _ = a465("certify", file, program, "--clearance-mm", 0.5)
    assert f"the clearance of 0.5 mm is less than the 5 mm of clearance_mm in {program}\n" in said


@pytest.mark.parametrize("asked", ["0.01", "1e-5", "0.0999"])
def test_a_clearance_in_metres_is_refused(tmp_path: Path, asked: str) -> None:
    file = written(tmp_path, trajectory([START, START + 0.05], [0.0, 4.0]))
    _, told = a465("certify", file, CELL, "--clearance-mm", asked, code=2)
    assert told.startswith(
        f"a465: wrong input: --clearance-mm {float(asked):g}: is in mm: must be 0, or from 0.1"
    )


def test_a_page_shows_a_clear_trajectory_or_where_and_why_it_is_refused(tmp_path: Path) -> None:
    of, page = trajectory([START, OVER], [0.0, 20.0]), tmp_path / "page.html"
    found = _certified(tmp_path, of, page=page)
    assert found["page"] == str(page)
    content = _content(page)
    assert "refused" not in content
    assert content["steps"][0]["clearance"] == pytest.approx(found["proved_mm"] / 1e3, abs=1e-6)
    for cubics in (True, False):
        of = trajectory([START, OVER], [0.0, 20.0], cubics)
        with pytest.raises(ImpossibleError) as caught:
            _certified(tmp_path, of, page=page, clearance=0.5)
        content = _content(page)
        assert content["code"] is None
        assert content["refused"]["pair"] == caught.value.data["pair"]
        assert content["refused"]["time_s"] == caught.value.data["time_s"]
        assert content["refused"]["what"] in str(caught.value)
        assert content["duration_s"] == pytest.approx(20.0)
    with pytest.raises(ImpossibleError):
        _certified(tmp_path, trajectory([START, OVER], [0.0, 0.5]), page=page)
    assert _content(page)["refused"]["pair"] == []


def _content(page: Path) -> dict[str, Any]:
    text = page.read_text().partition('<script id="content" type="application/json">')[2]
    return dict(json.loads(text.partition("</script>")[0]))
