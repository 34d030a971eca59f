"""The example of docs/python.md runs as it is printed, on an arm and a mesh that are made up here."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import plan.api
from arm.bodies import Body, Box
from arm.outfit import ignoring, urdf_limits
from arm.robot import load_robot
from arm.se3 import rot_x, transform
from made_up_arms import UR_LIKE, urdf
from plan.ik_numeric import solve_ik
from plan.world import World

PAGE = Path(__file__).resolve().parents[2] / "docs/python.md"


def test_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    # the second offset shortened, so that only neighbours overlap
    joints = [
        ("0 0 0.15", *UR_LIKE[0][1:]),
        ("0 0.15 0", *UR_LIKE[1][1:]),
        ("0 0 0.4", *UR_LIKE[2][1:]),
        *UR_LIKE[3:],
    ]
    Path("my_arm.urdf").write_text(urdf(joints).replace("l6", "flange"))
    corners = [(0.05, 0.0, 0.0), (-0.05, 0.05, 0.0), (-0.05, -0.05, 0.0), (0.0, 0.0, 0.2)]
    Path("jug.stl").write_text("solid\n" + "\n".join(f"vertex {x} {y} {z}" for x, y, z in corners))
    robot = load_robot(Path("my_arm.urdf"), "flange", np.eye(4))
    limits = urdf_limits(robot, 4.0)
    table = Body("table", Box((1.0, 1.0, 0.04)), transform(t=(0.4, 0.0, -0.02)), "table")
    world = World(ignoring(robot, neighbours=True), [table])
    found = solve_ik(robot, transform(rot_x(np.pi), (0.35, -0.25, 0.3)), limits.lower, limits.upper).q
    q_start = next(q for q in found if not world.in_collision(q, 0.03))
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert code is not None
    names: dict[str, object] = {"q_start": q_start}
    exec(code[1], names)
    made = names["plan"]
    assert isinstance(made, plan.api.PosePlan)
    assert [r.target for r in made.reached] == ["start", "end"]
    assert made.clearance >= 0.005


def test_the_page_and_the_module_name_what_there_is() -> None:
    for name in re.findall(r"`(\w+)\(", PAGE.read_text()):
        assert hasattr(plan.api, name), name
    assert sorted(plan.api.__all__) == sorted(set(plan.api.__all__))
    for name in plan.api.__all__:
        assert getattr(plan.api, name).__doc__, name
