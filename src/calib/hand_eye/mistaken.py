"""Which usual mistake in a recording would explain that it cannot be calibrated: the recording without it fits.

A joint of the other sign, points of a mirrored or smaller image, a target in cm: each leaves a recording that fits no
arm, and none shows in a residual that says which. So each mistake is taken back, and the recording that then fits far
better than as it is tells its name. Nothing is calibrated with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import InputError
from arm.se3 import Array, Indices
from calib.chain.per_image_poses import PerImagePoses, fit_per_image_poses
from calib.hand_eye.chain import arm_chain, unknown_names
from calib.recordings.arm import ArmRecording
from calib.robot_world.initial_guess import FEWEST, closed_form, residual_sizes

_MOST = 16  # images that are tried
_FARTHER = 5.0  # times that a recording fits better without a mistake before that is told
_NOISIER = 1.2  # times that its corners may fit worse then
_TURN, _SHIFT = np.radians(2.0), 0.010  # rad and m within which the pairs of poses of any arm agree
_GROSS = 1.0  # px; the worst corners that are found in images fit to 0.3 px
_DIGITS = 1e-3  # deg; fewer than those of a reading
_SIZE = 0.05  # relative; a size nearer to the stated one has a test of its own


@dataclass(frozen=True)
class _Fit:
    """How well a recording fits: rms noise of its corners, px, and medians over pairs of poses, rad and m."""

    noise: float
    turn: float
    shift: float

    @property
    def misfit(self) -> float:
        return self.noise * self.turn * self.shift

    def explains(self, as_is: _Fit) -> bool:
        """Whether a mistake that leaves this fit is far more likely than none."""
        sound = self.turn < _TURN and self.shift < _SHIFT and self.noise < _NOISIER * as_is.noise
        return sound and _FARTHER * self.misfit < as_is.misfit

    def __str__(self) -> str:
        far = f"{1e3 * self.shift:.{2 if self.shift < 0.1 else 0}f} mm"
        return f"{far}, {np.degrees(self.turn):.2f} deg and {self.noise:.2g} px"


def likely_mistake(recording: ArmRecording) -> str:
    """Say of which usual mistake a recording is free if it fits far better without it, and how much; "" if of none."""
    if len(recording.joints) < FEWEST:
        return ""
    some = np.unique(np.linspace(0, len(recording.joints) - 1, _MOST).astype(np.intp))
    images = replace(recording, joints=recording.joints[some], pixels=recording.pixels[some])
    as_is = _Fit(np.inf, np.inf, np.inf)
    found: list[tuple[_Fit, str]] = []
    with np.errstate(all="ignore"):
        alone = _alone(images)
        if alone is not None:
            as_is = _fit(images, images.joints, alone)
            found += [(_fit(images, q, alone), words) for q, words in _joints(recording, some)]
            found += _scaled(images, alone)
        for pixels, words in _pixels(images):
            if (of := _alone(replace(images, pixels=pixels))) is not None:
                found.append((_fit(images, images.joints, of), words))
    told = [(fit, words) for fit, words in found if fit.explains(as_is)]
    if not told and _GROSS < as_is.noise < np.inf:
        return (
            f"each image alone, without the arm, fits the target to {as_is.noise:.2g} px only, and corners that are "
            "found in images fit to 0.3 px: are corners_px in the order of target.points_m, and is camera the one that "
            "took the images?"
        )
    whole = np.degrees(recording.joints)
    if not told and np.abs(whole - np.rint(whole)).max() < _DIGITS:
        return (
            "joints_rad are whole degrees in all poses: are they those that were commanded? What the encoders read "
            "when the image was taken belongs here"
        )
    if not told:
        return ""
    fit, words = min(told, key=lambda pair: pair[0].misfit)
    now = str(as_is) if np.isfinite(as_is.misfit) else "no fit"
    return f"{words}: the images and the arm then agree to {fit}, and to {now} as they are"


def _joints(recording: ArmRecording, some: Indices) -> Iterator[tuple[Array, str]]:
    """Readings as they may be meant, and what is then wrong."""
    q = recording.joints
    yield -q[some], "all of joints_rad rather have the other sign"
    for j in range(q.shape[1]):
        flipped = q[some].copy()
        flipped[:, j] *= -1.0
        yield flipped, f"J{j + 1} in joints_rad rather has the other sign"
    yield q[some, ::-1], "joints_rad are rather in the order from the last joint to the first"
    for j in range(1, q.shape[1]):
        relative = q[some].copy()
        relative[:, j] -= relative[:, j - 1]
        yield relative, f"J{j + 1} in joints_rad rather has the angle of J{j} in it"
    yield np.roll(q, 1, axis=0)[some], "joints_rad of a pose are rather those of the pose after it"
    yield np.roll(q, -1, axis=0)[some], "joints_rad of a pose are rather those of the pose before it"


def _pixels(images: ArmRecording) -> Iterator[tuple[Array, str]]:
    """Image points as they may be meant, and what is then wrong."""
    last = np.array(images.camera.size) - 1.0
    px = images.pixels
    yield (
        px * [-1.0, 1.0] + [last[0], 0.0],
        "corners_px are rather of mirrored images (left and right exchanged)",
    )
    yield px * [1.0, -1.0] + [0.0, last[1]], "corners_px rather count v upwards from the image's lower edge"
    yield last - px, "corners_px are rather of images turned by 180 deg against those of camera.K_px"
    yield px[..., ::-1], "u and v of corners_px are rather exchanged"
    for times in (2.0, 4.0, 0.5, 0.25):
        yield (
            px * times,
            f"corners_px are rather of images {1.0 / times:g} times as large as those of camera.K_px",
        )


def _scaled(images: ArmRecording, alone: PerImagePoses) -> Iterator[tuple[_Fit, str]]:
    """The target at the size that fits the arm best: far off, its lengths are rather in another unit."""
    A, B = _flange(images, images.joints), alone.T_camera_target
    _, Y = closed_form(A, B)
    if not np.isfinite(Y).all():
        return
    # R_A t_X - t_Y - scale R_Y t_B = -t_A, linear in t_X, t_Y and the scale
    n = len(A)
    rows = np.concatenate(
        [A[:, :3, :3], np.tile(-np.eye(3), (n, 1, 1)), -(Y[:3, :3] @ B[:, :3, 3:])], axis=2
    ).reshape(3 * n, 7)
    if not np.isfinite(rows).all():
        return
    scale = float(np.linalg.lstsq(rows, -A[:, :3, 3].reshape(3 * n), rcond=None)[0][6])
    if scale > 0.0 and abs(scale - 1.0) > _SIZE:
        T = B.copy()
        T[:, :3, 3] *= scale
        yield (
            _fit(images, images.joints, replace(alone, T_camera_target=T)),
            f"target.points_m are rather {scale:.2g} times as large (in another unit, or of another target)",
        )


def _flange(images: ArmRecording, joints: Array) -> Array:
    count = len(unknown_names(images.dh.joints))
    return arm_chain(images.dh, np.eye(4), np.eye(4)).evaluate(joints, np.zeros(count)).T


def _alone(images: ArmRecording) -> PerImagePoses | None:
    try:
        return fit_per_image_poses(images.camera, images.points, images.pixels)
    except (InputError, np.linalg.LinAlgError):  # no pose fits these corners
        return None


def _fit(images: ArmRecording, joints: Array, alone: PerImagePoses) -> _Fit:
    """Return how well arm and images agree; infinite where the closed form fails."""
    A, B = _flange(images, joints), alone.T_camera_target
    X, Y = closed_form(A, B)
    if not np.isfinite(X).all() or not np.isfinite(Y).all():
        return _Fit(np.inf, np.inf, np.inf)
    turn, shift = residual_sizes(A, B, X, Y)
    noise = float(np.sqrt((alone.pixel_sigma**2).mean()))
    return _Fit(noise, float(np.median(turn)), float(np.median(shift)))
