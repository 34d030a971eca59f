"""Usual mistakes in recordings of known truths: each is told by its name, and others by none."""

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import CalibrationRefused
from arm.robot.dh import DhTable
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.hand_eye.mistaken import _Fit, likely_mistake
from calib.hand_eye.next_poses import next_poses
from recorded.arm_sets import TARGETS, draw_truth, recorded, wide


@pytest.fixture(scope="module")
def sound():
    rng = np.random.default_rng(4)
    truth = draw_truth(rng)
    return recorded(truth, wide(truth, TARGETS["charuco"], 12, rng), "charuco", rng)


def with_joints(change):
    return lambda r: replace(r, joints=change(r.joints.copy()))


def with_pixels(change):
    return lambda r: replace(r, pixels=change(r.pixels, np.array(r.camera.size) - 1.0))


def third_from_the_horizontal(q):
    q[:, 2] += q[:, 1]
    return q


MISTAKES = {
    "all of joints_rad rather have the other sign": with_joints(lambda q: -q),
    "J5 in joints_rad rather has the other sign": with_joints(lambda q: q * [1, 1, 1, 1, -1, 1]),
    "joints_rad are rather in the order from the last": with_joints(lambda q: q[:, ::-1]),
    "J3 in joints_rad rather has the angle of J2 in it": with_joints(third_from_the_horizontal),
    "joints_rad of a pose are rather those of the pose after it": with_joints(
        lambda q: np.roll(q, -1, axis=0)
    ),
    "joints_rad of a pose are rather those of the pose before it": with_joints(
        lambda q: np.roll(q, 1, axis=0)
    ),
    "corners_px are rather of mirrored images": with_pixels(lambda px, last: px * [-1, 1] + [last[0], 0]),
    "corners_px rather count v upwards": with_pixels(lambda px, last: px * [1, -1] + [0, last[1]]),
    "corners_px are rather of images 0.5 times as large": with_pixels(lambda px, last: px / 2.0),
    "target.points_m are rather 0.01 times as large": lambda r: replace(r, points=100.0 * r.points),
    "joints_rad are whole degrees in all poses": with_joints(lambda q: np.radians(np.rint(np.degrees(q)))),
    "each image alone, without the arm, fits the target to": lambda r: replace(
        r, points=np.roll(r.points, 1, axis=0)
    ),
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_usual_mistake_is_told_by_its_name(sound, words):
    assert likely_mistake(MISTAKES[words](sound)).startswith(words)


def test_no_mistake_is_told_of_sound_recordings_and_of_otherwise_faulty_ones(sound):
    assert likely_mistake(sound) == ""
    half = len(sound.joints) // 2
    slid = np.concatenate([sound.pixels[:half], sound.pixels[half:] + 8.0])
    assert likely_mistake(replace(sound, pixels=slid)) == ""
    assert likely_mistake(replace(sound, points=1.01 * sound.points)) == ""
    assert likely_mistake(replace(sound, joints=sound.joints[:2], pixels=sound.pixels[:2])) == ""


def test_it_is_the_first_reason_of_a_refusal(sound):
    found = calibrate_hand_eye(MISTAKES["J3 in joints_rad rather has the angle of J2 in it"](sound))
    assert found.chain.reasons[0].startswith(
        "J3 in joints_rad rather has the angle of J2 in it: the images and the arm"
    )
    reversed_joints = MISTAKES["joints_rad are rather in the order from the last"](sound)
    with pytest.raises(
        CalibrationRefused, match=r"rather in the order from the last.*as it is: no .* pairs"
    ) as refused:
        calibrate_hand_eye(reversed_joints)
    assert refused.value.data["reason"] == "no_consensus"


def test_another_arm_is_refused_with_its_cause_and_without_poses_that_would_help(sound):
    """The dh of a UR3e: only an image or two are left, and nothing can be tested or planned with them."""
    dh = sound.dh
    other = DhTable(np.array([0.1519, 0, 0, 0.1124, 0.0854, 0.0819]), dh.a, -dh.alpha, dh.theta_offset)
    try:
        found = calibrate_hand_eye(replace(sound, dh=other))
    except CalibrationRefused:
        return
    assert not found.chain.accepted
    assert all(0.0 <= pose.gain <= 1.0 for pose in next_poses(found))


@pytest.mark.parametrize(
    ("free", "explains"),
    [
        (_Fit(0.1, 0.001, 0.0002), True),
        (_Fit(0.1, 0.05, 0.0002), False),  # a turn that no arm has
        (_Fit(0.1, 0.001, 0.02), False),  # a shift that no arm has
        (_Fit(0.13, 0.001, 0.0002), False),  # the corners fit worse
        (_Fit(0.1, 0.02, 0.009), False),  # better, but not five times
    ],
)
def test_a_mistake_explains_a_recording_only_if_it_fits_far_better_without(
    free: _Fit, explains: bool
) -> None:
    assert bool(free.explains(_Fit(0.1, 0.03, 0.02))) == explains
