"""The main job, whole: images in, bytes on a serial line, cubes moved; judged by truth and by an independent engine."""

from __future__ import annotations

import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from arm.board import plate_name
from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from arm.plan_file import GripperStep, Move, Plan
from arm.robot.shapes import Body, Box
from arm.se3 import apply, inverse, transform
from arms.mujoco_cell import MujocoCell
from cell.commands.run import resume_plan
from cell.console import Console
from cell.preview.of_log import preview_log
from cell.scene.bodies import plate_body, stand_body
from cell.session.connection import WhichCell
from driver.log.read import read_log
from tasks.small import leave_cubes, quick_scenes
from tasks.whole_run import WholeRun, executed, homed_ms, run_whole

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("main_job")]


@pytest.fixture(scope="module")
def task2(tmp_path_factory: pytest.TempPathFactory) -> WholeRun:
    run = run_whole(data_file("scenes/task2.toml"), tmp_path_factory.mktemp("task2"))
    assert run.error is None, run.said
    return run


@pytest.fixture(scope="module")
def task1(tmp_path_factory: pytest.TempPathFactory) -> WholeRun:
    run = run_whole(data_file("scenes/task1.toml"), tmp_path_factory.mktemp("task1"))
    assert run.error is None, run.said
    return run


def test_four_cubes_from_board_to_board(task2: WholeRun) -> None:
    cubes = task2.report["cubes"]
    assert [c["placed"] for c in cubes] == [True] * 4
    assert max(c["error_mm"] for c in cubes) <= 1.0
    assert max(c["tilt_error_deg"] for c in cubes) <= 0.5
    assert {c["to"] for c in cubes} == {f"03-04/{n}" for n in (1, 2, 3, 4)}
    assert task2.report["plan_sha256"] == task2.plan().sha256
    assert task2.simulated is not None
    target = task2.simulated.world.boards[1]
    truly = [c.T_base_cube for c in task2.history[-1].cubes]
    for hole in range(4):
        T_base_hole = target.T_base_board @ target.board.T_board_hole(hole)
        assert min(np.linalg.norm((inverse(T_base_hole) @ T)[:2, 3]) for T in truly) < 1e-9


def test_four_cubes_to_free_places_on_the_table(task1: WholeRun) -> None:
    cubes = task1.report["cubes"]
    assert [c["placed"] for c in cubes] == [True] * 4
    assert max(c["error_mm"] for c in cubes) <= 2.0
    assert max(c["tilt_error_deg"] for c in cubes) <= 1.0
    standing = [c.T_base_cube for c in task1.history[-1].cubes]
    assert all(T[2, 3] == pytest.approx(0.02) for T in standing)
    half = 0.02 * np.sqrt(2)
    for i in range(4):
        for j in range(i):
            assert np.linalg.norm(standing[i][:2, 3] - standing[j][:2, 3]) > 2 * half


def test_the_arm_starts_and_ends_at_q_start_out_of_view(task2: WholeRun) -> None:
    _, q = executed(task2)
    assert q[-1] == pytest.approx(task2.task.cell.q_start, abs=2e-5)


def test_what_was_sent_is_what_was_planned(task2: WholeRun) -> None:
    lines = [line.split(":")[1] for _, line in task2.sent if line.startswith("COORDSPLINET")]
    sent = [tuple(int(v) for v in line.split(",")) for line in lines]
    planned = [s for name in ("to-start", "plan") for m in task2.plan(name).moves for s in m.path.segments]
    expected = [
        (s.duration_ms, len(s.coefficients), *np.array(s.coefficients).T.ravel().tolist()) for s in planned
    ]
    assert [n for n in sent if any(n[2:])] == [n for n in expected if any(n[2:])]  # dwells move nothing


# The judge looks at a millisecond if joints have turned by this much in sum since it last looked: at nearly every one
# where the arm is fast, and never where it rests. Nothing of it is further than 1.3 m from any of its axes.
JUDGED_TURN = 1e-3


def _judge(run: WholeRun, extra: tuple[Body, ...] = (), turn: float = JUDGED_TURN) -> set[frozenset[str]]:
    """Pairs that MuJoCo finds inside each other on the executed motion, but for what a task needs."""
    simulated, cell = run.simulated, run.task.cell
    assert simulated is not None
    bodies = [*cell.fixed, *extra]
    for b in simulated.world.boards:
        bodies.append(plate_body(b.board.name, b.T_base_board))
        stand = stand_body(b.board.name, b.T_base_board, cell.stand_size, cell.table_z)
        bodies += [stand] if stand else []
    names = [c.name for c in simulated.history[0].cubes]
    judge = MujocoCell(
        data_file("urdf/a465/a465.urdf"),
        bodies,
        [(n, cell.cube_size) for n in names],
        cell.robot().disabled_collisions,
    )
    times, q = executed(run, homed_ms(run))
    found: set[frozenset[str]] = set()
    state, upcoming = simulated.history[0], list(simulated.history[1:])
    judged = np.full(q.shape[1], np.inf)
    for time_ms, position in zip(times, q, strict=True):
        changed = bool(upcoming) and upcoming[0].time_ms <= time_ms
        while upcoming and upcoming[0].time_ms <= time_ms:
            state = upcoming.pop(0)
        if not changed and np.abs(position - judged).sum() < turn:
            continue
        judged = position
        poses, held = {}, None
        for c in state.cubes:
            poses[c.name] = c.T_base_cube
            if c.T_tool_cube is not None:
                held = c.name
                poses[c.name] = _tool(run, position) @ c.T_tool_cube
        judge.place(position, state.jaw_opening, poses)
        for pair, _ in judge.penetrations():
            if not _needed(run, pair, held, poses):
                found.add(pair)
    return found


