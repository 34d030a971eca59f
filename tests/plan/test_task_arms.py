"""Tasks with arms that have no closed form: the same search over order, places and grasps, the same certificate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.robot.tool import urdf_limits
from arm.se3 import rot_z, transform
from arms.made_up import SEVEN, arm
from plan.cartesian.reachability import reach
from plan.failure import of_choice
from plan.options import PlanOptions
from plan.program.tasks import plan_task
from plan.scene import Scene, Station, Transfer, scene_from_json
from plan.trajectory.virtual_unit import virtual_unit
from plan.verify import replay
from tasks.pose_lists import TABLE, down

SIZE = 0.06
Q = np.array([0.0, 0.3, 0.0, 1.5, 0.0, 1.2, 0.0])
OPTIONS = PlanOptions(
    speed=1.0, clearance=0.01, line_clearance=0.003, offset=0.08, look="never", certificate="decide"
)


def station(name: str, x: float, y: float) -> Station:
    T = down(x, y, SIZE + 0.002)
    return Station(
        name, tuple(T @ transform(rot_z(k * np.pi / 2)) for k in range(2)), frozenset(("table", "l7"))
    )


@pytest.mark.slow
def test_a_seven_joint_arm_moves_two_boxes(tmp_path: Path) -> None:
    robot = arm(tmp_path, SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    limits = urdf_limits(robot, 4.0)
    table = Body(TABLE.name, TABLE.shape, transform(t=(0.0, 0.0, -0.06)) @ TABLE.T_base_body, "table")
    picks = [station("a", 0.45, -0.15), station("b", 0.35, -0.3)]
    places = [station("c", 0.45, 0.15), station("d", 0.35, 0.3)]
    boxes = [
        Body(
            f"box {p.name}",
            Box((SIZE, SIZE, SIZE)),
            transform(t=(*p.T_base_tool[0][:2, 3], SIZE / 2)),
            "cube",
        )
        for p in picks
    ]
    scene = Scene(robot, robot, (table,), tuple(boxes))
    transfers = [Transfer(b.name, p, q) for b, p, q in zip(boxes, picks, places, strict=True)]
    unit = virtual_unit(robot, limits)
    plan = plan_task(scene, transfers, Q, unit, limits, OPTIONS)
    assert {cube["to"] for cube in plan.task["cubes"]} == {"c", "d"}
    assert 0.7 * plan.duration_s < plan.task["no_plan_is_faster_than_s"] <= plan.duration_s
    again = scene_from_json(plan.scene, robot, robot)
    assert len(replay(plan, again, unit, limits)) == len(list(plan.moves))


def test_what_is_out_of_reach_is_said(tmp_path: Path) -> None:
    robot = arm(tmp_path, SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    table = reach(robot, urdf_limits(robot, 4.0), {"far": [down(1.6, 0.0, 0.2)]}, 0.08)
    assert not table.ok
    with pytest.raises(ImpossibleError, match=r"hole far: .* no solution of the pose was found"):
        table.require()
    missed = of_choice(table["far"].best)
    assert (missed.reason, missed.excess_deg) == ("no solution of the pose was found", None)
