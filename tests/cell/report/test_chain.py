"""The page of a chain's calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.hand_eye.calibrate import HandEye
from cell.report.chain import chain_page
from cell.report.chain_text import (
    hand_eye_tables,
    print_hand_eye,
)
from typed.heard import Heard


def test_nothing_is_told_of_images_left_out_where_none_is(found: HandEye) -> None:
    whole = replace(found.chain, fit=replace(found.chain.fit, weights=(np.ones(30),)))
    heard = Heard()
    print_hand_eye(replace(found, chain=whole), heard)
    assert "left out" not in heard.all
    assert "(images count from 0)" not in chain_page("", "", whole, [])


def test_tables_of_a_page_are_as_wide_as_it_is(found: HandEye) -> None:
    page = chain_page("Camera and arm", "r.json", found.chain, hand_eye_tables(found))
    halves = page.index('<div class="two">')
    assert page.index("<h2>Places</h2>") < page.index("<h2>Arm</h2>") < halves
    assert page.index("<h2>Residuals by image</h2>") > halves
