"""Lists of poses that cannot be planned, or are wrong: what is said, and with which figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import Step
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import Array, transform
from plan.budget import Meter, SearchBudget
from plan.collision.world import World
from plan.program.goals.line_chains import SequenceStep
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.program.sequence import search
from plan.program.sequence.planner import SequencePlanner
from plan.program.sequence.search import Found, PoseSearch
from plan.program.setting import Setting
from plan.program.writer import ClearanceLost, MotionWriter
from plan.scene import Scene
from plan.transit.optimise import Shortening
from plan.transit.straight import StraightLine
from plans.waypoints import FEW, Q_START, planned
from tasks.pose_lists import EFFORT, FAST, TABLE, down


@pytest.mark.parametrize(
    ("targets", "says"),
    [
        ([], "at least one"),
        ([Target("a", np.eye(4)), Target("a", np.eye(4))], "two are named 'a'"),
        ([Target("a", np.eye(4), attach="cup")], "attach = 'cup': must be one of table"),
        ([Target("a", np.eye(4), detach=True)], "no body is attached"),
        ([Target("a", np.eye(4), allowed_collisions={("table", "thumb")})], "allowed_collisions = 'thumb'"),
    ],
)
def test_wrong_lists(robot: Robot, crs97: Unit, targets: list[Target], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plan_poses(robot, [TABLE], targets, np.zeros(6), crs97.limits())


def test_a_start_outside_limits_is_refused(robot: Robot, crs97: Unit) -> None:
    with pytest.raises(InputError, match=r"q_start: joint J2 = 171\.89 deg: must be from"):
        plan_poses(robot, [], [Target("a", down(0.4, 0.0, 0.3))], [0, 3, 0, 0, 0, 0], crs97.limits())


@pytest.mark.parametrize(
    ("target", "says"),
    [
        (Target("far", q=[0.0, 3.0, 0.0, 0.0, 0.0, 0.0]), r"far: joint J2 = 171\.89 deg: must be from"),
        (Target("first", np.eye(4), free="x", ranges={"rz": (0.5, 1.0)}, by="line"), "'first': free = 'x'"),
    ],
)
def test_goals_are_checked_as_they_are_planned(robot: Robot, crs97: Unit, target: Target, says: str) -> None:
    """A configuration is within limits; the first goal is reached by a transit, so what a line allows is refused."""
    with pytest.raises(InputError, match=says):
        planned(robot, crs97, [TABLE], target)


LOST = 3  # sequences in turn that lose their clearance


@pytest.mark.parametrize("step", [0, 1, 2])
def test_an_edge_that_loses_its_clearance_is_excluded(
    robot: Robot, crs97: Unit, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[Sequence[SequenceStep]] = []
    steps = MotionWriter.steps

    def losing(writer: MotionWriter, sequence: Sequence[SequenceStep]) -> list[Step]:
        tried.append(sequence)
        if len(tried) <= LOST:
            raise ClearanceLost(step, ImpossibleError("lost"))
        return steps(writer, sequence)

    monkeypatch.setattr(MotionWriter, "steps", losing)
    places = ((0.45, -0.2, 0.2), (0.45, 0.1, 0.25), (0.3, 0.3, 0.2))
    targets = [Target(f"at {i}", down(*place), free="rz") for i, place in enumerate(places)]
    setting = Setting(Scene(robot, robot, (TABLE,), ()), crs97, crs97.limits(), FAST)
    planner = SequencePlanner(setting, targets, setting.at_counts("q_start", Q_START), effort=FEW)
    planner.planned(Meter(SearchBudget()))
    edges = [(step + 1, *[0, *(leg.index for leg in sequence)][step : step + 2]) for sequence in tried]
    assert len(set(edges)) == LOST + 1
    assert step == 0 or any(before != index for _, before, index in edges[:LOST])
    assert planner.search is not None
    assert planner.search._forbidden == set(edges[:LOST])


@pytest.mark.parametrize("padding", [0.0, 0.015])
def test_the_padding_of_a_program_is_taken_off_every_distance(
    robot: Robot, crs97: Unit, padding: float
) -> None:
    near = crs97.positions(crs97.counts(Q_START))
    bodies, there = [TABLE, crate_under(robot, near, 0.02)], Target("there", q=AWAY)
    if padding:
        with pytest.raises(ImpossibleError, match=r"q_start: .* is 5.0 mm from crate"):
            planned(robot, crs97, bodies, there, q_start=near, padding=padding)
    plain, padded = (planned(robot, crs97, [TABLE], there, q_start=near, padding=p) for p in (0.0, padding))
    assert padded.clearance == pytest.approx(plain.clearance - padding, abs=2e-3)


AWAY = np.radians([60.0, -40.0, -80.0, 0.0, -60.0, 0.0])
ASKED = FAST.clearance


def crate_under(robot: Robot, q: Array, gap: float) -> Body:
    """A crate below the tool at `q`, so high that the arm is `gap` m from it."""
    place, low, high = robot.T_base_tool(q)[:3, 3], 0.0, 0.3
    crate = Body("crate", Box((0.05, 0.05, 0.05)), transform(t=place), "wall")
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        crate = crate.at(transform(t=place - [0.0, 0.0, middle]))
        low, high = (low, middle) if World(robot, [crate]).distance(q).value > gap else (middle, high)
    return crate


@pytest.mark.parametrize("at_goal", [False, True], ids=["start", "goal"])
@pytest.mark.parametrize("gap", [0.001, 0.004])
def test_a_near_end_is_left_or_come_to_where_that_is_allowed(
    robot: Robot, crs97: Unit, gap: float, at_goal: bool
) -> None:
    near, far = crs97.positions(crs97.counts(Q_START)), crs97.positions(crs97.counts(AWAY))
    world_bodies = [TABLE, crate_under(robot, near, gap)]
    start, end = (far, near) if at_goal else (near, far)
    goal = Target("there", q=end)
    with pytest.raises(ImpossibleError, match="near_ends" if not at_goal else "too near"):
        planned(robot, crs97, world_bodies, goal, q_start=start)
    plan = planned(robot, crs97, world_bodies, goal, q_start=start, options=replace(FAST, near_ends=True))
    (told,) = plan.near_ends
    assert told["at"] == ("there" if at_goal else "q_start")
    assert "crate" in told["pair"]
    assert told["distance_mm"] == pytest.approx(1e3 * gap, abs=1.0)
    assert plan.plan().notes["near_ends"] == [told]
    *others, close = plan.moves if at_goal else plan.moves[::-1]
    assert gap - 1.5e-3 < close.clearance <= gap + 1e-3
    assert others
    assert all(move.clearance >= ASKED for move in others)
    # judged apart from the planner
    world = World(robot, world_bodies)
    distances = np.array([world.distance(q).value for q in plan.sample(0.02)[1]])
    assert distances.min() >= close.clearance - 1e-9
    _, q = plan.sample(0.02)
    short = np.abs(q - near).max(axis=1) < 0.3
    assert (distances[~short] >= ASKED - 1e-9).all()


def test_a_near_end_is_certified_with_what_it_has(robot: Robot, crs97: Unit) -> None:
    """Also where a certificate ends as soon as the required clearance is proved."""
    near = crs97.positions(crs97.counts(Q_START))
    options = replace(FAST, near_ends=True, certificate="decide")
    crate = crate_under(robot, near, 0.004)
    plan = planned(robot, crs97, [TABLE, crate], Target("there", q=AWAY), q_start=near, options=options)
    has = plan.near_ends[0]["distance_mm"] / 1e3
    assert has - 5e-4 <= plan.moves[0].clearance <= has


def test_a_clear_solution_comes_before_a_near_one(robot: Robot, crs97: Unit) -> None:
    """Of two poses that will do, the one that is reached sooner is too near to something."""
    q = crs97.positions(crs97.counts(AWAY))
    poses = np.stack([robot.T_base_tool(q), down(0.3, 0.35, 0.25)])
    bodies, there = [TABLE, crate_under(robot, q, 0.004)], Target("there", poses)
    plan = planned(robot, crs97, bodies, there, options=replace(FAST, near_ends=True))
    assert plan.near_ends == ()
    assert plan.clearance >= ASKED


@pytest.mark.parametrize("blind", ["straight", "detours"])
def test_what_samples_miss_is_mended_after_the_certificate(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch, blind: str
) -> None:
    """Straight motions and detours that were not seen to meet the wall are replaced by certified ones."""
    wall = Body("wall", Box((0.4, 0.02, 0.3)), transform(t=(0.5, 0.0, 0.15)), "wall")
    targets = [Target("a", down(0.45, -0.2, 0.1)), Target("b", down(0.45, 0.2, 0.1))]
    q, confirmed = np.radians([-35, -35, -85, 0, -60, 0]), list[bool]()

    def row() -> Planned:
        return plan_poses(robot, [TABLE, wall], targets, q, crs97.limits(), options=FAST, effort=EFFORT)

    seeing = row()
    if blind == "straight":
        clear = lambda world, a, b, asked: StraightLine(a, b, asked, True, 0.0)  # noqa: E731
        monkeypatch.setattr(search, "check_straight", clear)
    else:
        monkeypatch.setattr(Shortening, "settled", lambda self: self.path[[0, -1]])
    confirm = PoseSearch.confirm

    def noted(self: PoseSearch, found: Found) -> bool:
        confirmed.append(confirm(self, found))
        return confirmed[-1]

    monkeypatch.setattr(PoseSearch, "confirm", noted)
    plan = row()
    assert plan.detours > 0
    assert not confirmed[0]
    assert plan.duration_s < 1.1 * seeing.duration_s


def test_what_touches_is_no_near_end(robot: Robot, crs97: Unit) -> None:
    q = crs97.positions(crs97.counts(Q_START))
    crate = crate_under(robot, q, 0.001)
    inside = crate.at(transform(t=crate.T_base_body[:3, 3] + [0.0, 0.0, 0.01]))
    with pytest.raises(ImpossibleError, match=r"q_start: .* crate"):
        planned(robot, crs97, [TABLE, inside], Target("there", q=AWAY), options=replace(FAST, near_ends=True))
