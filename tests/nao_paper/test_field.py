"""Field lines in the image of a standing NAO: none is off if all is known, and errors have the size that they must."""

import numpy as np
import pytest
from nao_paper_bench.charts import Cloud, board_figure, residual_figure
from nao_paper_bench.field import draw_field, field_errors, field_lines
from nao_paper_bench.kinematics import NaoKinematics

from calib.nao.chain import NaoUnknowns

PAPER = NaoUnknowns()


def nao(**degrees):
    x = np.zeros(21)
    for name, value in degrees.items():
        x[PAPER.names.index(f"{name}_deg")] = np.radians(value)
    return NaoKinematics(PAPER, x)


def test_lines_are_those_of_the_field():
    lines = field_lines()
    ends = np.concatenate(lines)
    assert ends.max(axis=0) == pytest.approx([4.5, 3.0])
    assert np.linalg.norm(lines[-1], axis=1) == pytest.approx(0.75)
    assert sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines) == pytest.approx(
        2 * 9.0 + 3 * 6.0 + 2 * (2.2 + 2 * 0.6) + 2 * np.pi * 0.75, rel=1e-3
    )


def test_nothing_is_off_if_all_is_known():
    known = nao(CamPitch=-4.5, LHipPitch=0.8)
    e = field_errors(known, known)
    assert e.points > 500
    assert max(e.median_px, e.p90_px, e.median_m, e.p90_m) < 1e-9


def test_a_pitched_camera_shifts_lines_by_its_angle():
    """1 deg is 9.8 px in the image's middle; on the ground it is (h^2 + d^2) / h per rad."""
    e = field_errors(nao(CamPitch=1.0), nao())
    assert 562.5 * np.radians(1.0) <= e.median_px < 1.25 * 562.5 * np.radians(1.0)
    near, far = ((h**2 + d**2) / h * np.radians(1.0) for h, d in ((0.45, 0.6), (0.45, 3.0)))
    assert near < e.median_m < far
    assert e.p90_m > e.median_m


def test_a_joint_of_the_standing_leg_counts_and_the_other_leg_does_not():
    assert field_errors(nao(LKneePitch=1.0), nao()).median_px > 5.0
    assert field_errors(nao(RKneePitch=5.0), nao()).median_px < 1e-9


def test_pictures_show_what_they_are_told():
    right, wrong = draw_field(nao(), nao(), "same"), draw_field(nao(CamPitch=4.0), nao(), "off")

    def apart(picture):
        """Rows between the nearest line's white and red in the middle of the image."""
        column = picture[40:, 320].astype(int)
        red = (column[:, 2] > 200) & (column[:, 1] < 90)
        white = (column > 200).all(axis=1)
        return np.flatnonzero(white).max() - np.flatnonzero(red).max()

    assert 0 <= apart(right) < 12  # inside the line's width
    assert (
        abs(apart(wrong) + 562.5 * np.radians(4.0)) < 12
    )  # the true camera looks lower: its lines are higher


def test_figures_have_their_parts():
    rng = np.random.default_rng(0)
    cloud = Cloud("(a)", {"L": rng.standard_normal((50, 2)), "R": rng.standard_normal((50, 2)) + 2.0})
    picture = residual_figure([cloud, cloud])
    blue = (picture[..., 0] > 150) & (picture[..., 2] < 60)
    red = (picture[..., 2] > 190) & (picture[..., 0] < 60)
    assert blue.sum() > 100
    assert red.sum() > 100
    # R stands to the right of L, and higher
    (yb, xb), (yr, xr) = (np.argwhere(c[:, : picture.shape[1] // 2]).mean(axis=0) for c in (blue, red))
    assert xr > xb + 20
    assert yr < yb - 20
    y, x = np.meshgrid(100.0 + 30 * np.arange(4), 100.0 + 30 * np.arange(6), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel()], axis=-1)
    image = np.full((480, 640), 128, dtype=np.uint8)
    shown = board_figure(image, vertices, vertices + 8.0, vertices)
    assert shown.shape == (480, 1280, 3)
    changed = (shown != 128).any(axis=2)[60:]
    assert changed[:, :640].sum() > 200
    assert changed[:, 640:].sum() > 200
