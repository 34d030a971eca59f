"""A plan is judged anew from its file: whatever was changed in it, the replay finds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import load_unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import GripperStep, LookStep, Move, Plan, Step
from arm.robot.shapes import Body, Box
from arm.se3 import frozen, transform
from arms.count_paths import reversed_path
from plan.collision.certificate import certify_move
from plan.program.tasks import plan_task
from plan.scene import Scene, scene_from_json
from plan.trajectory.extremes import segment_extremes
from plan.verify import RequiredClearance, _require_line, move_scenes, replay
from tasks.task2 import Q_START, Task2, task2

UNIT = load_unit("crs93")
LIMITS = UNIT.limits()


@pytest.fixture(scope="module")
def case() -> Task2:
    return task2()


@pytest.fixture(scope="module")
def plan(case: Task2) -> Plan:
    return plan_task(case.scene, case.transfers[:1], Q_START, UNIT)


@pytest.fixture(scope="module")
def scene(case: Task2, plan: Plan) -> Scene:
    return scene_from_json(plan.scene, case.scene.robot_open, case.scene.robot_holding)


def _changed(plan: Plan, role: str, change: Callable[[Move], Move], last: bool = False) -> Plan:
    indices = [i for i, s in enumerate(plan.steps) if isinstance(s, Move) and s.role == role]
    index = indices[-1 if last else 0]
    steps = list(plan.steps)
    move = steps[index]
    assert isinstance(move, Move)
    steps[index] = change(move)
    return replace(plan, steps=tuple(steps))


def _faster(move: Move, percent: int = 80) -> Move:
    segments = tuple(
        Segment(max(1, s.duration_ms * percent // 100), s.coefficients) for s in move.path.segments
    )
    return replace(move, path=CountPath(move.path.start, segments))


def _halves(move: Move) -> tuple[Move, Move]:
    """The same motion as two moves that meet at speed, in the middle."""
    path = move.path
    at = len(path.segments) // 2
    middle = tuple(int(c) for c in path.knots()[at])
    return (
        replace(
            move,
            name="first half",
            path=CountPath(path.start, path.segments[:at]),
            clearances=move.clearances[:at],
        ),
        replace(
            move,
            name="second half",
            path=CountPath(middle, path.segments[at:]),
            clearances=move.clearances[at:],
        ),
    )


def _hurried(move: Move) -> Move:
    """The same motion, slower from its middle on."""
    first, second = _halves(move)
    segments = (*first.path.segments, *_faster(second, 150).path.segments)
    return replace(move, path=CountPath(move.path.start, segments))


def _halved(plan: Plan, between: tuple[Step, ...] = (), second: Callable[[Move], Move] = lambda m: m) -> Plan:
    """The plan with its first transit in two halves."""
    index = next(i for i, s in enumerate(plan.steps) if isinstance(s, Move) and s.role == "transit")
    move = plan.steps[index]
    assert isinstance(move, Move)
    before, after = _halves(move)
    return replace(
        plan, steps=(*plan.steps[:index], before, *between, second(after), *plan.steps[index + 1 :])
    )


def test_an_unchanged_plan_is_accepted(plan: Plan, scene: Scene) -> None:
    assert len(replay(plan, scene, UNIT, LIMITS)) == len(list(plan.moves))


@pytest.mark.parametrize(
    ("role", "change", "message"),
    [
        ("transit", lambda m: replace(m, clearance=m.clearance + 0.004), "the plan states"),
        ("transit", _faster, "over its velocity"),
        ("transit", lambda m: replace(m, held="cube B"), "says that it holds"),
        ("retract", lambda m: replace(m, held=None), "says that it holds nothing"),
        ("retract", lambda m: replace(m, allowed_collisions=()), "the plan states"),
        ("retract", lambda m: replace(m, allowed_collisions=("table",)), "does not allow there"),
    ],
)
def test_a_changed_move_is_found(
    plan: Plan, scene: Scene, role: str, change: Callable[[Move], Move], message: str
) -> None:
    with pytest.raises(ImpossibleError, match=message):
        replay(_changed(plan, role, change), scene, UNIT, LIMITS)


ASKED = RequiredClearance(clearance=0.010, line_clearance=0.005, offset=0.100)


@pytest.mark.slow
def test_clearance_and_line_length_required_by_the_cell_are_checked(plan: Plan, scene: Scene) -> None:
    replay(plan, scene, UNIT, LIMITS, ASKED)
    for offset in (0.0996, 0.1004):  # a line may be left at speed, at the next whole millisecond
        replay(plan, scene, UNIT, LIMITS, replace(ASKED, offset=offset))
    for asked, message in (
        (replace(ASKED, clearance=0.050), "50 mm are required"),
        (replace(ASKED, line_clearance=0.050), "50 mm are required"),
        (replace(ASKED, offset=0.0994), "is not a line of 99.4 mm"),
        (replace(ASKED, offset=0.1006), "is not a line of 100.6 mm"),
    ):
        with pytest.raises(ImpossibleError, match=message):
            replay(plan, scene, UNIT, LIMITS, asked)
    unproved = _changed(plan, "home", lambda m: replace(m, certified=False))
    with pytest.raises(ImpossibleError, match="unproved"):
        replay(unproved, scene, UNIT, LIMITS, ASKED)
    bent = _changed(plan, "home", lambda m: replace(m, role="retract"))
    with pytest.raises(ImpossibleError, match="is not a line"):
        replay(bent, scene, UNIT, LIMITS, ASKED)


def test_contacts_on_a_transit_are_not_allowed(plan: Plan, scene: Scene) -> None:
    lifted = next(m for m in plan.moves if m.allowed_collisions)
    with pytest.raises(ImpossibleError, match="does not allow there"):
        replay(
            _changed(
                plan, "transit", lambda m: replace(m, allowed_collisions=lifted.allowed_collisions), last=True
            ),
            scene,
            UNIT,
            LIMITS,
        )


def test_a_missing_grip_is_found(plan: Plan, scene: Scene) -> None:
    steps: list[Step] = [s for s in plan.steps if not (isinstance(s, GripperStep) and s.action == "close")]
    with pytest.raises(ImpossibleError, match="says that it holds"):
        replay(replace(plan, steps=tuple(steps)), scene, UNIT, LIMITS)


def test_a_body_that_is_there_now_is_found(plan: Plan, scene: Scene) -> None:
    transit = next(m for m in plan.moves if m.role == "transit")
    q = UNIT.positions(transit.path.knots()[len(transit.path.segments) // 2])
    tool = scene.robot_open.T_base_tool(q)[:3, 3]
    box = Body("box", Box((0.1, 0.1, 0.05)), transform(t=tool - np.array([0.0, 0.0, 0.03])), "wall")
    with pytest.raises(ImpossibleError, match="box"):
        replay(plan, replace(scene, bodies=(*scene.bodies, box)), UNIT, LIMITS)


def test_excess_velocity_is_refused(plan: Plan, scene: Scene) -> None:
    lower = replace(LIMITS, velocity=LIMITS.velocity * 0.5)
    with pytest.raises(ImpossibleError, match="over its velocity"):
        replay(plan, scene, UNIT, lower)


def test_moves_that_meet_at_speed_hold(plan: Plan, scene: Scene) -> None:
    halved = _halved(plan)
    first, second = halved.motions[0].moves[:2]
    speed = np.abs(first.path.segments[-1].derivative(1.0)) / np.abs(UNIT.counts_per_rad)
    assert speed.max() > 0.1
    assert second.path.start == first.path.end
    assert len(replay(halved, scene, UNIT, LIMITS, ASKED)) == len(list(plan.moves)) + 1


def test_moves_that_meet_with_a_jump_of_velocity_are_found(plan: Plan, scene: Scene) -> None:
    """The second half alone keeps every limit, but the arm would have to be slower at once."""
    with pytest.raises(
        ImpossibleError, match="'first half' and 'second half' do not meet at the same"
    ) as found:
        replay(_halved(plan, second=lambda m: _faster(m, 150)), scene, UNIT, LIMITS)
    assert found.value.data["excess"] > 0.0
    merged = _changed(plan, "transit", _hurried)
    with pytest.raises(ImpossibleError, match="over its jump of velocity at a join"):
        replay(merged, scene, UNIT, LIMITS)


def test_moves_that_do_not_meet_at_all_are_found(plan: Plan, scene: Scene) -> None:
    def aside(move: Move) -> Move:
        start = (move.path.start[0] + 1, *move.path.start[1:])
        return replace(move, path=CountPath(start, move.path.segments))

    with pytest.raises(InputError, match="of the chain starts at"):
        replay(_halved(plan, second=aside), scene, UNIT, LIMITS)


def test_a_motion_is_at_rest_at_both_ends(plan: Plan, scene: Scene) -> None:
    """Where the jaws act or the camera looks, and at the plan's ends."""
    with pytest.raises(ImpossibleError, match="'first half' does not end at rest"):
        replay(_halved(plan, between=(LookStep("look"),)), scene, UNIT, LIMITS)
    halved = _halved(plan)
    second = next(i for i, s in enumerate(halved.steps) if s.name == "second half")
    with pytest.raises(ImpossibleError, match="'second half' does not begin at rest"):
        replay(replace(halved, steps=halved.steps[second:]), scene, UNIT, LIMITS)