def _tool(run: WholeRun, q: np.ndarray) -> np.ndarray:
    assert run.simulated is not None
    return run.simulated._robot.T_base_tool(q)


def _needed(run: WholeRun, pair: frozenset[str], held: str | None, poses: dict[str, np.ndarray]) -> bool:
    """Contacts that the task consists of: fingers on the held cube, and a cube in its own pocket or on the table."""
    assert run.simulated is not None
    cubes = [n for n in pair if n in poses]
    if held in pair and pair & {"finger_l", "finger_r"}:
        return True
    if len(cubes) != 1:
        return False
    (other,) = pair - set(cubes)
    if other == "table":
        return bool(poses[cubes[0]][2, 3] > run.task.cell.cube_size / 2 - 1e-4)
    for b in run.simulated.world.boards:
        if other == plate_name(b.board.name):
            for hole in range(4):
                T_hole_cube = inverse(b.T_base_board @ b.board.T_board_hole(hole)) @ poses[cubes[0]]
                upright = T_hole_cube[2, 2] > np.cos(np.radians(1.0))
                if upright and np.abs(T_hole_cube[:2, 3]).max() < 1e-3 and T_hole_cube[2, 3] > 0.0115:
                    return True
    return False


def test_an_independent_engine_finds_no_contact_in_task_2(task2: WholeRun) -> None:
    assert _judge(task2) == set()


def test_an_independent_engine_finds_no_contact_in_task_1(task1: WholeRun) -> None:
    assert _judge(task1) == set()


