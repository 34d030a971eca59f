"""One way from rest to rest: what stands against it is told in the words of who asked."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError, InputError
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.budget import TransitBudget
from plan.options import PlanOptions
from plan.program.go_to import plan_joint_motion
from plan.scene import Scene
from tasks.task2 import Q_START, TABLE, task2

UNIT = load_unit("crs93")
ROBOT = task2().scene.robot_open
Q_END = np.radians([60.0, -40.0, -80.0, 0.0, -60.0, 0.0])
FEW = TransitBudget(corners=20, corner_edges=5, rrt=20)


def scene(*bodies: Body) -> Scene:
    return Scene(ROBOT, ROBOT, (TABLE, *bodies), ())


def under_the_tool(gap: float) -> Body:
    tool = ROBOT.T_base_tool(Q_START)
    T = transform(t=tool[:3, 3] + [0.0, 0.0, -0.025 - gap])
    return Body("crate", Box((0.05, 0.05, 0.05)), T, "wall")


def test_the_searchs_margin_does_not_show() -> None:
    options = PlanOptions(clearance=0.010, transit=FEW)
    walls = [
        Body(f"wall {side:+d}", Box((2.0, 0.02, 3.0)), transform(t=(side * 1.16, 0.0, 1.0)), "wall")
        for side in (-1, 1)
    ]
    walls.append(Body("wall above", Box((0.6, 0.02, 2.0)), transform(t=(0.0, 0.0, 1.5)), "wall"))
    for bodies, words in (
        ((under_the_tool(0.0095),), "the start of the motion is itself too near"),
        (walls, r"no path around wall \+1 was found; on the straight motion \w+ "),
    ):
        with pytest.raises(ImpossibleError, match=words) as caught:
            plan_joint_motion(scene(*bodies), Q_START, Q_END, UNIT, options=options)
        assert "(required: 10 mm)" in str(caught.value)
        assert caught.value.data["clearance_m"] == 0.010


def test_a_start_that_keeps_what_is_asked_may_lack_the_margin() -> None:
    plan = plan_joint_motion(
        scene(under_the_tool(0.0104)), Q_START, Q_END, UNIT, options=PlanOptions(clearance=0.010)
    )
    assert plan is not None
    assert min(m.clearance for m in plan.moves) >= 0.010


@pytest.mark.parametrize(("end", "word"), [("from", "start"), ("to", "end")])
@pytest.mark.parametrize("kind", ["body", "cube"])
def test_an_end_that_is_too_near_is_named(end: str, word: str, kind: str) -> None:
    """Bodies and cubes, at either end, with more distance than none."""
    crate = under_the_tool(0.006)
    among = Scene(ROBOT, ROBOT, (TABLE,), (crate,)) if kind == "cube" else scene(crate)
    q = (Q_START, Q_END) if end == "from" else (Q_END, Q_START)
    with pytest.raises(ImpossibleError, match=f"the {word} of the motion is itself too near") as caught:
        plan_joint_motion(among, *q, UNIT, options=PlanOptions(clearance=0.010, transit=FEW))
    assert caught.value.data["end"] == end
    assert caught.value.data["pair"][1] == "crate"
    assert caught.value.data["distance_m"] == pytest.approx(0.006, abs=1e-3)


def test_a_motion_of_less_than_a_count_is_none() -> None:
    assert plan_joint_motion(scene(), Q_START, Q_START + 1e-9, UNIT) is None
    with pytest.raises(InputError, match="q_to: joint J2"):
        plan_joint_motion(scene(), Q_START, Q_START + np.array([0.0, 9.0, 0.0, 0.0, 0.0, 0.0]), UNIT)