def _with_clearances(plan: Plan, scene: Scene) -> Plan:
    """The first transit with a proved bound for every segment."""
    move, world, _ = next(found for found in move_scenes(plan, scene, UNIT) if found[0].role == "transit")
    bounds = []
    for start, segment in zip(move.path.knots(), move.path.segments, strict=False):
        part = CountPath(tuple(int(c) for c in start), (segment,))
        bounds.append(certify_move(world, part, UNIT, 0.0).clearance)
    stated = replace(move, clearances=tuple(bounds), clearance=min(bounds))
    return _changed(plan, "transit", lambda _: stated)


def test_the_clearance_of_every_segment_is_proved_again(plan: Plan, scene: Scene) -> None:
    stated = _with_clearances(plan, scene)
    move = next(m for m in stated.moves if m.clearances)
    assert max(move.clearances) > 1.5 * move.clearance
    replay(stated, scene, UNIT, LIMITS)
    widest = int(np.argmax(move.clearances))
    for index in (0, widest, len(move.clearances) - 1):
        bounds = list(move.clearances)
        bounds[index] = 1.06 * bounds[index] + 1e-3  # a tight bound is within 5 % or 0.5 mm of the truth
        false = _changed(stated, "transit", lambda m, b=tuple(bounds): replace(m, clearances=b))
        with pytest.raises(ImpossibleError, match=f"the plan states {1e3 * bounds[index]:.2f} mm there"):
            replay(false, scene, UNIT, LIMITS)
    short = _changed(stated, "transit", lambda m: replace(m, clearances=m.clearances[:-1]))
    with pytest.raises(ImpossibleError, match=r"states \d+ clearances for \d+ segments"):
        replay(short, scene, UNIT, LIMITS)


