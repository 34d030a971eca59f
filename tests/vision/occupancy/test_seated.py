"""A cube that sits is told from one that does not, by its top alone; and what is not sure is said so."""

from __future__ import annotations

import numpy as np
import pytest

from arm.board import POCKET_MOUTH
from arm.robot.shapes import Body, Box
from arm.se3 import Array, rot_z, transform
from cell.files.world import RELEASES
from cell.scene.bodies import T_hole_cube, plate_body
from cell.sim.release_faults import T_hole_released
from pictures.boards import CUBE, TABLE, lab_board, lab_camera, leaning, window
from render.renderer import PlacedBoard, render, with_noise
from vision.camera.model import Camera
from vision.occupancy.cube_fit import PLACES
from vision.occupancy.cube_top import OUTWARD, CubeTop, measure_top
from vision.occupancy.seated import CubeWidth, Sight, seating, width_of

CENTRE = (0.46, -0.13, 0.09)
NOMINAL = CubeWidth(CUBE, 2e-5)


def _view(T_base_hole: Array) -> Camera:
    camera = lab_camera()
    centre = camera.project_base(T_base_hole[:3, 3][None])[0]
    return window(camera, np.round(centre - 200.0), (400, 400))


def _sight(
    T_hole_cube_now: Array, size: float = CUBE, tilt_deg: float = 15.0, hole: int = 0
) -> tuple[Sight, Array]:
    board = lab_board("03-04")
    T_base_board = leaning(CENTRE, 90.0, tilt_deg, 270.0)
    T_base_hole = T_base_board @ board.T_board_hole(hole)
    camera = _view(T_base_hole)
    cube = Body("cube", Box((size,) * 3), T_base_hole @ T_hole_cube_now, "cube")
    clean = render(
        camera,
        [TABLE, plate_body(board.name, T_base_board), cube],
        [PlacedBoard(board, T_base_board)],
        "DICT_4X4_50",
    )
    rng = np.random.default_rng(3)
    return Sight([with_noise(clean, rng, 2.0) for _ in range(3)], camera, NOMINAL), T_base_hole


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("tilt_deg", "hole"),
    [
        (0.0, 1),
        (15.0, 0),
        (15.0, 3),
        *(pytest.param(*of, marks=pytest.mark.slow) for of in ((0.0, 0), (0.0, 2), (15.0, 1), (15.0, 2))),
    ],
)
def test_a_seated_cube_is_seated_and_its_width_known_to_a_twentieth_of_a_millimetre(
    hole: int, tilt_deg: float
) -> None:
    sight, T_base_hole = _sight(T_hole_cube(CUBE), hole=hole, tilt_deg=tilt_deg)
    top = sight.in_hole(T_base_hole)
    assert top is not None
    assert seating(top, NOMINAL).state == "seated"
    width = width_of(top, CubeWidth(CUBE, 1e-4))
    assert width is not None
    assert width.value == pytest.approx(CUBE, abs=5e-5)


@pytest.mark.few(1)
@pytest.mark.parametrize("release", [r for r in RELEASES if r not in ("seated", "pushed")])
@pytest.mark.parametrize(
    ("tilt_deg", "hole"),
    [(15.0, 3), *(pytest.param(*of, marks=pytest.mark.slow) for of in ((0.0, 0), (0.0, 3), (15.0, 0)))],
)
def test_what_does_not_sit_is_never_seated(release: str, tilt_deg: float, hole: int) -> None:
    sight, T_base_hole = _sight(T_hole_released(release, CUBE), hole=hole, tilt_deg=tilt_deg)
    assert seating(sight.in_hole(T_base_hole), NOMINAL).state != "seated"


def test_a_wider_cube_is_told_from_a_higher_one_by_its_own_width() -> None:
    wide = CUBE + 1.5e-4  # seen from above as wide as one that stands 4 mm high
    sight, T_base_hole = _sight(T_hole_cube(CUBE) @ transform(t=(0.0, 0.0, 7.5e-5)), size=wide, tilt_deg=0.0)
    top = sight.in_hole(T_base_hole)
    assert seating(top, NOMINAL).state != "seated"
    assert seating(top, CubeWidth(wide, 2e-5)).state == "seated"
    assert width_of(top, NOMINAL) is None  # off by its nominal width, so its top does not determine the width
    known = width_of(top, CubeWidth(CUBE, 1e-4))
    assert known is not None
    assert known.value == pytest.approx(wide, abs=5e-5)


