"""What a list of poses may ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import transform
from plan.options import PlanOptions
from plan.program.goals.target import Target


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"free": "yaw"}, "free = 'yaw': must be one of x, y"),
        ({"by": "air"}, "by = 'air': must be one of transit, line"),
        ({"approach": -0.1}, "approach = -0.1"),
        ({"T_base_tool": 2 * np.eye(4)}, "target 'a': T_base_tool"),
        ({"allowed_collisions": [("a",)]}, "pairs of two names"),
        ({"free": 5}, "free = 5: must be names out of x, y"),
        ({"ranges": [1]}, "ranges = .1.: must be like"),
        ({"tilt": "x"}, "tilt = 'x': must be from 0 to pi / 2"),
        ({"speed": "fast"}, "speed = 'fast': must be above 0"),
        ({"dwell_s": None}, "dwell_s = None: must not be negative"),
        ({"approach": np.ones(2)}, "approach = array of shape"),
        ({"jaws": "open"}, "jaws = 'open': must be from 0"),
        ({"line_clearance": -1.0}, "line_clearance = -1: must be from 0 to 0.1 m"),
        ({"line_clearance": np.nan}, "line_clearance = nan: must be from 0 to 0.1 m"),
        ({"T_base_tool": [[1, 2], [3]]}, "T_base_tool = .* must be a pose"),
        ({"attach": 5}, "attach = 5: must be the name of a body"),
        ({"look": "yes"}, "look = 'yes': must be True or False"),
        ({"role": "approach"}, "role = 'approach': must be one of transit, home"),
        ({"name": 5}, "name = 5: must be a name"),
        ({"attach": "cup", "detach": True}, "attach = 'cup': must not be combined with detach"),
        ({"T_base_tool": None, "q": [0.0] * 6, "by": "line"}, "q = 'a configuration': needs by='transit'"),
        ({"T_base_tool": None, "q": [0.0] * 6, "free": "rz"}, "q = 'a configuration': .* must not have free"),
        (
            {"free": "rx", "tilt": 0.2},
            "tilt = 0.2: cannot be combined with rx or ry; tilt, 11.4592 deg, frees both",
        ),
        ({"ranges": {"ry": (0.0, 0.1)}, "tilt": 0.2}, "tilt = 0.2: cannot be combined with rx or ry"),
        ({"ranges": {"x": (0.1, -0.1)}}, "ranges\\['x'\\] = .*: must be a lowest and a highest value"),
        ({"ranges": {"rz": (-4.0, 0.0)}}, "ranges\\['rz'\\] = .*: must be a lowest .* from -3.1416"),
        ({"T_base_tool": np.stack([np.eye(4)] * 2), "by": "line"}, "must be one pose if by='line'"),
        ({"T_base_tool": np.zeros((0, 4, 4))}, "must be at least one pose"),
    ],
)
def test_wrong_targets(change: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Target(**{"name": "a", "T_base_tool": np.eye(4), **change})


@pytest.mark.parametrize(
    "freedom",
    [
        {"free": "x", "ranges": {"rz": (0.5, 1.0)}},
        {"free": "y z", "tilt": 0.2},
        {"free": "rx", "ranges": {"ry": (0.2, 0.4)}},
        {"free": "rx rz", "ranges": {"ry": (0.2, 0.4)}, "by": "line"},
    ],
)
def test_no_axis_is_free_that_would_turn_with_what_is_free_within_limits(freedom: dict[str, object]) -> None:
    """Solutions for such a pose were up to 0.3 m away from what was asked."""
    with pytest.raises(InputError, match="must not be free with a tilt or ranges of rotations"):
        Target("a", np.eye(4), **freedom)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "freedom",
    [
        {"free": "rz", "tilt": 0.2},
        {"free": "x y z", "ranges": {"rz": (0.5, 1.0)}},
        {"free": "rx", "ranges": {"y": (-0.1, 0.1)}},
        {"free": "x", "ranges": {"rz": (0.5, 1.0)}, "by": "line"},
    ],
)
def test_what_is_free_and_what_is_limited_go_together_where_no_axis_turns(freedom: dict[str, object]) -> None:
    assert Target("a", np.eye(4), **freedom).freedom  # type: ignore[arg-type]


PATH = np.stack([transform(t=(0.1 * k, 0.0, 0.2)) for k in range(3)])


@pytest.mark.parametrize(
    ("change", "key", "says"),
    [
        ({"T_base_tool": np.eye(4)}, "T_base_tool", "must be poses .k, 4, 4. if by='path'"),
        (
            {"T_base_tool": PATH[:1]},
            "T_base_tool",
            "a path of 1 poses: must have at least two different ones",
        ),
        (
            {"T_base_tool": PATH[[1, 1]]},
            "T_base_tool",
            "a path of 2 poses: must have at least two different ones",
        ),
        ({"T_base_tool": None, "q": [0.0] * 6}, "q", "a configuration': needs by='transit'"),
        ({"free": "rz x"}, "free", "free = 'x': on a path only rz may be free without limits"),
        ({"free": "ry"}, "free", "free = 'ry': on a path only rz .* give it a range or a tilt"),
        ({"approach": 0.1}, "approach", "approach = 0.1: must be 0 if by='path'; begin the path further out"),
        ({"retract": 0.2}, "retract", "retract = 0.2: must be 0 if by='path'"),
        ({"back": "yes"}, "back", "back = 'yes': must be True or False"),
        ({"by": "line", "T_base_tool": np.eye(4), "back": True}, "back", "back = True: needs by='path'"),
        ({"by": "transit", "back": True}, "back", "back = True: needs by='path'"),
        ({"by": "transit", "threaded": "wire"}, "threaded", "threaded = 'wire': needs by='path'"),
        ({"clearance_of": "post"}, "clearance_of", "clearance_of = 'post': must be names of bodies"),
        ({"clearance_of": 5}, "clearance_of", "clearance_of = 5: must be names of bodies"),
        ({"clearance_of": [1]}, "clearance_of", "clearance_of = .*: must be names of bodies"),
        ({"threaded": 5}, "threaded", "threaded = 5: must be the name of a thread, or None"),
    ],
)
def test_wrong_paths(change: dict[str, object], key: str, says: str) -> None:
    with pytest.raises(InputError, match=f"target 'a': .*{says}") as error:
        Target(**{"name": "a", "T_base_tool": PATH, "by": "path", **change})
    assert error.value.data["key"] == key


def test_a_path_ends_at_its_last_pose_and_has_what_is_free_along_it() -> None:
    ranges = {"y": (-0.1, 0.0)}
    target = Target("a", PATH, by="path", free="rz", tilt=0.2, ranges=ranges, back=True)
    assert np.array_equal(target.poses, PATH[-1:])
    assert np.array_equal(target.curve.T, PATH)
    assert (target.curve.freedom, target.curve.free) == (target.freedom, ("rz",))
    assert (target.freedom.ranges, target.freedom.tilt) == (ranges, 0.2)
    assert len(Target("a", PATH).poses) == 3  # otherwise one of them


def test_the_tool_stops_where_something_is_done() -> None:
    flown = Target("a", np.eye(4), blend_radius=0.01, approach=0.1, speed=0.1, by="line")
    assert not flown.stops
    acts = ({"jaws": 0.0}, {"attach": "cup"}, {"detach": True}, {"dwell_s": 0.1}, {"look": True})
    assert all(replace(flown, **act).stops for act in acts)  # type: ignore[arg-type]


def test_lines_have_the_clearance_of_their_target_or_of_the_options() -> None:
    options = PlanOptions(clearance=0.02, line_clearance=0.007)
    target = Target("a", np.eye(4))
    asked = [
        replace(target, line_clearance=least).clearance_on_lines(options) for least in (None, 0.0, 0.003)
    ]
    assert asked == [0.007, 0.0, 0.003]
