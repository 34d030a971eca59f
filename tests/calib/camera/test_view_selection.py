"""Which photographs can be used, and which of many are: the rules alone, without an adjustment."""

from dataclasses import replace

import numpy as np
import pytest

from calib.camera.view_selection import TargetPhoto, left_out, outlying_views, unusable
from pictures.targets import CHARUCO, photos, poses, quality, seen
from vision.targets.target import TargetView


def part(view: TargetView, corners: np.ndarray) -> TargetView:
    chosen = np.isin(view.ids, corners)
    return replace(view, ids=view.ids[chosen], corners_px=view.corners_px[chosen])


def test_a_blur_that_all_photographs_have_is_no_reason_and_a_little_more_is_none_either() -> None:
    given = photos([seen(T, np.random.default_rng(1)) for T in poses(1, 6)])
    blurred = [0.5, 0.5, 1.4, 1.6, 0.5, 0.5]
    reasons = unusable([replace(p, quality=quality(blur_px=b)) for p, b in zip(given, blurred, strict=True)])
    assert [bool(reason) for reason in reasons] == [False, False, False, True, False, False]
    assert reasons[3] == "blurred: edges are 1.6 px wide, in the sharpest views 0.5 px"
    soft = [1.6, 1.6, 3.1, 3.3, 1.6, 1.6]
    reasons = unusable([replace(p, quality=quality(blur_px=b)) for p, b in zip(given, soft, strict=True)])
    assert [bool(reason) for reason in reasons] == [False, False, False, True, False, False]


def test_corners_on_one_line_say_nothing_and_two_rows_do() -> None:
    view = next(
        v for T in poses(2, 10) if len((v := seen(T, np.random.default_rng(2))).ids) == CHARUCO.corners
    )
    row, two_rows = (photos([part(view, np.arange(n))])[0] for n in (6, 12))
    assert unusable([row]) == ["all detected corners lie on one line"]
    assert unusable([two_rows]) == [""]
    nothing = TargetPhoto("a.png", None, None)
    assert unusable([nothing])[0].startswith("fewer than 6 corners of the target detected")


@pytest.mark.parametrize(("ratio", "out"), [(2.0, False), (3.0, True)])
def test_a_view_is_out_for_several_times_the_error_of_the_others(ratio: float, out: bool) -> None:
    variances = np.full(10, 0.1**2)
    variances[4] *= ratio**2
    assert np.flatnonzero(outlying_views(variances, np.full(10, 40))).tolist() == ([4] if out else [])
    assert not outlying_views(variances * 0.03**2, np.full(10, 40)).any()
    few_corners = np.where(np.arange(10) == 4, 2, 40)
    assert outlying_views(variances, few_corners)[4] == (ratio**2 > 1 + 4 * np.sqrt(2 / 2))


def test_photographs_that_all_are_blurred_beyond_use_are_named() -> None:
    found = photos([seen(T, np.random.default_rng(1)) for T in poses(3, 4)], quality(blur_px=4.5))
    assert all(reason.startswith("blurred: edges are 4.5 px wide") for reason in unusable(found))


def test_each_reason_is_told_once_with_its_images() -> None:
    names, same = [f"{k:02d}.png" for k in range(7)], "shows the target in the same place as 00.png"
    assert left_out(names, ["", *[same] * 5, "blurred"]) == f"01.png and 4 more: {same}; 06.png: blurred"
    assert left_out(names[:3], ["", same, same]) == f"01.png, 02.png: {same}"
    assert left_out(names[:1], [""]) == ""
