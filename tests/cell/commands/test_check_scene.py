"""The shipped scenes with their expected distances: coal against the files, MuJoCo against the files, each alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere, convex
from arm.se3 import rotation, transform
from arms.expected_distances import MujocoScene
from arms.mujoco_cell import MujocoCell
from cell.commands.check_scene import AGREES, answer_motion, answer_query, check_scene
from cell.console import Console
from cell.files.scene import SceneFile, read_scene_file
from plan.collision.world import World
from tasks.scene_files import FOLDER, changed, run

FILES = sorted(FOLDER.glob("*.toml"))

TOOL_LENGTH = 0.134112


@pytest.fixture(scope="module", params=FILES, ids=lambda p: p.stem)
def scene(request: pytest.FixtureRequest) -> SceneFile:
    return read_scene_file(request.param)


def test_coal_finds_what_the_file_expects(scene: SceneFile) -> None:
    for query in scene.queries:
        found = answer_query(scene, query)
        assert query.expected.distance is not None
        assert found.verdict == query.expected.verdict
        assert found.seen == pytest.approx(query.expected.distance, abs=AGREES)
        assert found.agrees
    for motion in scene.motions:
        bound = answer_motion(scene, motion)
        assert motion.expected.distance is not None
        assert bound.verdict == motion.expected.verdict
        assert bound.proved - AGREES <= motion.expected.distance <= bound.seen + AGREES
        if motion.expected.distance > 0.0:  # else the search ends with the first overlap
            assert bound.seen - bound.proved <= max(1e-3, 0.1 * bound.seen)
        assert bound.agrees


@pytest.mark.few(6)
def test_mujoco_finds_what_the_file_expects(scene: SceneFile) -> None:
    judge = MujocoScene(scene)
    for query in scene.queries:
        distance, _ = judge.closest(query.q[0], query.allowed)
        assert query.expected.distance == pytest.approx(distance, abs=AGREES)
        assert query.expected.verdict == ("free" if distance > 0.0 else "collides")
        assert query.expected.pair is not None
        of_pair = judge.cell.distance(*query.expected.pair) - scene.padding
        assert of_pair == pytest.approx(distance, abs=AGREES)
    for motion in scene.motions:
        distance, _ = judge.least(motion.q, motion.allowed, samples=201)
        assert motion.expected.distance == pytest.approx(distance, abs=AGREES)
        assert motion.expected.verdict == ("clear" if distance >= motion.asked else "too close")


def random_bodies(rng: np.random.Generator) -> list[Body]:
    """Two of each shape around the arm; hulls whose frames lie beside them, too."""
    bodies = []
    for i in range(10):
        a, b, c = (float(v) for v in rng.uniform(0.03, 0.3, 3))
        corners = rng.uniform(-0.5, 0.5, (12, 3)) * (a, b, c) + rng.uniform(-0.1, 0.1, 3)
        shapes: tuple[Shape, ...] = (
            Box((a, b, c)),
            Cylinder(a / 2, b),
            Sphere(a / 2),
            Capsule(a / 2, b),
            convex(corners),
        )
        angle = rng.uniform(-np.pi, np.pi)
        place = np.array([0.6 * np.cos(angle), 0.6 * np.sin(angle), 0.35]) + rng.uniform(-0.2, 0.2, 3)
        bodies.append(
            Body(f"body {i}", shapes[i % 5], transform(rotation(rng.normal(size=3)), place), "wall")
        )
    return bodies


def test_coal_is_mujoco_in_random_scenes_of_all_shapes() -> None:
    """Same pairs, same distances; where both say overlap, signs are the claim, and depths agree to 1e-4 m but for few.

    The depth of an overlap is the shortest way out for both, but each engine searches for it in its own way, and may
    end at another one deep inside.
    """
    rng = np.random.default_rng(21)
    robot = load_a465(TOOL_LENGTH, 0.04)
    T_tool_held = transform(rotation((0.1, 0.2, 0.3)), (0.002, -0.001, 0.003))
    worst, overlaps, apart, clear = 0.0, [], 0, 0
    for _ in range(16):
        bodies = random_bodies(rng)
        shape: Shape = (
            Box((0.04, 0.04, 0.04)) if rng.integers(2) else convex(rng.uniform(-0.02, 0.02, (9, 3)))
        )
        held = Body("held", shape, transform(), "cube")
        world = World(robot, bodies, held, T_tool_held)
        judge = MujocoCell(
            data_file("urdf/a465/a465.urdf"), bodies, [("held", shape)], robot.disabled_collisions
        )
        names = [world.pair_names(i) for i in range(len(world.pairs))]
        assert {frozenset(p) for p in names} == {frozenset(p) for p in judge.pairs("held")}
        lower, upper = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
        for q in rng.uniform(lower, upper, (25, 6)):
            judge.place(q, 0.04, {"held": robot.T_base_tool(q) @ T_tool_held})
            ours = world.pair_distances(q, np.arange(len(names)))
            theirs = np.array([judge.distance(*pair) for pair in names])
            both = (ours <= 0.0) & (theirs <= 0.0)
            worst = max(worst, float(np.abs(ours - theirs)[~both].max()))
            apart += np.count_nonzero(~both)
            overlaps += list(np.abs(ours - theirs)[both])
            sure = np.abs(theirs) > AGREES
            assert np.array_equal(ours[sure] > 0.0, theirs[sure] > 0.0)
            clear += bool(theirs.min() > 0.0)
    assert worst <= AGREES
    assert apart > 40_000
    assert 40 < clear < 360  # of 400 configurations
    assert len(overlaps) > 100
    assert np.mean(np.array(overlaps) <= 1e-4) >= 0.98


def test_check_tells_a_table_and_ends_with_0(monkeypatch, capsys) -> None:
    assert run(["check", str(FOLDER / "capsule.toml")], monkeypatch) == 0
    out = capsys.readouterr().out
    assert "over its middle" in out
    assert "finger_r - rail" in out
    assert "4 as expected, 0 not" in out


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ('verdict = "free"', 'verdict = "collides"', "over its middle"),
        ("distance_mm = 18.4368", "distance_mm = 18.4", "over its middle"),
        ('pair = ["finger_r", "rail"]', 'pair = ["palm", "rail"]', "over its middle"),
        ('verdict = "clear"', 'verdict = "too close"', "past the high end"),
        ("clearance_mm = 16", "clearance_mm = 13", "past the high end"),
        ('pair = ["gripper", "rail"]\n\n[[m', 'pair = ["base", "rail"]\n\n[[m', "beyond its end"),
        ('clearance_mm = 16.3565\npair = ["gripper"', 'clearance_mm = 16.3565\npair = ["base"', "past the"),
        ('clearance_mm = 16.3565\npair = ["gripper"', 'clearance_mm = 16.3565\npair = ["palm"', "past the"),
        ("radius_mm = 20", "radius_mm = 20.05", "over its middle"),
    ],
)
def test_what_differs_ends_with_3(old, new, name, monkeypatch, capsys, tmp_path: Path) -> None:
    path = changed(tmp_path, old, new)
    assert run(["check", str(path), "--json"], monkeypatch) == 3
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert not report["as_expected"]
    assert any(d.startswith(name) for d in report["differing"])
    assert f"not as expected: {report['differing'][0]}" in captured.err


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("distance_mm = 18.4368", "distance_mm = 0.0184368", "is 18.44, 0.0184368 in the file: is it in metres?)"),
        ("distance_mm = -8.7830", "distance_mm = 8.7830", "is -8.783, 8.783 in the file: an overlap is negative)"),
        ("distance_mm = 18.4368", "distance_mm = 25", "over its middle (distance_mm is 18.44, 25 in the file)"),
        ('verdict = "free"', 'verdict = "collides"', "over its middle (free, collides in the file)"),
        (
            'pair = ["finger_r", "rail"]',
            'pair = ["finger_l", "rail"]',
            "(closest are finger_r - rail, finger_l - rail in the file)",
        ),
        (
            "size_mm = [1300, 1500, 40]",
            "size_mm = [1300, 1500, 400]",
            "bodies[0] (table): the arm's base is",
        ),
    ],
)  # fmt: skip
def test_what_differs_is_told_with_both_values(old, new, told, monkeypatch, capsys, tmp_path: Path) -> None:
    assert run(["check", str(changed(tmp_path, old, new))], monkeypatch) == 3
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


def test_a_doubt_of_a_scene_is_a_note(monkeypatch, capsys, tmp_path: Path) -> None:
    old, new = "from_deg = [-35, -52, -80, 0, -48, 0]", "from_deg = [-14, -50, -84, 0, -46, 0]"
    assert run(["check", str(changed(tmp_path, old, new))], monkeypatch) == 0
    said = capsys.readouterr().out
    assert "capsule.toml: motions[0] (past the high end): from_deg and to_deg are the same" in said
    assert said.count("NOTE") == 1


def test_any_configuration_of_a_scene(monkeypatch, capsys) -> None:
    path = str(FOLDER / "capsule.toml")
    assert run(["check", path, "--q", "10,-40,-80,0,-60,0", "--json"], monkeypatch) == 0
    report = json.loads(capsys.readouterr().out)
    assert len(report["closest"]) == 5
    assert set(report["closest"][0]["pair"]) == {"finger_r", "rail"}
    assert report["closest"][0]["distance_mm"] == pytest.approx(18.4368, abs=0.01)
    distances = [c["distance_mm"] for c in report["closest"]]
    assert distances == sorted(distances)
    for wrong in ("10,20", "a,b,c,d,e,f", "1,2,3,4,5,nan"):
        assert run(["check", path, f"--q={wrong}"], monkeypatch) == 2
        assert "must be 6 numbers separated by commas, J1 to J6 in deg" in capsys.readouterr().err


def test_a_configuration_beyond_the_limits_is_refused_as_in_the_file(monkeypatch, capsys) -> None:
    for file in (FOLDER / "capsule.toml", data_file("scenes/cell.toml"), data_file("scenes/task2.toml")):
        assert run(["check", str(file), "--q", "0,-140,-80,0,-60,0"], monkeypatch) == 2
        assert "J2 must be from -88.7 to 89.0 deg on crs93" in capsys.readouterr().err


def test_any_configuration_of_a_cell(monkeypatch, capsys) -> None:
    """A cell or task file is the same scene: arm, table, walls."""
    reports = []
    for name in ("cell", "task2"):
        path = str(data_file(f"scenes/{name}.toml"))
        assert run(["check", path, "--q", "0,-85,-80,0,-60,0", "--json"], monkeypatch) == 0
        reports.append(json.loads(capsys.readouterr().out))
        assert run(["check", path], monkeypatch) == 2
        assert (
            "file; check needs a plan and its task (a465 check PLAN.json TASK.toml)"
            in capsys.readouterr().err
        )
    assert reports[0] == reports[1]
    assert reports[0]["verdict"] == "collides"
    assert "table" in reports[0]["closest"][0]["pair"]
    assert run(["check", path, "--q", "-1.05,-0.7,-1.4,0,-1.05,0"], monkeypatch) == 0
    assert "NOTE: --q [-1.05, -0.7, -1.4, 0, -1.05, 0]: is it in rad? Then" in capsys.readouterr().out
    assert run(["check", path, "--q", "-60,-40.5,-80,0,-60,0"], monkeypatch) == 0
    assert "NOTE" not in capsys.readouterr().out


def test_the_table_shows_the_proved_clearance_beside_the_smallest_seen(capsys) -> None:
    scene = read_scene_file(FOLDER / "padding.toml")
    report = check_scene(scene, Console())
    motion = report["motions"][0]
    assert motion["clearance_mm"] == motion["proved_mm"]
    assert motion["proved_mm"] <= motion["expected"]["clearance_mm"] <= motion["seen_mm"]
    out = capsys.readouterr().out.splitlines()
    header = next(line for line in out if line.startswith("motion"))
    row = next(line for line in out if line.startswith("down to 5 mm"))
    at = header.index("proved mm"), header.index("seen mm")
    proved, seen = (float(row[i : i + 9].split()[0]) for i in at)
    assert proved <= motion["proved_mm"] < proved + 0.01
    assert seen - 0.01 < motion["seen_mm"] <= seen


@pytest.mark.parametrize("kind", ["queries", "motions"])
def test_what_collides_and_is_expected_nowhere_is_not_as_expected(
    kind, monkeypatch, capsys, tmp_path
) -> None:
    path = tmp_path / "scene.toml"
    head = (FOLDER / "padding.toml").read_text().split("[[queries]]")[0]
    low, high = (
        "[6.789, -43.615, -96.28, 0, -40.105, -173.211]",
        "[6.789, -35.846, -96.391, 0, -47.764, -173.211]",
    )
    question = {
        "queries": f'[[queries]]\nname = "bare"\nq_deg = {low}\n',
        "motions": f'[[motions]]\nname = "bare"\nfrom_deg = {high}\nto_deg = {low}\nasked_mm = 0\n',
    }[kind]
    path.write_text(head + question)
    assert run(["check", str(path)], monkeypatch) == 3
    assert "not as expected: bare" in capsys.readouterr().err
    path.write_text((head + question).replace(low, high))
    assert run(["check", str(path)], monkeypatch) == 0


def test_plans_and_scenes_are_told_apart(monkeypatch, capsys, tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    plan.write_text('{"kind": "plan"}')
    assert run(["check", str(plan)], monkeypatch) == 2
    assert "format: must be 'a465-plan/3'" in capsys.readouterr().err
    assert run(["check", str(plan), "--q", "0,0,0,0,0,0"], monkeypatch) == 2
    assert "--q needs a scene, cell or task file" in capsys.readouterr().err
    scene, task = str(FOLDER / "capsule.toml"), str(data_file("scenes/task2.toml"))
    assert run(["check", scene, task], monkeypatch) == 2
    assert "is not a plan and needs no task" in capsys.readouterr().err
    assert run(["check", task, str(plan)], monkeypatch) == 2
    assert (
        f"are swapped: the plan comes first, then its task; give a465 check {plan} {task}"
        in capsys.readouterr().err
    )
    assert run(["check", str(tmp_path / "none.toml")], monkeypatch) == 2
    assert "cannot be read" in capsys.readouterr().err