@pytest.mark.slow
def test_a_width_that_is_not_known_is_not_sure() -> None:
    sight, T_base_hole = _sight(T_hole_cube(CUBE), tilt_deg=0.0, hole=3)
    assert seating(sight.in_hole(T_base_hole), CubeWidth(CUBE, 1e-4)).state == "unsure"
    assert seating(None, NOMINAL).state == "unsure"


def _top(
    out: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0), std: float = 1e-5, high: float = 0.0, **values: object
) -> CubeTop:
    """A top whose sides are known to `std` m, `out` m out, of a cube that stands `high` m too high."""
    slope = np.array([0.2, 0.0])
    wider = CUBE / 2.0 * high
    at = wider - OUTWARD @ slope * high + np.array(out)
    usual = {
        "sides": -0.5 * ((PLACES - at[:, None]) / std) ** 2,
        "shown": np.full(4, 1e3),
        "turn": 0.0,
        "twist": 0.0,
        "distance": 1.0,
        "slope": slope,
        "size": CUBE,
        "rise": 3.0,
    }
    return CubeTop(**{**usual, **values})  # type: ignore[arg-type]


def test_each_rule_refuses_alone() -> None:
    assert seating(_top(), NOMINAL).state == "seated"
    for turn in (-3.2, 3.2):
        assert "rotated" in seating(_top(turn=np.radians(turn)), NOMINAL).reason
    assert "sideways" in seating(_top(out=(-1.1e-3, 0.0, 1.1e-3, 0.0)), NOMINAL).reason
    assert "square" in seating(_top(twist=20.0), NOMINAL).reason
    assert "do not show clearly" in seating(_top(shown=np.array([1e3, 5.0, 1e3, 5.0])), NOMINAL).reason
    assert (
        "not show the top of an upright cube"
        in seating(_top(shown=np.array([1e3, -50.0, 1e3, 1e3])), NOMINAL).reason
    )
    assert seating(_top(shown=np.array([1e3, 5.0, 1e3, 1e3])), NOMINAL).state == "seated"
    narrow = seating(_top(out=(5e-5, -5e-5, 5e-5, -5e-5), std=4e-6), CubeWidth(CUBE, 1e-6))
    assert narrow.state == "unsure"
    assert "sides of its top are not where" in narrow.reason


@pytest.mark.parametrize("high", [-2.5e-3, 2.5e-3, 4e-3, 6e-3])
def test_a_height_is_told_and_more_than_two_millimetres_is_not_seated(high: float) -> None:
    found = seating(_top(high=high), NOMINAL)
    assert found.state == "off"
    assert found.lift == pytest.approx(high, abs=3.0 * found.lift_std + 1e-4)
    assert f"{1e3 * found.lift:+.1f} mm" in found.reason


def test_what_does_not_tell_two_millimetres_from_four_is_unsure() -> None:
    flat = _top(std=5e-3)
    assert seating(flat, NOMINAL).state == "unsure"
    wide = seating(
        _top(std=2e-5, slope=np.zeros(2)), CubeWidth(CUBE, 8e-5)
    )  # no place tells it, and its own width not
    assert wide.state == "unsure"
    assert wide.lift_std > 1e-3


def test_a_side_that_does_not_show_says_nothing() -> None:
    """Another edge is taken for it; the other three decide, and if one of them is mistaken nothing does."""
    shown = np.array([1e3, 1e3, 1e3, 2.0])
    wrong = np.array(_top(shown=np.full(4, 1e3)).sides)
    wrong[3] = -0.5 * ((PLACES - 1e-3) / 1e-5) ** 2
    assert seating(_top(sides=wrong, shown=shown), NOMINAL).state == "seated"
    wrong[2] = -0.5 * ((PLACES + 1e-3) / 1e-5) ** 2
    assert seating(_top(sides=wrong, shown=shown), NOMINAL).state != "seated"


def test_the_fewer_sides_show_the_better_a_height_must_be_known() -> None:
    def state(seen: int, width_std: float) -> str:
        shown = np.where(np.arange(4) < seen, 1e3, 0.0)
        return seating(_top(shown=shown, slope=np.zeros(2)), CubeWidth(CUBE, width_std)).state

    assert [state(4, w) for w in (1e-5, 4e-5, 5e-5)] == ["seated", "seated", "unsure"]
    assert [state(3, w) for w in (1e-5, 3e-5, 4e-5)] == ["seated", "seated", "unsure"]
    assert state(2, 1e-6) == "unsure"  # right under the camera no place tells it


