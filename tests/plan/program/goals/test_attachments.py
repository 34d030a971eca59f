"""What is carried along a list of poses."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import GripperStep, Move, Plan, Step
from arm.robot.jaws import after_closing
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import Array, rot_z, transform
from plan.collision.world import World
from plan.program.goals.attachments import AttachmentState, AttachmentWorlds
from plan.program.goals.target import Target
from plan.program.planned import Pause
from plan.scene import Scene
from plan.verify import scenes_of_moves
from plans.waypoints import planned
from tasks.pose_lists import TABLE, down


def test_what_is_carried_stands_where_it_was_brought(robot: Robot) -> None:
    cup = Body("cup", Sphere(0.02), transform(t=(0.4, -0.2, 0.1)), "cube")
    pick = Target("pick", down(0.4, -0.2, 0.12), attach="cup")
    place = Target("place", down(0.4, 0.2, 0.22), detach=True)
    worlds = AttachmentWorlds(Scene(robot, robot, (TABLE,), (cup,)), [pick, place])
    held = worlds.after(worlds.start, pick, pick.T_base_tool)
    assert held.held == "cup"
    np.testing.assert_allclose(held.T_tool_held[:3, 3], (0.0, 0.0, 0.02), atol=1e-12)
    brought = worlds.after(held, place, place.T_base_tool)
    assert brought.held is None
    np.testing.assert_allclose(dict(brought.moved)["cup"][:3, 3], (0.4, 0.2, 0.2), atol=1e-12)
    assert len({worlds.start.key, held.key, brought.key}) == 3


def test_a_body_is_attached_only_between_the_jaws(robot: Robot, crs97: Unit) -> None:
    box = Body("box", Box((0.03, 0.03, 0.03)), transform(t=(-0.2, 0.5, 0.015)), "cube")
    pick = Target(
        "pick",
        down(0.45, 0.1, 0.1),
        attach="box",
        allowed_collisions={("finger_l", "box"), ("finger_r", "box")},
    )
    with pytest.raises(ImpossibleError) as caught:
        planned(robot, crs97, [TABLE, box], pick)
    gap = caught.value.data["distance_m"]
    assert 0.6 < gap < 0.8
    assert f"'pick': attach = 'box': is {gap * 1e3:.1f} mm from" in str(caught.value)
    assert "at most 10 mm" in str(caught.value)
    assert "attach_within" in str(caught.value)
    assert caught.value.data["pair"][1] == "box"
    beside = box.at(down(0.45, 0.18, 0.1))  # 4 cm from the fingers
    with pytest.raises(ImpossibleError, match="attach_within") as caught:
        planned(robot, crs97, [TABLE, beside], pick)
    assert 0.01 < caught.value.data["distance_m"] < 0.06
    # a rule of the list's own
    taken = planned(robot, crs97, [TABLE, box], replace(pick, attach_within=0.8))
    assert [step.attached for step in taken.steps if isinstance(step, Pause)] == ["box"]


def test_a_body_that_was_brought_elsewhere_is_looked_for_there(robot: Robot, crs97: Unit) -> None:
    touching = {("finger_l", "box"), ("finger_r", "box"), ("palm", "box"), ("table", "box")}
    place = down(0.4, 0.15, 0.06)
    box = Body("box", Box((0.03, 0.03, 0.03)), transform(t=(0.4, 0.15, 0.06)), "cube")
    lines = {"approach": 0.05, "retract": 0.05, "allowed_collisions": touching}
    targets = [
        Target("pick", place, attach="box", **lines),
        Target("put", down(0.4, -0.15, 0.06), detach=True, **lines),
    ]
    again = Target("pick again", place, attach="box", **lines)
    brought = planned(robot, crs97, [TABLE, box], *targets).state
    assert brought.held is None
    np.testing.assert_allclose(dict(brought.moved)["box"][:3, 3], (0.4, -0.15, 0.06), atol=1e-3)
    taken = planned(robot, crs97, [TABLE, box], targets[0]).state
    assert (taken.held, taken.moved) == ("box", ())
    with pytest.raises(
        ImpossibleError, match=r"'pick again': attach = 'box': is 2\d\d\.\d mm from"
    ) as caught:
        planned(robot, crs97, [TABLE, box], *targets, again)
    assert 0.2 < caught.value.data["distance_m"] < 0.3


@pytest.mark.parametrize("seed", range(4))
def test_each_state_has_the_world_that_its_bodies_make(robot: Robot, seed: int) -> None:
    """Against worlds that are built from the definition; states that differ in one thing only share none."""
    rng = np.random.default_rng(seed)
    cubes = [
        Body(f"cube {i}", Box((0.04, 0.04, 0.04)), transform(t=rng.uniform((0.2, -0.4, 0.0), (0.6, 0.4, 0.3))), "cube")
        for i in range(3)
    ]  # fmt: skip
    holding = load_a465(tool_length=0.134112, jaw_opening=0.04)
    goals = [
        Target("take", down(0.4, 0.0, 0.2), attach="cube 0"),
        Target("put", down(0.4, 0.0, 0.2), detach=True),
    ]
    goals += [Target("next", down(0.4, 0.0, 0.2), attach="cube 1")]
    worlds = AttachmentWorlds(Scene(robot, holding, (TABLE, *cubes), ()), goals, padding=0.002)
    here, there = (transform(t=rng.uniform((0.2, -0.4, 0.1), (0.6, 0.4, 0.3))) for _ in range(2))
    grasps = [transform(t=(0.0, 0.0, z)) for z in (0.0, 0.01)]
    states = [
        AttachmentState(None, None, ()),
        AttachmentState(None, None, (), closed=True),
        AttachmentState(None, None, (("cube 1", here),)),
        AttachmentState(None, None, (("cube 1", there),)),
        AttachmentState("cube 0", grasps[0], ()),
        AttachmentState("cube 0", grasps[1], ()),
        AttachmentState("cube 0", grasps[0], (("cube 1", here),)),
    ]
    touching = frozenset((frozenset(("cube 2", "finger_l")), frozenset(("cube 2", "finger_r"))))
    q = rng.uniform(robot.model.lowerPositionLimit, robot.model.upperPositionLimit, (6, 6))
    seen = set()
    for state, allowed in product(states, (frozenset(), touching)):
        moved = dict(state.moved)
        arm = holding if state.held else after_closing(robot) if state.closed else robot
        rest = [b.at(moved.get(b.name, b.T_base_body)) for b in (TABLE, *cubes) if b.name != state.held]
        held = cubes[0] if state.held else None
        wanted = World(arm, rest, held, state.T_tool_held, allowed, 0.002)
        made = worlds.world(state, allowed)
        assert worlds.world(state, allowed) is made
        assert made.robot.digest == arm.digest
        seen.add(id(made))
        for at in q:
            assert made.distance(at).value == wanted.distance(at).value
    assert len(seen) == 2 * len(states)
    fixed = World(robot, [TABLE, cubes[2]], None, None, touching, 0.002)
    for at in q:
        assert worlds.at_least(touching).distance(at).value == fixed.distance(at).value


def test_what_is_held_at_the_start_is_never_in_the_way(robot: Robot) -> None:
    cup = Body("cup", Sphere(0.02), transform(t=(0.4, -0.2, 0.1)), "cube")
    held = AttachmentState("cup", transform(t=(0.0, 0.0, 0.02)), ())
    worlds = AttachmentWorlds(
        Scene(robot, robot, (TABLE, cup), ()), [Target("put", down(0.4, 0.2, 0.2), detach=True)], held
    )
    assert "cup" not in worlds.at_least().names


def test_states_follow_from_the_actions(robot: Robot) -> None:
    cup = Body("cup", Sphere(0.02), transform(t=(0.4, -0.2, 0.1)), "cube")
    pick, put = (
        Target("pick", down(0.4, -0.2, 0.12), attach="cup"),
        Target("put", down(0.4, 0.2, 0.2), detach=True),
    )
    again = Target("again", down(0.41, 0.2, 0.23), attach="cup")
    worlds = AttachmentWorlds(Scene(robot, robot, (TABLE, cup), ()), [pick, put, again])
    brought = worlds.after(worlds.after(worlds.start, pick, pick.T_base_tool), put, put.T_base_tool)
    held = worlds.after(brought, again, again.T_base_tool)
    assert held.moved == ()
    np.testing.assert_allclose(
        held.T_tool_held[:3, 3], (-0.01, 0.0, 0.05), atol=1e-12
    )  # from where it was brought
    # a goal without a cube that closes the jaws leaves their opening unknown, whatever opens them later
    at = down(0.4, 0.0, 0.3)
    for jaws, cube, closed in ((1.0, None, True), (0.0, None, False), (None, None, False), (1.0, 0, False)):
        state = worlds.after(worlds.start, Target("jaws", at, jaws=jaws, cube=cube), at)
        assert state.closed is closed
        assert worlds.after(state, Target("open", at, jaws=0.0), at).closed is closed


@pytest.mark.parametrize("seed", range(3))
def test_the_gap_is_that_to_the_hand_or_to_the_tool_frame(robot: Robot, seed: int) -> None:
    """Not to other links, and from where the body is now."""
    rng = np.random.default_rng(seed)
    ball = Body("ball", Sphere(0.01), transform(t=(2.0, 0.0, 0.0)), "cube")
    pick = Target("pick", down(0.4, 0.0, 0.2), attach="ball")
    worlds = AttachmentWorlds(Scene(robot, robot, (ball,), ()), [pick])
    nearer = 0
    for q in rng.uniform(robot.model.lowerPositionLimit, robot.model.upperPositionLimit, (8, 6)):
        T_base_tool = robot.T_base_tool(q)
        for offset in ((0.0, 0.0, 0.03), (0.0, 0.0, -0.6), (0.06, 0.0, -0.3)):
            now = ball.at(T_base_tool @ transform(t=offset))
            state = AttachmentState(None, None, (("ball", now.T_base_body),))
            world = World(robot, [now])
            away = world.pair_distances(q, np.arange(len(world.pairs)))
            to_ball = {world.pair_names(i)[0]: d for i, d in enumerate(away) if "ball" in world.pair_names(i)}
            on_hand = {name: world.joint_of(name) == robot.end_joint for name in to_ball}
            hand = [d for name, d in to_ball.items() if on_hand[name]]
            others = [d for name, d in to_ball.items() if not on_hand[name]]
            wanted = min(*hand, float(np.linalg.norm(offset)) - 0.01)
            assert worlds.gap(state, pick, T_base_tool).value == pytest.approx(wanted, abs=1e-5)
            nearer += min(others) < wanted - 0.05
    assert nearer > 5


def test_one_body_at_a_time_is_attached_and_only_what_is_attached_is_released(robot: Robot) -> None:
    cup, can = (
        Body(name, Sphere(0.02), transform(t=(0.4, y, 0.1)), "cube")
        for name, y in (("cup", 0.0), ("can", 0.2))
    )
    take = [Target(f"take {body.name}", down(0.4, 0.0, 0.1), attach=body.name) for body in (cup, can)]
    put, scene = Target("put", down(0.4, 0.0, 0.1), detach=True), Scene(robot, robot, (), (cup, can))
    held = AttachmentState("cup", transform(), ())
    for goals, start, says in (
        (take, None, "'take can': attach = 'can': cup is attached already"),
        ([take[1]], held, "'take can': attach = 'can': cup is attached already"),
        ([take[0], put, replace(put, name="again")], None, "'again': detach = True: no body is attached"),
        ([put, replace(put, name="again")], held, "'again': detach = True: no body is attached"),
        ([put], AttachmentState("mug", transform(), ()), "held = 'mug': must be one of can, cup"),
        (
            [replace(put, allowed_collisions=[("cup", "thumb")])],
            held,
            "allowed_collisions = 'thumb': must be one of",
        ),
        ([replace(put, clearance_of=["cup", "thumb"])], held, "clearance_of = 'thumb': must be one of"),
    ):
        with pytest.raises(InputError, match=says):
            AttachmentWorlds(scene, goals, start)
    AttachmentWorlds(scene, [take[0], put, take[1], replace(put, name="again")])
    AttachmentWorlds(scene, [put, take[1]], held)


def _supplied(robot: Robot, count: int) -> Scene:
    """Two supplies of small spheres: of 3, and of the rest."""
    bodies = [
        Body(f"ball {k}", Sphere(0.01), transform(t=(0.4, 0.2 if k < 3 else -0.2, 0.1)), "work")
        for k in range(count)
    ]
    names = [body.name for body in bodies]
    return Scene(robot, robot, (TABLE,), tuple(bodies), supplies=(tuple(names[:3]), tuple(names[3:])))


def _line(unit: Unit, begin: Array, end: Array, held: str | None, name: str) -> Move:
    begin, end = unit.counts(begin), unit.counts(end)
    path = CountPath(tuple(begin.tolist()), (Segment(1000, (tuple((end - begin).tolist()),)),))
    return Move(name, "transit", None, path, held, 0.0, 0.0, ("", ""), True)


@pytest.mark.parametrize("seed", range(6))
def test_the_planner_and_the_verification_have_the_same_bodies_at_every_move(crs97: Unit, seed: int) -> None:
    robot, rng = load_a465(0.134112, 0.06), np.random.default_rng(seed)
    scene = _supplied(robot, 7)
    queues, targets, at = [list(supply) for supply in scene.supplies], list[Target](), np.zeros(6)
    steps, held = list[Step](), None
    while held is not None or any(queues):
        q = crs97.positions(
            crs97.counts(np.array([0.0, 0.0, -0.8, 0.0, -0.8, 0.0]) + rng.uniform(-0.2, 0.2, 6))
        )
        name = f"goal {len(targets)}"
        steps.append(_line(crs97, at, q, held, name))
        if rng.uniform() < 0.3:  # a goal on the way
            targets.append(Target(name, q=q))
            steps.append(Pause(name, 0.0))
        elif held is None:
            queue = queues[int(rng.choice([i for i, left in enumerate(queues) if left]))]
            held = queue.pop(0)
            targets.append(Target(name, q=q, attach=held, jaws=1.0))
            steps += [GripperStep(name, "close", None, 1.0, 1.0), Pause(name, 0.0, held)]
        else:
            targets.append(Target(name, q=q, detach=True, jaws=0.0))
            steps += [GripperStep(name, "open", None, 0.0, 1.0), Pause(name, 0.0, None, held)]
            held = None
        at = q
    plan = Plan({}, crs97.name, 1.0, (0,) * 6, (0,) * 6, tuple(steps), {})
    worlds, state, checked = AttachmentWorlds(scene, targets), None, 0
    for number, of in enumerate(scenes_of_moves(plan, scene, crs97)):
        goal = targets[number - 1]
        state = worlds.start if state is None else worlds.after(state, goal, robot.T_base_tool(goal.q))
        planned, verified = worlds.world(state), of.world()
        assert sorted(planned.names) == sorted(verified.names)
        assert planned.robot.digest == verified.robot.digest
        assert (of.held is None) == (state.held is None)
        there = {body.name: body.T_base_body for body in of.resting}
        for name, T in state.moved:
            np.testing.assert_allclose(there[name], T, atol=1e-12)
        assert {"ball 0", "ball 1", "ball 2"} - {*there, state.held} == scene.absent(state.put_down) & {
            "ball 0", "ball 1", "ball 2"}  # fmt: skip
        checked += 1
    assert checked == len(targets) > 14


def test_a_body_that_is_not_there_yet_cannot_be_attached(robot: Robot, crs97: Unit) -> None:
    scene = _supplied(robot, 4)
    take = Target("take", q=np.zeros(6), attach="ball 1")
    with pytest.raises(
        InputError, match="attach = 'ball 1': is not there before the one in front of it is put down"
    ):
        AttachmentWorlds(scene, [take])
    again = [Target("take", q=np.zeros(6), attach="ball 0"), Target("put", q=np.zeros(6), detach=True),
             Target("again", q=np.zeros(6), attach="ball 0")]  # fmt: skip
    with pytest.raises(
        InputError, match="target 'again': attach = 'ball 0': was put down, and comes from its supply"
    ):
        AttachmentWorlds(scene, again)
    steps = (_line(crs97, np.zeros(6), np.full(6, 0.1), None, "to take"), Pause("take", 0.0, "ball 1"))
    with pytest.raises(
        ImpossibleError, match="'take' takes ball 1, which is not there before the one in front"
    ):
        list(scenes_of_moves(Plan({}, crs97.name, 1.0, (0,) * 6, (0,) * 6, steps, {}), scene, crs97))


def test_a_search_takes_a_part_for_where_it_should_be_if_it_is_alike(robot: Robot) -> None:
    box = Body("box 1", Box((0.04, 0.04, 0.03)), transform(t=(0.4, -0.2, 0.015)), "work")
    take, put = (
        Target("take", down(0.4, -0.2, 0.015), attach="box 1"),
        Target("put", down(0.4, 0.2, 0.015), detach=True),
    )
    worlds = AttachmentWorlds(Scene(robot, robot, (TABLE,), (box,), supplies=(("box 1",),)), [take, put])
    quarter, aside = transform(rot_z(np.pi / 2.0)), transform(t=(3e-5, 0.0, 0.0))
    held = worlds.searched(worlds.start, 0, take.T_base_tool @ quarter @ aside)
    assert held is worlds.nominal_state(1)
    brought = worlds.searched(held, 1, put.T_base_tool @ aside @ quarter @ quarter)
    assert brought is worlds.nominal_state(2)
    for other in (transform(rot_z(0.02)), transform(t=(5e-4, 0.0, 0.0))):
        off = worlds.searched(worlds.start, 0, take.T_base_tool @ other)
        assert off is not held
        np.testing.assert_allclose(
            off.T_tool_held, np.linalg.inv(take.T_base_tool @ other) @ box.T_base_body, atol=1e-9
        )
