"""Ways along curves: on the curve everywhere, certified, and the same each time; a refusal says what fails."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.robot.tool import urdf_limits
from arm.se3 import Array
from arms.made_up import UR5, arm
from plan.cartesian.line import JointPath
from plan.collision.certificate import ClearanceCertificate
from plan.collision.world import World
from plan.curve import planner as planner_module
from plan.curve.planner import ANGLE_TOLERANCE, TOLERANCE, CurvePlanner, _unwrapped
from plan.curve.tool_curve import ToolCurve
from plan.kinematics.freedom import Freedom
from plans.curves import CLEARANCE, LINE, PLATE, POST, arc
from tasks.pose_lists import TABLE

STEP = 0.002  # rad, between configurations that are looked at
ROOM = 0.005  # rad, to the limits of the joints
CASES: dict[str, tuple[ToolCurve, list[Body]]] = {
    "fixed": (ToolCurve(LINE), []),
    "arc": (ToolCurve(arc(), free=("rz",)), []),
    "tilting past a post": (ToolCurve(LINE, Freedom({}, 0.5), ("rz",)), [POST]),
    "ranges": (ToolCurve(arc(), Freedom({"rx": (-0.3, 0.1), "rz": (-1.0, 0.3), "z": (-0.02, 0.0)})), []),
    "shorter than a step": (ToolCurve(arc(0.01, 0.3, 3), free=("rz",)), []),
}


def planner_of(robot: Robot, unit: Unit, curve: ToolCurve, bodies: list[Body]) -> CurvePlanner:
    return CurvePlanner("cut", robot, curve, World(robot, [TABLE, *bodies]), CLEARANCE, unit.limits())


@pytest.fixture(scope="module", params=list(CASES))
def followed(request: pytest.FixtureRequest, robot: Robot, crs97: Unit) -> tuple[CurvePlanner, JointPath]:
    planner = planner_of(robot, crs97, *CASES[request.param])
    return planner, planner.followed(planner.chains(1)[0])


def tools_of(robot: Robot, q: Array) -> Array:
    return np.stack([robot.T_base_tool(one) for one in q])


@pytest.mark.few(3)
def test_a_way_is_on_its_curve_at_1000_places(
    robot: Robot, crs97: Unit, followed: tuple[CurvePlanner, JointPath]
) -> None:
    planner, path = followed
    curve, limits = planner.curve, crs97.limits()
    assert (path.s[0], path.s[-1]) == (0.0, curve.length)
    q = path.spline(np.linspace(0.0, curve.length, 1000))
    for fraction in (np.linspace(0.0, 1.0, 1000), None):
        off = curve.deviation(tools_of(robot, q), None, fraction)
        assert off.distance.max() <= TOLERANCE
        assert off.angle.max() <= ANGLE_TOLERANCE
    assert (q >= limits.lower).all()
    assert (q <= limits.upper).all()
    assert (path.q >= limits.lower + ROOM - 1e-9).all()
    assert (path.q <= limits.upper - ROOM + 1e-9).all()


def test_a_way_goes_on_along_its_curve(robot: Robot, followed: tuple[CurvePlanner, JointPath]) -> None:
    """At each station the tool is at its place, as far as the freedom of positions allows to say."""
    planner, path = followed
    away, turned = planner.curve.excess(path.s, tools_of(robot, path.q))
    assert away.max() <= 2e-6
    assert turned.max() <= 2e-6


def test_a_way_keeps_its_clearance_at_small_steps(followed: tuple[CurvePlanner, JointPath]) -> None:
    planner, path = followed
    travel = float(np.abs(np.diff(path.q, axis=0)).max(axis=1).sum())
    places = np.linspace(0.0, path.s[-1], int(2.0 * travel / STEP) + 2)
    q = path.spline(places)
    assert np.abs(np.diff(q, axis=0)).max() <= STEP
    assert min(planner.world.distance(one).value for one in q) >= CLEARANCE


@pytest.mark.few(1)
@pytest.mark.parametrize("case", ["arc", "ranges"])
def test_the_same_curve_gives_the_same_bytes(robot: Robot, crs97: Unit, case: str) -> None:
    made = []
    for _ in range(2):
        planner = planner_of(robot, crs97, *CASES[case])
        made.append([planner.followed(chain).q.tobytes() for chain in planner.chains(2)])
    assert made[0] == made[1]


def test_as_many_chains_as_asked_for(robot: Robot, crs97: Unit) -> None:
    planner = planner_of(robot, crs97, ToolCurve(LINE, Freedom({}, 0.3), ("rz",)), [])
    every = planner.chains(8)
    assert len(every) > 1
    assert len({chain.branch for chain in every}) == len(every)
    assert [c.branch for c in planner.chains(1)] == [every[0].branch]
    assert [c.time for c in every] == sorted(c.time for c in every)


@pytest.mark.few(1)
@pytest.mark.parametrize("case", ["arc", "ranges"])
def test_a_path_may_begin_at_a_given_configuration(robot: Robot, crs97: Unit, case: str) -> None:
    """Within what is free there, between the samples."""
    planner = planner_of(robot, crs97, *CASES[case])
    q_start = planner.followed(planner.chains(1)[0]).q[0]
    (chain,) = planner.chains(4, q_start)
    assert np.array_equal(chain.q[0], q_start)
    path = planner.followed(chain, fixed=True)
    np.testing.assert_allclose(path.q[0], q_start, atol=1e-6)
    off = planner.curve.deviation(tools_of(robot, path.q), None, path.s / planner.curve.length)
    assert off.distance.max() <= TOLERANCE


def test_what_was_asked_for_is_named_when_nothing_is_clear(robot: Robot, crs97: Unit) -> None:
    planner = planner_of(robot, crs97, ToolCurve(LINE, free=("rz",)), [PLATE])
    with pytest.raises(
        ImpossibleError, match=r"path 'cut': no sampled way along it keeps 5.5 mm .5 mm required.* from plate"
    ) as error:
        planner.chains(1)
    assert error.value.data["clearance_m"] == CLEARANCE


@pytest.mark.slow
def test_a_failed_certificate_is_tried_again_with_more_room(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    rooms = []
    smoothing = planner_module.Smoothing

    def noted(*given):  # type: ignore[no-untyped-def]
        rooms.append(given[3][0].clearance)
        return smoothing(*given)

    monkeypatch.setattr(planner_module, "Smoothing", noted)
    failed = ClearanceCertificate(0.001, 0.0042, ("palm", "table"), 0.0, False, 1)
    monkeypatch.setattr(planner_module, "certify_curve", lambda *given: failed)
    planner = planner_of(robot, crs97, *CASES["arc"])
    says = r"path 'cut': palm comes within 4.2 mm of table \(required: 5 mm\)"
    with pytest.raises(ImpossibleError, match=says) as error:
        planner.followed(planner.chains(1)[0])
    assert error.value.data["pair"] == ["palm", "table"]
    assert error.value.data["distance_m"] == 0.0042
    assert len(rooms) == 3
    assert rooms == sorted(rooms)


def test_a_way_that_leaves_its_curve_is_refused(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = planner_of(robot, crs97, *CASES["arc"])
    places, off_at = [], 0.3 * planner.curve.length

    def beyond(way):  # type: ignore[no-untyped-def]
        places.append(way.places)
        return np.where((way.places[:-1] <= off_at) & (off_at < way.places[1:]), 1.7, 0.1)

    monkeypatch.setattr(planner, "beyond", beyond)
    with pytest.raises(ImpossibleError, match=r"the tool leaves it by 1.7 times what is allowed"):
        planner.followed(planner.chains(1)[0])
    for before, after in pairwise(places[:9]):  # stations are added there, and in the steps beside it
        added = np.setdiff1d(after, before)
        step = int(np.searchsorted(before, off_at, side="right")) - 1
        edges = before[max(step - 1, 0) : step + 3]
        np.testing.assert_allclose(added, 0.5 * (edges[1:] + edges[:-1]), atol=1e-12)
    assert len(places) >= 9


def test_an_arm_without_closed_form_is_refused(tmp_path: Path) -> None:
    other = arm(tmp_path, UR5, [("l0", "l2")])
    planner = CurvePlanner("cut", other, ToolCurve(LINE), World(other, []), 0.0, urdf_limits(other, 4.0))
    with pytest.raises(InputError):
        planner.chains(1)


@pytest.mark.parametrize("seed", range(5))
def test_angles_without_jumps_of_whole_revolutions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.cumsum(rng.uniform(-2.0, 2.0, 40))
    wrapped = angles - 2.0 * np.pi * rng.integers(-2, 3, 40)
    wrapped[0] = angles[0]
    np.testing.assert_allclose(_unwrapped(wrapped), angles, atol=1e-9)
