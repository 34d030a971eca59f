"""A calibrated chain in numbers, tables and words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.chain.result import ChainCalibration
from calib.hand_eye.calibrate import LINKS, PRINT, HandEye
from cell.report.chain_text import (
    hand_eye_json,
    hand_eye_tables,
    kinematic_json,
    kinematic_tables,
    numbers,
    print_hand_eye,
    with_std,
)
from recorded.found_chains import MORE, nao_named, refused
from typed.heard import Heard

LINK_KEYS = {"dh_d_error_m": "d", "dh_a_error_m": "a", "dh_alpha_error_rad": "alpha"}


def by_name(c: ChainCalibration) -> tuple[dict[str, float], dict[str, float]]:
    """Values and standard deviations of the unknowns, SI."""
    sigma = np.sqrt(np.diag(c.covariance))
    return dict(zip(c.names, c.fit.unknowns, strict=True)), dict(zip(c.names, sigma, strict=True))


def test_each_number_of_an_arm_is_in_its_place(found: HandEye) -> None:
    said = hand_eye_json(found, MORE)
    value, sigma = by_name(found.chain)
    for key, what in {"joint_offsets_rad": "offset", **LINK_KEYS}.items():
        names = [f"J{j + 1} {what}" for j in range(6)]
        assert said[key] == [value[name] for name in names]
        assert said["std"][key] == [sigma[name] for name in names]
    for key, T, (m, rad) in (
        ("T_base_camera", found.T_base_camera, found.camera_sigma),
        ("T_gripper_target", found.T_gripper_target, found.target_sigma),
    ):
        assert said[key] == T.tolist()
        assert said["std"][key] == {"position_m": m.tolist(), "rotation_rad": rad.tolist()}
    assert said["held_out_px"] == found.chain.held_out.px
    assert said["held_out_mm"] == pytest.approx(1e3 * found.chain.held_out.metres)
    assert said["next_poses"] == [{"joints_rad": MORE[0].joints.tolist(), "gain": 0.25}]


def test_how_good_a_chain_is_goes_into_the_result(found: HandEye) -> None:
    c = refused(found).chain
    said = hand_eye_json(refused(found))
    assert said["residual_std_px"] == c.residual_std.tolist()
    assert said["corner_sigma_px"] == c.problem.pixel_sigma.tolist()
    assert said["chi2_dof"] == c.fit.chi2_dof
    assert said["held_out"] == {"px": c.held_out.px, "mm": pytest.approx(1e3 * c.held_out.metres)}
    assert (said["images"], said["wrong_images"]) == (30, [[4, 11]])
    trial, of_print = c.trials
    assert said["model"] == [
        {"part": LINKS, "in": True, "cost_rise": trial.rise, "limit": trial.limit},
        {"part": PRINT, "in": False, "cost_rise": of_print.rise, "limit": of_print.limit},
    ]
    assert [(p["parameters"], p["correlation"]) for p in said["correlations"]] == [
        ([a, b], r) for a, b, r in c.correlations
    ]
    assert [(d["parameter"], d["share"]) for d in said["weakest_direction"]] == list(c.weakest)
    assert said["suspects"] == [
        {"name": "target size", "amount": 0.01, "std": 0.002, "sure": True, "cost_drop": 50.0}
    ]
    assert (said["verdict"], said["reasons"]) == ("refused", ["too far off"])
    assert said["remarks"] == ["look at this"]


def close(cell: str, value: float, std: float) -> bool:
    """Whether a number with its deviation says these, to the figures that it has."""
    said, about = map(float, cell.split("+-"))
    return abs(said - value) <= 0.6 * std + 1e-4 and about == pytest.approx(std, rel=0.2, abs=1e-4)


def test_tables_of_an_arm_are_in_mm_and_degrees(found: HandEye) -> None:
    (_, _, places), (_, header, joints) = hand_eye_tables(found)
    for row, T, (m, rad) in (
        (places[0], found.T_base_camera, found.camera_sigma),
        (places[1], found.T_gripper_target, found.target_sigma),
    ):
        assert [float(x) for x in row[1:4]] == pytest.approx(1e3 * T[:3, 3], abs=2e-3)
        assert float(row[4]) == pytest.approx(1e3 * np.linalg.norm(m), rel=0.2, abs=1e-3)
        assert float(row[5]) == pytest.approx(np.degrees(np.linalg.norm(rad)), rel=0.2, abs=1e-4)
    value, sigma = by_name(found.chain)
    deg = np.degrees(1.0)
    columns = {
        "zero deg": ("offset", deg),
        "d mm": ("d", 1e3),
        "a mm": ("a", 1e3),
        "alpha deg": ("alpha", deg),
    }
    assert tuple(header) == ("joint", *columns)
    for j, row in enumerate(joints):
        assert row[0] == f"J{j + 1}"
        for cell, (what, unit) in zip(row[1:], columns.values(), strict=True):
            name = f"J{j + 1} {what}"
            if what == "offset" and j in (0, 5):
                assert cell == "held"
            else:
                assert close(cell, unit * value[name], unit * sigma[name]), (name, cell)


@pytest.mark.parametrize(
    ("value", "std", "said"),
    [
        (12.34567, 0.0123, ("+12.346", "0.012")),
        (-1.0, 0.0345, ("-1.00", "0.03")),
        (0.004, 0.29, ("+0.00", "0.29")),
        (0.004, 0.31, ("+0.0", "0.3")),
        (123.4, 25.0, ("+123", "25")),
        (123.4, 7.0, ("+123", "7")),
        (1.23456, 1.5, ("+1.2", "1.5")),
        (0.5, 0.0, ("+0.5000", "0.0000")),
        (0.5, np.inf, ("+0.5000", "inf")),
    ],
)
def test_a_number_has_the_decimals_that_its_deviation_gives_a_meaning(
    value: float, std: float, said: tuple[str, str]
) -> None:
    assert with_std(value, std) == said


def test_numbers_of_a_nao_are_in_the_units_of_their_names(found: HandEye) -> None:
    c, si = nao_named(found.chain)
    said = kinematic_json(c, si)
    sigma = np.sqrt(np.diag(c.covariance))
    held = [12, 17, *range(36, len(c.names))]
    assert said["held_at_zero"] == [c.names[i] for i in held]
    free = [i for i in range(len(c.names)) if i not in held]
    assert list(said["parameters"]) == [c.names[i] for i in free]
    for i in free:
        found_here = said["parameters"][c.names[i]]
        assert found_here["value"] == pytest.approx(c.fit.unknowns[i] / si[i], rel=1e-12)
        assert found_here["std"] == pytest.approx(sigma[i] / si[i], rel=1e-12)
    assert said["encoder_std_deg"] == pytest.approx([0.01, 0.02, 0.03, 0.0, 0.0, 0.0])
    ((_, _, rows),) = kinematic_tables(c, si)
    for (name, value, std, unit), i in zip(rows, free, strict=True):
        assert close(f"{value}+-{std}", c.fit.unknowns[i] / si[i], sigma[i] / si[i])
        stem, of = ("P2_compliance", "deg/Nm") if i == 2 else (f"P{i}", c.names[i].removeprefix(f"P{i}_"))
        assert (name, unit) == (stem, of)


def test_what_a_person_is_told_of_a_chain(found: HandEye) -> None:
    heard = Heard()
    print_hand_eye(found, heard, MORE)
    c = found.chain
    assert "images:      28 of 30 used" in heard.all
    assert "left out:    4, 11 (images count from 0)" in heard.told
    assert f"chi2/dof {c.fit.chi2_dof:.3f}" in heard.all
    assert "encoders:    0.0300 deg" in heard.all
    assert f"held out:    {c.held_out.px:.3f} px, {1e3 * c.held_out.metres:.3f} mm" in heard.all
    assert "note: look at this" in heard.told
    assert "accepted" in heard.told
    (pose,) = [line for line in heard.told if line.endswith("25 %")]
    assert "error, each together with those before it):" in heard.told[heard.told.index(pose) - 1]
    assert pose.split() == ["10.0", "-20.0", "30.0", "40.0", "-50.0", "60.0", "25", "%"]
    exact = replace(c, problem=replace(c.problem, reading_sigma=np.zeros(6)))
    heard = Heard()
    print_hand_eye(replace(refused(found), chain=replace(exact, reasons=("too far off", "too few"))), heard)
    assert heard.told[-3:] == ["refused:", "  too far off", "  too few"]
    assert "encoders" not in heard.all
    assert "would help" not in heard.all


@pytest.mark.parametrize(("metres", "said"), [(1.0, "1000.000 mm across"), (1.001, "more than 1 m across")])
def test_a_held_out_error_beyond_a_metre_is_no_number(found: HandEye, metres: float, said: str) -> None:
    heard = Heard()
    chain = replace(found.chain, held_out=replace(found.chain.held_out, metres=metres))
    print_hand_eye(replace(found, chain=chain), heard)
    assert said in heard.all


@pytest.mark.parametrize(
    ("images", "said"),
    [
        ([], ""),
        ([[3]], "3"),
        ([[3, 4]], "3, 4"),
        ([[7, 8, 9, 12]], "7 to 9, 12"),
        ([[1, 5], [0, 2, 20]], "0 to 2, 5, 20"),
    ],
)
def test_numbers_of_images_in_words(images: list[list[int]], said: str) -> None:
    assert numbers(images) == said
