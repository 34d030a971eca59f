"""Eye-to-hand calibration of recordings that were drawn from known truths."""

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import CalibrationRefused
from arm.se3 import angle_between, frozen
from calib.hand_eye.calibrate import GAUGES, LINKS, PRINT, calibrate_hand_eye
from calib.hand_eye.chain import OFFSETS
from calib.hand_eye.image_effects import SIZE
from recorded.arm_sets import TARGETS, draw_truth, recipe, recorded, spoilt, wide


def drawn(seed, count=30, kind="charuco", sampler=wide, **of_truth):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, **of_truth)
    return recorded(truth, sampler(truth, TARGETS[kind], count, rng), kind, rng), truth, rng


def off(found, truth):
    """m and rad."""
    T, true = found.T_base_camera, truth.T_base_camera
    return np.linalg.norm(T[:3, 3] - true[:3, 3]), angle_between(T[:3, :3], true[:3, :3])


def prediction(found, truth, joints):
    T = replace(found.chain.problem.sightings[0], readings=joints).evaluate(found.chain.fit.unknowns).T
    return np.sqrt(np.mean(np.sum((T - truth.T_camera_target(joints))[:, :3, 3] ** 2, axis=1)))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("kind", "mount", "sampler", "limit"),
    [
        ("charuco", "perpendicular", wide, 0.25e-3),
        ("marker", "parallel", wide, 0.6e-3),
        pytest.param("charuco", "parallel", recipe, 0.6e-3, marks=pytest.mark.slow),
    ],
)
def test_place_mount_and_zeros_are_found_as_surely_as_is_said(kind, mount, sampler, limit):
    recording, truth, _ = drawn(1, 30, kind, sampler, mount=mount)
    found = calibrate_hand_eye(recording)
    assert found.chain.accepted, found.chain.reasons
    shift, turn = found.camera_sigma
    mm, rad = off(found, truth)
    assert mm < limit
    assert mm < 3.5 * np.linalg.norm(shift)
    assert rad < 3.5 * np.linalg.norm(turn)
    assert np.linalg.norm(shift) < limit
    sigma = np.sqrt(np.diag(found.chain.covariance))[OFFSETS + 1 : OFFSETS + 5]
    assert (np.abs(found.joint_offsets - truth.offsets)[1:5] < 4.0 * sigma).all()
    held = np.abs(found.T_gripper_target[:3, 3] - truth.T_gripper_target[:3, 3])
    assert (held < 4.0 * found.target_sigma[0]).all()
    assert found.joint_offsets[[0, 5]].tolist() == [0.0, 0.0]
    assert len(GAUGES) == 2


@pytest.mark.slow
def test_errors_are_honest_over_seeds():
    total, count = 0.0, 0
    for seed in range(10):
        recording, truth, _ = drawn([seed, 2], 10)
        found = calibrate_hand_eye(recording)
        x = (found.joint_offsets - truth.offsets)[1:5]
        C = found.chain.covariance[OFFSETS + 1 : OFFSETS + 5, OFFSETS + 1 : OFFSETS + 5]
        total, count = total + x @ np.linalg.solve(C, x), count + 4
    assert 0.45 < total / count < 1.75  # chi square of 40: all but 1 in 300


@pytest.mark.slow
def test_errors_of_links_are_taken_in_when_the_images_show_them_and_only_then():
    plain, _, _ = drawn(3, 30)
    trial = calibrate_hand_eye(plain).chain.trials[0]
    assert trial.part == LINKS
    assert not trial.needed
    recording, truth, rng = drawn(3, 40, links=True)
    found = calibrate_hand_eye(recording)
    assert found.chain.trials[0].needed
    assert found.chain.accepted, found.chain.reasons
    fresh = wide(truth, recording.points, 60, rng)
    assert prediction(found, truth, fresh) < 0.12e-3
    assert np.abs(found.link_errors[0]).max() > 0.05e-3
    assert any("J" in a and "target" in b for a, b, _ in found.chain.correlations), "gauges are told"


@pytest.mark.slow
@pytest.mark.parametrize(
    "way", ["shifted", *(pytest.param(w, marks=pytest.mark.slow) for w in ("other", "turned"))]
)
def test_a_third_of_the_images_may_be_wrong(way):
    recording, _, rng = drawn(4, 36, "marker")
    clean = calibrate_hand_eye(recording)
    spoilt_one, wrong = spoilt(recording, 0.33, way, rng)
    found = calibrate_hand_eye(spoilt_one)
    assert found.chain.wrong[0].tolist() == wrong.tolist()
    assert found.chain.accepted, found.chain.reasons
    kept = np.setdiff1d(np.arange(36), wrong)
    alone = calibrate_hand_eye(
        replace(recording, joints=frozen(recording.joints[kept]), pixels=frozen(recording.pixels[kept]))
    )
    shift = np.linalg.norm(found.T_base_camera[:3, 3] - alone.T_base_camera[:3, 3])
    assert shift < 0.05 * np.linalg.norm(alone.camera_sigma[0]), "as if the wrong ones had never been taken"
    assert np.linalg.norm(found.camera_sigma[0]) > np.linalg.norm(clean.camera_sigma[0])


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(s, marks=pytest.mark.slow) for s in (2, 3, 4))])
def test_eight_markers_are_neither_refused_nor_left_out_by_chance(seed):
    recording, _, _ = drawn([seed, 8], 8, "marker")
    found = calibrate_hand_eye(recording)
    assert found.chain.accepted, found.chain.reasons
    assert not len(found.chain.wrong[0])


