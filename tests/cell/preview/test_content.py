"""What the page is given: one clock, cubes that move with the jaws, the arm's kinematics; no way out of the file."""

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import InputError
from arm.se3 import rotation, transform
from cell.preview.content import page_content
from pages.content import matrix


def test_the_chain_is_the_robot(preview_case) -> None:
    content = page_content(
        preview_case.plan, preview_case.robot_open, preview_case.robot_holding, preview_case.unit
    )
    rng = np.random.default_rng(5)
    for q in rng.uniform(preview_case.unit.lower, preview_case.unit.upper, (20, 6)):
        T = np.eye(4)
        for joint, angle in zip(content["arm"]["chain"], q, strict=True):
            assert joint["revolute"]
            T = T @ matrix(joint["T"]) @ transform(rotation(np.array(joint["axis"]) * angle))
        T = T @ matrix(content["arm"]["T_end_tool"])
        assert np.abs(T - preview_case.robot_open.T_base_tool(q)).max() < 1e-6


def test_another_units_plan_is_refused(preview_case) -> None:
    with pytest.raises(InputError, match=r"unit = 'crs97': the plan is for 'crs93'"):
        page_content(
            preview_case.plan, preview_case.robot_open, preview_case.robot_holding, load_unit("crs97")
        )