def test_the_independent_engine_sees_a_wall_in_the_way(task2: WholeRun) -> None:
    """Positive control: without it, the two tests above could pass by seeing nothing."""
    _, q = executed(task2, homed_ms(task2))
    middle = _tool(task2, q[len(q) // 2])[:3, 3]
    wall = Body("wall in the way", Box((0.08, 0.08, 0.08)), transform(t=middle), "wall")
    assert any("wall in the way" in pair for pair in _judge(task2, (wall,), turn=0.02))


@pytest.mark.parametrize("which", ["task1", "task2"])
def test_lines_stay_on_the_normal_at_every_millisecond(which: str, request: pytest.FixtureRequest) -> None:
    run: WholeRun = request.getfixturevalue(which)
    plan, unit = run.plan(), run.task.cell.unit
    lines = [m for m in plan.moves if m.role in ("approach", "retract")]
    assert len(lines) == 16
    for move in lines:
        q = unit.positions(move.path.sample(1e-3))
        at_station = _tool(run, q[-1] if move.role == "approach" else q[0])
        poses = np.stack([inverse(at_station) @ _tool(run, row) for row in q])
        assert np.hypot(poses[:, 0, 3], poses[:, 1, 3]).max() <= 1e-4
        angles = np.arccos(np.clip((np.trace(poses[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
        assert np.degrees(angles.max()) <= 0.05
        assert abs(poses[:, 2, 3]).max() == pytest.approx(0.1, abs=1e-4)


def test_executed_motion_keeps_the_limits_of_the_registers(task2: WholeRun) -> None:
    unit = task2.task.cell.unit
    times, q = executed(task2, homed_ms(task2))
    assert np.all(q >= unit.lower - 1e-4)
    assert np.all(q <= unit.upper + 1e-4)
    together = np.diff(times) == 1
    velocity = np.abs(np.diff(q, axis=0)[together]) / 1e-3
    rounding = 1.0 / np.abs(unit.counts_per_rad) / 1e-3
    assert np.all(velocity <= task2.task.cell.limits.scaled(0.5).velocity + rounding)


def test_the_plan_certifies_every_move_with_the_asked_clearance(task2: WholeRun) -> None:
    for move in task2.plan().moves:
        assert move.certified
        assert move.clearance >= (0.010 if move.role in ("transit", "home") else 0.005)


def test_the_order_of_steps_is_the_tasks(task2: WholeRun) -> None:
    steps = [s for s in task2.plan().steps if getattr(s, "cube", None) == 0]
    roles = [s.role if isinstance(s, Move) else s.action for s in steps if isinstance(s, Move | GripperStep)]
    assert roles == [
        "transit",
        "approach",
        "close",
        "retract",
        "transit",
        "approach",
        "open",
        "retract",
        "home",
    ]


def test_the_run_leaves_its_evidence(task2: WholeRun) -> None:
    names = {p.name for p in task2.folder.iterdir()}
    assert {"plan.json", "preview.html", "wire.jsonl", "report.json", "look-1.png", "look-6.png"} <= names
    assert '"photograph":"data:image/jpeg;base64,' in (task2.folder / "preview.html").read_text()


def test_the_log_tells_task_and_plan_and_is_shown_over_it(task2: WholeRun, tmp_path: Path) -> None:
    session = read_log(task2.folder / "wire.jsonl")
    (noted,) = session.noted("run")
    assert (noted.data["digest"], noted.data["unit"]) == (task2.task.digest, "crs93")
    assert [note.data["sha256"] for note in session.noted("plan")] == [
        task2.plan(name).sha256 for name in ("to-start", "plan")
    ]
    looks = [note.data["picture"] for note in session.noted("look")]
    assert looks == [f"look-{number}.png" for number in range(1, 7)]
    assert session.damaged == 0
    told = preview_log(session.file, None, tmp_path / "log.html", Console(as_json=True))
    assert told["plan_sha256"] == task2.plan().sha256
    assert Path(told["task"]).resolve() == task2.task.file.resolve()
    assert told["streams_shown"] == len(task2.plan().motions) == told["streams"] - 1  # the way to q_start
    assert told["farthest_deg"] <= 0.02
    assert sum(m["planned_s"] for m in told["motions"]) == pytest.approx(task2.plan().duration_s)


def test_the_way_to_the_start_is_not_resumed_but_the_plan_beside_it(task2: WholeRun, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(task2.folder, tmp_path / "run"))
    way, task, where = folder / "to-start.json", task2.task.file, WhichCell("/dev/null")
    told = rf"^{way}: is not the plan that the run followed; resume with {folder / 'plan.json'}$"
    with pytest.raises(InputError, match=told):
        resume_plan(way, task, Console(), where)
    (folder / "plan.json").unlink()
    with pytest.raises(ImpossibleError, match="moves no cubes, so its remaining part is unknown"):
        resume_plan(way, task, Console(), where)


def test_without_looks_the_arm_stops_only_where_the_jaws_act(tmp_path: Path) -> None:
    task = quick_scenes(tmp_path, 1, 3) / "task2.toml"
    task.write_text(task.read_text().replace('look_after = "each"', 'look_after = "never"'))
    run = run_whole(task, tmp_path / "run")
    assert run.error is None, run.said
    assert [c["placed"] for c in run.report["cubes"]] == [True] * 2
    assert max(c["error_mm"] for c in run.report["cubes"]) <= 1.0
    plan = run.plan()
    assert len(plan.motions) == 5  # two to a cube, two with it, and the way home
    lines = [line.split(":")[1] for _, line in run.sent if line.startswith("COORDSPLINET")]
    sent = [tuple(int(v) for v in line.split(",")) for line in lines]
    dwells = [n for n in sent if not any(n[2:])]
    streams = 5 + len(run.plan("to-start").motions)
    assert len(dwells) == streams
    times, q = executed(run, homed_ms(run))
    moving = times[1:][np.any(np.diff(q, axis=0) != 0.0, axis=1)]
    rests = [b - a for a, b in pairwise(moving.tolist()) if b - a > 100]
    assert 1 + len(rests) == streams
    assert sum(rest > 1500 for rest in rests) == 4  # each cube is gripped and let go
    assert sum(c["motion_s"] for c in run.report["cubes"]) == pytest.approx(plan.duration_s, abs=0.01)


def _plate(plan: Plan) -> np.ndarray:
    return np.array(next(b for b in plan.scene["bodies"] if b["name"] == "plate 01-02")["T_base_body"])


def test_the_plan_follows_the_image_not_the_file(task2: WholeRun, scenes: Path, tmp_path: Path) -> None:
    """Only the world file is changed; nothing that the stack reads says where the board went."""
    leave_cubes(scenes, 1, 3)
    world = scenes / "task2.world.toml"
    world.write_text(world.read_text().replace("centre_mm = [460, 110, 40]", "centre_mm = [450, 117, 45]"))
    run = run_whole(scenes / "task2.toml", tmp_path / "run")
    assert run.error is None, run.said
    assert all(c["placed"] and c["error_mm"] <= 1.0 for c in run.report["cubes"])
    first, moved = (r.plan() for r in (task2, run))
    before, after = (_plate(plan) for plan in (first, moved))
    assert (after - before)[:3, 3] == pytest.approx([-0.010, 0.007, 0.005], abs=3e-4)
    assert apply(after, (0, 0, 0)) != pytest.approx(apply(before, (0, 0, 0)), abs=1e-3)
