"""Options that a user gives: less clearance than usual is asked for by name."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import rot_z, transform
from plan.options import LEAST_CLEARANCE, PlanOptions, clearance_words
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import EFFORT, TABLE, down


def test_less_than_the_usual_clearance_is_asked_for_by_name() -> None:
    with pytest.raises(
        InputError, match=r"clearance = 0.002 m: must be from 0.005 to 1 m; .* least_clearance"
    ):
        PlanOptions(clearance=0.002)
    asked = PlanOptions(clearance=0.002, least_clearance=0.001)
    assert (asked.clearance, asked.to_json()["least_clearance"]) == (0.002, 0.001)
    with pytest.raises(InputError, match=r"clearance = 0.002 m: must be from 0.003 to 1"):
        PlanOptions(clearance=0.002, least_clearance=0.003)
    for wrong in (-0.001, 0.006, np.nan, "1"):
        with pytest.raises(InputError, match="least_clearance = "):
            PlanOptions(least_clearance=wrong)  # type: ignore[arg-type]
    assert PlanOptions(clearance=0.0, least_clearance=0.0).clearance == 0.0


def test_a_clearance_below_the_usual_minimum_gives_a_warning() -> None:
    assert clearance_words(PlanOptions(clearance=0.0015, least_clearance=0.001).to_json()) == (
        "planned with only 1.5 mm of clearance, as least_clearance allows; the usual minimum is 5 mm"
    )
    assert clearance_words(PlanOptions(clearance=LEAST_CLEARANCE).to_json()) == ""
    assert clearance_words(PlanOptions(least_clearance=0.001).to_json()) == ""
    assert clearance_words({}) == ""


def test_a_smaller_clearance_fits_between_plates(robot: Robot, crs97: Unit) -> None:
    """A pose between two plates that leave the open fingers 3.5 mm on each side."""
    place = down(0.42, 0.0, 0.1) @ transform(rot_z(np.pi))
    fingers = [b.at(b.T_base_body) for b in robot.bodies_at(np.zeros(6)) if b.name.startswith("finger")]
    T_tool = np.linalg.inv(robot.T_base_tool(np.zeros(6)))
    reach = max(
        float(np.abs((T_tool @ b.T_base_body)[1, 3]) + b.shape.size[1] / 2.0)
        for b in fingers
        if isinstance(b.shape, Box)
    )
    plates = [
        Body(
            f"plate {i}",
            Box((0.1, 0.01, 0.03)),
            transform(t=(0.42, side * (reach + 0.0035 + 0.005), 0.105)),
            "wall",
        )
        for i, side in enumerate((-1.0, 1.0))
    ]
    start = np.radians([-35, -35, -85, 0, -60, 0])

    def plan(**options: float):  # type: ignore[no-untyped-def]
        return plan_poses(
            robot, [TABLE, *plates], [Target("between", place)], start, crs97.limits(),
            options=PlanOptions(speed=1.0, **options), effort=EFFORT,
        )  # fmt: skip

    with pytest.raises(ImpossibleError, match=r"is 3\.\d mm from plate \d \(required: 5 mm\)"):
        plan(clearance=0.005)
    assert 0.002 <= plan(clearance=0.002, least_clearance=0.002).clearance <= 0.0036