@pytest.mark.slow
def test_encoders_with_steps_are_weighed():
    recording, truth, _ = drawn(6, 40)
    step = np.radians(0.1)
    coarse = replace(recording, joints=frozen(np.rint(recording.joints / step) * step))
    found = calibrate_hand_eye(coarse)
    assert found.chain.problem.reading_sigma == pytest.approx([step / np.sqrt(12.0)] * 6, rel=1e-6)
    assert found.chain.accepted, found.chain.reasons
    assert off(found, truth)[0] < 4.0 * np.linalg.norm(found.camera_sigma[0])
    blind = calibrate_hand_eye(coarse, encoder_step=0.0)  # steps that are not known are scatter of their size
    assert blind.joint_scatter == pytest.approx([step / np.sqrt(12.0)] * 6, rel=0.4)
    assert blind.chain.accepted, blind.chain.reasons
    assert off(blind, truth)[0] < 4.0 * np.linalg.norm(blind.camera_sigma[0])
    assert np.linalg.norm(blind.camera_sigma[0]) == pytest.approx(
        np.linalg.norm(found.camera_sigma[0]), rel=0.2
    )


def test_what_determines_nothing_is_refused():
    recording, _, _ = drawn(7, 12)
    two = replace(recording, joints=frozen(recording.joints[:2]), pixels=frozen(recording.pixels[:2]))
    with pytest.raises(CalibrationRefused, match="at least 3"):
        calibrate_hand_eye(two)
    rng = np.random.default_rng(8)
    truth = draw_truth(rng)
    one_axis = np.tile(recording.joints[:1], (12, 1))
    one_axis[:, 0] += np.linspace(-0.1, 0.1, 12)
    turned = recorded(truth, one_axis, "charuco", rng)
    try:
        reasons = " ".join(calibrate_hand_eye(turned).chain.reasons)
    except CalibrationRefused as error:
        reasons = str(error)
    assert reasons, "turned about one axis only, nothing is known along it"


@pytest.mark.slow
def test_the_same_recording_gives_the_same_bytes():
    recording, _, _ = drawn(9, 14)
    one, other = calibrate_hand_eye(recording), calibrate_hand_eye(recording)
    assert one.T_base_camera.tobytes() == other.T_base_camera.tobytes()
    assert one.chain.remarks == other.chain.remarks


def test_an_arm_that_no_cell_would_take_is_refused():
    rng = np.random.default_rng(4)
    truth = draw_truth(rng)
    homed_wrongly = np.array(truth.offsets)
    homed_wrongly[1] = np.radians(6.0)
    truth = replace(truth, offsets=homed_wrongly)
    found = calibrate_hand_eye(recorded(truth, wide(truth, TARGETS["charuco"], 30, rng), "charuco", rng))
    assert np.degrees(found.joint_offsets[1]) == pytest.approx(6.0, abs=0.05)
    (reason,) = found.chain.reasons
    assert "zero of J2 is off by 6 deg, at most 5 is plausible" in reason


@pytest.mark.slow
def test_small_errors_of_links_are_not_taken_for_scatter():
    """Scatter needs fewer unknowns, but the images do not fit without it; with the links they do."""
    rng = np.random.default_rng(1)
    truth = draw_truth(rng, links=True)
    truth = replace(truth, d=0.4 * truth.d, a=0.4 * truth.a, alpha=0.4 * truth.alpha)
    found = calibrate_hand_eye(recorded(truth, wide(truth, TARGETS["marker"], 24, rng), "marker", rng))
    assert LINKS in [trial.part for trial in found.chain.trials if trial.needed]
    assert found.chain.scattering is None


@pytest.mark.slow
def test_a_camera_that_sways_a_little_is_not_taken_for_wrong_links():
    """Links, with 18 unknowns, could take in what sways by 0.04 px, and with it a print that is 0.2 % small."""
    rng = np.random.default_rng(0)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], 24, rng)
    small = truth.pixels(joints, 0.998 * TARGETS["charuco"])
    sway = 0.05 * rng.standard_normal((24, 1, 2))
    pixels = small + sway + 0.13 * rng.standard_normal(small.shape)
    found = calibrate_hand_eye(replace(recorded(truth, joints, "charuco", rng), pixels=frozen(pixels)))
    assert [trial.part for trial in found.chain.trials if trial.needed] == [PRINT]
    size = found.chain.names.index(SIZE)
    assert 0.001 * found.chain.fit.unknowns[size] == pytest.approx(-0.002, abs=2e-4)
    assert off(found, truth)[0] < 4.0 * np.linalg.norm(found.camera_sigma[0])
