"""Verdict on a hand-eye calibration: what the chain alone does not tell, above all the tool's error in the holes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from arm.calibration_file import LARGEST_LINK, LARGEST_ZERO
from arm.se3 import Array
from calib.chain.flipped_targets import flipped_targets
from calib.chain.result import ChainLimits
from calib.chain.score_tests import SURE
from calib.chain.verdict import describe
from calib.hand_eye.result import HandEye, ToolError
from calib.hand_eye.tool_error import TOOL, tool_error
from calib.model.chi_square import chi2_limit
from calib.model.intrinsics import NAMES

_CURES = {
    "links": "the lengths of the arm's links, which no image separates from the target's mount: touch a point of known "
    "place with the tool, or record again with the target mounted otherwise",
    "lens": "the lens: calibrate the camera with more views at the distances of the boards",
    "print": "the target's size: measure the print, and give size_within_percent in its file",
    "scatter": "the arm's own scatter, which no calibration cures: look for play in its joints",
}
HEALTHY_GEAR = np.radians(0.1)
"""rad; more than a sagging or eccentric joint errs over half of the recorded range."""
_TELLING = 3.0  # standard deviations of the scatter at the tool from which a movement is refused
_USUAL_CURE = "too little information: take more images in more varied postures"


@dataclass(frozen=True)
class HandEyeLimits(ChainLimits):
    """Limits for accepting a hand-eye calibration; see `ChainLimits`.

    Attributes:
        sideways, height: largest standard deviation of the tool in the holes, m.
    """

    sideways: float = 1.0e-3
    height: float = 1.5e-3


@dataclass(frozen=True, eq=False)
class WorkPlace:
    """Where the tool is to be right.

    Attributes:
        holes: (n, 3) m in the base frame; None: places that the camera sees, see `calib.hand_eye.tool_error`.
        T_flange_tool: 4x4.
    """

    holes: Array | None = None
    T_flange_tool: Array = field(default_factory=lambda: TOOL)


def with_hand_eye_verdict(found: HandEye, limits: ChainLimits, place: WorkPlace) -> HandEye:
    """Return the calibration with the tool's error, and with all reasons and remarks."""
    c = found.chain
    at_tool = limits if isinstance(limits, HandEyeLimits) else HandEyeLimits()
    tool = tool_error(found, place.holes, place.T_flange_tool)
    found = replace(found, tool=tool)
    reasons = [*c.reasons, *_implausible(found)]
    if c.images - sum(map(len, c.wrong)) >= limits.images:
        reasons += [*_beyond_priors(found), *_beyond_scatter(found), *_at_the_tool(tool, at_tool)]
    remarks = (*_scatter(found), *c.remarks, *_flipped(found))
    return replace(found, chain=replace(c, reasons=tuple(reasons), remarks=remarks))


def _at_the_tool(tool: ToolError, limits: HandEyeLimits) -> Iterator[str]:
    for direction, value, most, key in (
        ("sideways", tool.sideways, limits.sideways, "tool.least_certain_mm"),
        ("in height", tool.height, limits.height, "tool.least_certain_height_mm"),
    ):
        if value > most:
            cause = max(tool.parts, key=lambda name: tool.parts[name])
            cure = _CURES[cause] if tool.parts[cause] > 0.5 else _USUAL_CURE
            yield (
                f"the tool would miss holes by {1e3 * value:.2f} mm {direction} (one standard deviation, at the worst "
                f"of {tool.holes} places), the limit is {1e3 * most:g} mm ({key} of the cell file); most of it is "
                f"{cure}"
            )