def test_with_three_sides_a_top_that_may_be_that_of_a_leaning_cube_is_unsure() -> None:
    """The middle of a half seated cube's top is 2.8 mm up, and its raised side does not show."""
    cube = CubeWidth(CUBE, 2.5e-5)
    for seen, state in ((4, "seated"), (3, "unsure")):
        shown = np.where(np.arange(4) < seen, 1e3, 0.0)
        found = seating(_top(high=1.2e-3, shown=shown, slope=np.zeros(2)), cube)
        assert found.state == state
        assert 0.6e-3 < found.lift_std < 0.9e-3


def test_one_side_that_is_mistaken_is_outvoted_and_two_are_not() -> None:
    sides = np.array(_top(shown=np.full(4, 1e3)).sides)
    elsewhere = np.maximum(-0.5 * ((PLACES - 4e-4) / 1e-5) ** 2, -60.0)
    for k in range(4):
        wrong = sides.copy()
        wrong[k] = elsewhere
        assert seating(_top(sides=wrong), NOMINAL).state == "seated"
        wrong[(k + 1) % 4] = elsewhere
        assert seating(_top(sides=wrong), NOMINAL).state != "seated"


def test_a_top_that_seems_lower_is_seated_unless_it_surely_is_lower() -> None:
    """Nothing stands lower than a seated cube: only height speaks against it, as far as it is not known."""
    weak = seating(_top(high=-2.2e-3, std=3e-5, slope=np.zeros(2)), CubeWidth(CUBE, 2e-5))
    assert weak.lift < -1e-3
    assert weak.lift_std > 0.8e-3
    assert weak.state == "seated"
    high = seating(_top(high=2.2e-3, std=3e-5, slope=np.zeros(2)), CubeWidth(CUBE, 2e-5))
    assert high.state == "unsure"
    assert seating(_top(high=-2.5e-3), NOMINAL).state == "off"


def test_the_height_of_a_wider_cube_is_that_of_a_seated_one() -> None:
    """A wider cube wedges higher: three times what it is wider, and it is seen wider for that too."""
    wide = 1e-4
    top = _top(out=(wide / 2.0,) * 4, high=3.0 * wide)
    found = seating(top, CubeWidth(CUBE + wide, 1e-5))
    assert found.state == "seated"
    assert found.lift == pytest.approx(0.0, abs=1e-4)
    width = width_of(top, CubeWidth(CUBE, 1e-4))
    assert width is not None
    assert width.value == pytest.approx(CUBE + wide, abs=1e-5)
    assert width.std < 2e-5


def test_a_width_is_told_only_by_what_sits_and_shows() -> None:
    assert width_of(None, NOMINAL) is None
    assert width_of(_top(turn=np.radians(3.2)), NOMINAL) is None
    assert width_of(_top(turn=np.radians(-3.2)), NOMINAL) is None
    assert width_of(_top(twist=20.0), NOMINAL) is None
    assert width_of(_top(shown=np.zeros(4)), NOMINAL) is None
    assert width_of(_top(out=(-1.1e-3, 0.0, 1.1e-3, 0.0)), NOMINAL) is None


@pytest.mark.slow
def test_a_cube_on_the_table_is_measured_too_and_its_place_is_in_view_or_not() -> None:
    T_base_place = transform(rot_z(0.0), (0.45, -0.15, 0.0))
    camera = _view(T_base_place)
    cube = Body("cube", Box((CUBE,) * 3), T_base_place @ transform(t=(0.0, 0.0, CUBE / 2.0)), "cube")
    image = with_noise(render(camera, [TABLE, cube], [], "DICT_4X4_50"), np.random.default_rng(1), 2.0)
    sight = Sight([image], camera, NOMINAL)
    assert seating(sight.on_plane(T_base_place), NOMINAL).state == "seated"
    assert seating(sight.on_plane(transform(t=(0.008, 0.0, 0.0)) @ T_base_place), NOMINAL).state != "seated"
    assert sight.shows(T_base_place[None, :3, 3])
    assert not sight.shows(np.array([[0.45, -0.4, 0.0]]))
    assert measure_top([image], camera, transform(t=(0.0, -0.4, 0.0)), CUBE, CUBE, POCKET_MOUTH) is None