def test_a_line_past_its_station_is_refused(plan: Plan, scene: Scene) -> None:
    """What is lifted off may touch what it stands on: it must not be pressed into it on the way."""
    down = next(m for m in plan.moves if m.role == "approach")
    knots = down.path.knots()
    tail = CountPath(tuple(int(c) for c in knots[-3]), down.path.segments[-2:])
    dip = replace(
        down, role="retract", path=CountPath(tail.start, (*tail.segments, *reversed_path(down.path).segments))
    )
    heights = [scene.robot_open.T_base_tool(q)[2, 3] for q in UNIT.positions(knots[[0, -3]])]
    normal = scene.robot_open.T_base_tool(UNIT.positions(knots[-1]))[2, 2]
    length = (heights[0] - heights[1]) / -normal
    with pytest.raises(ImpossibleError, match="is not a line") as found:
        _require_line(dip, scene, UNIT, length)
    assert found.value.data["past_m"] > 3e-4
    assert found.value.data["length_m"] == pytest.approx(length, abs=1e-4)
    up = replace(down, role="retract", path=reversed_path(down.path))
    _require_line(up, scene, UNIT, 0.1)


def test_joint_limits_are_checked_at_both_ends(plan: Plan, scene: Scene) -> None:
    """Each joint alone: a limit just inside of where the plan goes is broken, one just outside is kept."""
    extremes = [segment_extremes(move.path, UNIT) for move in plan.moves]
    low = np.min([e.lower.min(axis=0) for e in extremes], axis=0)
    high = np.max([e.upper.max(axis=0) for e in extremes], axis=0)
    for joint in range(6):
        for name, key, bound, inwards in (
            ("lower limit", "lower", low, 1e-4),
            ("upper limit", "upper", high, -1e-4),
        ):
            limit = np.array(getattr(LIMITS, key))
            limit[joint] = bound[joint] + inwards
            with pytest.raises(ImpossibleError, match=f"J{joint + 1} is 0.0057 deg over its {name}") as found:
                replay(plan, scene, UNIT, replace(LIMITS, **{key: frozen(limit)}))
            assert found.value.data["limit"] == name
    replay(plan, scene, UNIT, replace(LIMITS, lower=frozen(low - 1e-4), upper=frozen(high + 1e-4)))