def _beyond_priors(found: HandEye) -> Iterator[str]:
    """Refuse a lens or a print that differs from what was given by more than its tolerance."""
    c = found.chain
    k = found.lens_factor.shape[1]
    lens = c.fit.unknowns[len(c.names) - k - 2 : len(c.names) - 2]
    if k and float(lens @ lens) > chi2_limit(SURE, k):
        change = found.lens_factor @ lens
        sigma = np.linalg.norm(found.lens_factor, axis=1)
        worst = int(np.argmax(np.abs(change) / np.where(sigma > 0.0, sigma, np.inf)))
        yield (
            f"the lens in the images is not that of the camera file: {NAMES[worst]} differs by "
            f"{abs(change[worst]) / sigma[worst]:.1f} of its standard deviations; calibrate the camera again"
        )
    size = next((s for s in c.hypotheses if s.name == "target size" and s.sure), None)
    if size is not None and not c.considered and not any(describe(size) in reason for reason in c.reasons):
        tolerance = 100.0 * found.recording.size_within
        yield f"{describe(size)} (size_within_percent is {tolerance:g})"


def _beyond_scatter(found: HandEye) -> Iterator[str]:
    """Refuse faults of an arm that scatters: its residuals are no larger than its scatter, so they show nothing.

    A movement within the scatter does no more harm than the scatter, and a few images may show one by chance.
    """
    c = found.chain
    far = min(_TELLING * found.tool.scatter, 0.5 * c.limits.held_out) if found.tool.holes else 0.0
    if c.scattering is None:
        return
    for s in c.hypotheses:
        if not s.sure or any(describe(s) in reason for reason in c.reasons):
            continue
        joint = int(s.name.removeprefix("scale of J")) - 1 if s.name.startswith("scale of J") else None
        turned = (
            0.0 if joint is None else abs(s.amount) * float(np.ptp(found.recording.joints[:, joint])) / 2.0
        )
        moved = s.name in ("target moved", "camera moved") and s.amount > far
        if moved or s.name == "time skew" or turned > HEALTHY_GEAR:
            yield f"more is wrong than the arm's scatter: {describe(s)}"
            return


def _scatter(found: HandEye) -> Iterator[str]:
    if found.chain.scattering is None:
        return
    each = ", ".join(f"{v:.3f}" for v in np.degrees(found.joint_scatter))
    at_tool = f"{1e3 * found.tool.scatter:.2f} mm at the tool" if found.tool.holes else "at the tool unknown"
    yield (
        f"the arm scatters by {np.degrees(np.sqrt(np.mean(found.joint_scatter**2))):.3f} deg (J1 to J"
        f"{len(found.joint_scatter)}: {each}), {at_tool}; all standard deviations include it"
    )


def _flipped(found: HandEye) -> Iterator[str]:
    for turn, images in flipped_targets(found.chain).items():
        yield (
            f"{len(images)} of the rejected images show the target rotated by {turn} deg (a flipped marker): "
            f"{', '.join(map(str, images[:8]))}{', ...' if len(images) > 8 else ''}"
        )


def _implausible(found: HandEye) -> Iterator[str]:
    """Refuse errors that are too large for a calibration file: it is another arm, or one that was homed wrongly."""
    d, a, alpha = found.link_errors
    length, angle = LARGEST_LINK
    checked = (
        ("zero", found.joint_offsets, LARGEST_ZERO, np.degrees(1.0), "deg"),
        ("d", d, length, 1e3, "mm"),
        ("a", a, length, 1e3, "mm"),
        ("alpha", alpha, angle, np.degrees(1.0), "deg"),
    )
    beyond = [
        (
            float(abs(values[j]) / most),
            f"{what} of J{j + 1} is off by {unit * values[j]:.3g} {symbol}, at most {unit * most:.3g} is plausible",
        )
        for what, values, most, unit, symbol in checked
        for j in np.flatnonzero(np.abs(values) > most)
    ]
    if beyond:
        others = f", and {len(beyond) - 1} more such parameters" if len(beyond) > 1 else ""
        yield (
            f"{max(beyond)[1]}{others}: home the arm again; does the recording's dh describe this arm, and are dh and "
            "target in m and rad?"
        )
