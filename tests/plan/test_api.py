"""The example of docs/python.md runs as it is printed, on an arm and a mesh that are made up here."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import a465
import plan.api
from arm.errors import InputError
from arm.robot.model import Robot, load_robot
from arm.robot.tool import with_disabled_collisions
from arms.made_up import SEVEN, UR_LIKE, urdf
from plan.collision.world import World
from plan.program.goals.target import Target

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
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert code is not None
    names: dict[str, object] = {}
    exec(code[1], names)
    made = names["plan"]
    assert isinstance(made, plan.api.Planned)
    assert [r.target for r in made.reached] == ["start", "end"]
    assert made.clearance >= 0.005


def test_the_page_and_the_module_name_what_there_is() -> None:
    for name in re.findall(r"`(\w+)\(", PAGE.read_text()):
        assert hasattr(a465, name), name
    assert sorted(plan.api.__all__) == sorted(set(plan.api.__all__))
    for name in plan.api.__all__:
        assert getattr(plan.api, name).__doc__, name


def test_links_without_length_are_refused_as_on_the_page(tmp_path: Path) -> None:
    """An arm of seven axes, three pairs of which meet: neighbours alone are not enough, and the page's lines are."""
    path = tmp_path / "seven.urdf"
    path.write_text(urdf(SEVEN))
    robot = load_robot(path, "l7", np.eye(4))
    q = np.radians([0.0, 40.0, 0.0, 60.0, 0.0, 50.0, 0.0])
    assert World(with_disabled_collisions(robot, neighbours=True), []).in_collision(q, 0.0)
    code = re.search(r"```py\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert code is not None
    names: dict[str, object] = {"robot": robot, "with_disabled_collisions": with_disabled_collisions}
    exec(code[1], names)
    told = names["robot"]
    assert isinstance(told, Robot)
    assert not World(told, []).in_collision(q, 0.0)


def test_free_directions_may_be_one_text() -> None:
    for free in ("rx rz", "rz,rx", "rx, rz", ("rx", "rz")):
        assert Target("a", np.eye(4), free=free).free == ("rx", "rz")
    assert Target("a", np.eye(4)).free == ()
    with pytest.raises(InputError, match="must be one of x, y, z, rx, ry, rz"):
        Target("a", np.eye(4), free="rx rq")