def test_excess_acceleration_is_refused(plan: Plan, scene: Scene) -> None:
    extremes = [segment_extremes(move.path, UNIT) for move in plan.moves]
    peak = np.max([e.acceleration.max(axis=0) for e in extremes], axis=0) / plan.speed**2
    for joint in range(6):
        push = np.array(LIMITS.acceleration)
        push[joint] = 0.999 * peak[joint]
        with pytest.raises(ImpossibleError, match=f"J{joint + 1} is .* deg/s2 over its acceleration"):
            replay(plan, scene, UNIT, replace(LIMITS, acceleration=frozen(push)))


def test_peak_fractions_of_the_limits_match_samples(plan: Plan, scene: Scene) -> None:
    """Against differences of samples; the limits are those at the plan's speed."""
    scaled, step = LIMITS.scaled(plan.speed), 1e-3
    for move in replay(plan, scene, UNIT, LIMITS):
        q = UNIT.positions(move.move.path.sample(step))
        velocity = np.abs(np.diff(q, axis=0)).max(axis=0) / step
        ends = np.cumsum([segment.duration_ms for segment in move.move.path.segments])
        inside = np.setdiff1d(
            np.arange(1, len(q) - 1), ends
        )  # where two segments meet, the velocity may jump
        acceleration = np.abs(q[inside - 1] - 2 * q[inside] + q[inside + 1]).max(axis=0) / step**2
        assert move.peak_velocity == pytest.approx((velocity / scaled.velocity).max(), rel=0.02)
        assert move.peak_acceleration == pytest.approx((acceleration / scaled.acceleration).max(), rel=0.05)


def test_jaws_that_close_on_nothing_are_found(plan: Plan, scene: Scene, case: Task2) -> None:
    """The cube stands elsewhere than where the jaws close, by more than reaches between them, or there is none."""
    name = case.transfers[0].cube
    for aside, closes in ((0.03, True), (0.08, False)):
        cubes = tuple(
            c.at(transform(t=(0.0, 0.0, aside)) @ c.T_base_body) if c.name == name else c for c in scene.cubes
        )
        moved = move_scenes(plan, replace(scene, cubes=cubes), UNIT)
        if closes:
            assert any(move.held is not None for move, *_ in moved)
            continue
        with pytest.raises(ImpossibleError, match="closes the jaws where no cube stands"):
            list(moved)
    with pytest.raises(ImpossibleError, match="closes the jaws where no cube stands"):
        list(move_scenes(plan, replace(scene, cubes=(), allowed=frozenset()), UNIT))


def test_a_line_with_rotation_about_its_axis_is_refused(plan: Plan, scene: Scene) -> None:
    """The tool's frame stays on the line, but a cube between the jaws would turn in its pocket."""
    down = next(m for m in plan.moves if m.role == "approach")
    _require_line(down, scene, UNIT, 0.1)

    def turned(degrees: float) -> Move:
        more = round(np.radians(degrees) * UNIT.counts_per_rad[5] / len(down.path.segments))
        segments = tuple(
            Segment(
                s.duration_ms, ((*s.coefficients[0][:5], s.coefficients[0][5] + more), *s.coefficients[1:])
            )
            for s in down.path.segments
        )
        return replace(down, path=CountPath(down.path.start, segments))

    with pytest.raises(ImpossibleError, match="is not a line") as found:
        _require_line(turned(0.5), scene, UNIT, 0.1)
    assert found.value.data["turned"] == pytest.approx(np.radians(0.5), rel=0.1)
    assert found.value.data["aside_m"] < 1e-4


def test_a_cube_that_was_set_down_stands_there_from_then_on(plan: Plan, scene: Scene, case: Task2) -> None:
    transfer = case.transfers[0]
    *_, (_, _, resting) = move_scenes(plan, scene, UNIT)
    (cube,) = (c for c in resting if c.name == transfer.cube)
    place = next(
        s for s in (t.place for t in case.transfers) if s.name == plan.task["cubes"][0]["to"]
    ).T_base_tool[0]
    assert np.linalg.norm(cube.T_base_body[:3, 3] - place[:3, 3]) < 0.02
    gone = next(c for c in scene.cubes if c.name == transfer.cube)
    assert np.linalg.norm(cube.T_base_body[:3, 3] - gone.T_base_body[:3, 3]) > 0.1
    retract = [m for m in plan.moves if m.role == "retract"][-1]
    assert retract.clearance < 0.012  # it is the placed cube that is near: the palm is just above it
    assert any(name == transfer.cube for name in retract.closest)


def test_a_line_with_a_sideways_detour_is_refused(plan: Plan, scene: Scene) -> None:
    """It ends where it should; in its middle it is 0.2 mm aside, turned by less than a line may be."""
    down = next(m for m in plan.moves if m.role == "approach")
    segments, half = list(down.path.segments), len(down.path.segments) // 2
    more = max(1, round(np.radians(0.03) * abs(UNIT.counts_per_rad[0]) / half))
    for k, sign in [(k, 1) for k in range(half)] + [(k, -1) for k in range(half, 2 * half)]:
        first, *rest = segments[k].coefficients
        segments[k] = Segment(segments[k].duration_ms, ((first[0] + sign * more, *first[1:]), *rest))
    aside = replace(down, path=CountPath(down.path.start, tuple(segments)))
    assert aside.path.end == down.path.end
    with pytest.raises(ImpossibleError, match="is not a line") as found:
        _require_line(aside, scene, UNIT, 0.1)
    assert found.value.data["aside_m"] > 1e-4
    assert found.value.data["turned"] < np.radians(0.05)
    assert found.value.data["past_m"] < 1e-4


def test_a_move_that_is_not_certified_is_refused_where_clearance_is_asked_for(
    plan: Plan, scene: Scene
) -> None:
    for role in ("transit", "approach"):
        unproved = _changed(plan, role, lambda move: replace(move, certified=False))
        assert len(replay(unproved, scene, UNIT, LIMITS)) == len(list(plan.moves))
        with pytest.raises(ImpossibleError, match="of clearance, unproved"):
            replay(unproved, scene, UNIT, LIMITS, ASKED)


def test_lines_are_as_long_as_the_cell_asks(plan: Plan, scene: Scene) -> None:
    replay(plan, scene, UNIT, LIMITS, ASKED)
    for offset in (0.099, 0.101):
        with pytest.raises(ImpossibleError, match=r"is not a line of (99|101) mm along the tool's axis"):
            replay(plan, scene, UNIT, LIMITS, replace(ASKED, offset=offset))
