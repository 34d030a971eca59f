"""Verdict on a chain calibration: whether it is good enough, and if not, why.

The reprojection errors are judged by their chi-square per degree of freedom and by cross-validation; for hand-eye
calibration `calib.hand_eye.verdict` adds what the errors are worth at the tool.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from arm.former import former_names
from calib.chain.result import ChainCalibration
from calib.chain.score_tests import ChainErrorHypothesis

HIGH = 0.95  # correlations to report
_UNKNOWN_CAUSE = (
    "no single known cause explains it: record one posture several times, reached from different sides; if those "
    "images differ, there is play or the target is loose, and if they agree, the model of the arm is wrong"
)
_ALL_SAME = "do all show the same target, camera and arm, and were joints and images taken at the same time?"
LEAST_NOISE_PX = 1e-3  # of corners in images; the simulated camera has three times as much
_HINT = 2.0  # standard deviations from which a wrong target size is mentioned


def with_verdict(c: ChainCalibration, shown: Callable[[str, float], str]) -> ChainCalibration:
    """Return the calibration with its verdict; each reason gives value, limit and remedy.

    Args:
        c: a calibration.
        shown: formats an unknown with its unit, from its name and its value in SI.
    """
    c = replace(c, reasons=tuple(_reasons(c, shown)))
    return replace(c, remarks=tuple(_remarks(c)))


def _reasons(c: ChainCalibration, shown: Callable[[str, float], str]) -> Iterator[str]:
    wrong = sum(map(len, c.wrong))
    if c.images - wrong < c.limits.images:
        cause = f": {wrong} of {c.images} do not fit the others; {_ALL_SAME}" if wrong else ""
        yield f"{c.images - wrong} images are usable, at least {c.limits.images} are needed{cause}"
        return
    if wrong > c.limits.wrong * c.images:
        yield (
            f"{wrong} of {c.images} images do not fit the others, at most {100 * c.limits.wrong:.0f} % may: {_ALL_SAME}"
        )
    present = [s for s in c.hypotheses if s.sure]
    if c.change is not None:
        cause = next((f": most likely {describe(s)}" for s in present if "moved" in s.name), "")
        yield f"images from number {c.change} on do not fit the earlier ones{cause}"
    if c.fit.chi2_dof > c.chi2_limit:
        cause = f"; most likely {describe(present[0])}" if present else f"; {_UNKNOWN_CAUSE}"
        yield (
            f"residuals are {np.sqrt(c.fit.chi2_dof):.2f} times those expected from corner and encoder noise (chi2/dof "
            f"{c.fit.chi2_dof:.2f}, the limit is {c.chi2_limit:.2f}): something moves that is not in the model{cause}"
        )
    elif c.change is None and present and present[0].moves > c.limits.held_out:
        # other unknowns compensate for this model error in the images, but not in predictions
        yield (
            f"predicted targets are off by {1e3 * present[0].moves:.2f} mm, the limit is "
            f"{1e3 * c.limits.held_out:g} mm, because of {describe(present[0])}"
        )
    if not c.held_out.metres <= c.limits.held_out:
        off = "more than a metre" if c.held_out.metres > 1.0 else f"{1e3 * c.held_out.metres:.2f} mm"
        yield (
            f"predictions of held-out targets are off by {off}, the limit is {1e3 * c.limits.held_out:g} mm: take "
            "more images in more varied postures"
        )
    sigma = np.sqrt(np.diag(c.covariance))
    limit = np.where(c.lengths, c.limits.undetermined[1], c.limits.undetermined[0])
    undetermined = c.problem.free & np.isinf(c.problem.prior_sigma) & ~(sigma < limit)
    if undetermined.any():
        worst = int(np.argmax(np.where(undetermined, sigma / limit, -np.inf)))
        yield (
            f"{undetermined.sum()} unknowns are not determined by these images, the worst is {c.names[worst]} "
            f"(+- {shown(c.names[worst], float(sigma[worst]))}): take images with other joint angles"
        )


def describe(hypothesis: ChainErrorHypothesis) -> str:
    """Describe a model error in words, with its amount."""
    amount, sigma = hypothesis.amount, hypothesis.sigma
    match hypothesis.name:
        case "target size":
            return (
                f"the target's size: the one in the images is {100 * abs(amount):.2f} +- {100 * sigma:.2f} % "
                f"{'larger' if amount > 0.0 else 'smaller'} than in the file; measure it"
            )
        case "focal length":
            return f"the intrinsics: focal length off by {100 * amount:+.2f} +- {100 * sigma:.2f} %; calibrate it"
        case "time skew":
            return (
                f"the timing: joints are read {100 * amount:.1f} +- {100 * sigma:.1f} % of the motion before or after "
                "the image; wait until the arm has settled"
            )
        case "target moved" | "camera moved":
            return (
                f"a movement of the {hypothesis.name.split()[0]} by about {1e3 * amount:.2f} mm before image "
                f"{hypothesis.image}; fix it, and take the images again"
            )
        case limb if limb.startswith("limb "):
            longer = "longer" if amount > 0.0 else "shorter"
            return f"a length: {limb} is {1e3 * abs(amount):.2f} +- {1e3 * sigma:.2f} mm {longer} than the model's"
        case _:
            return (
                f"the {hypothesis.name}: off by {100 * amount:+.3f} +- {100 * sigma:.3f} %; compare its gear ratio and "
                "counts per turn with the unit file's"
            )


def _remarks(c: ChainCalibration) -> Iterator[str]:
    if (noise := float(np.max(c.problem.pixel_sigma))) < LEAST_NOISE_PX:
        yield (
            f"the corners of an image fit each other to {noise:.1g} px, and those that are found in images to 0.01 px "
            "at best: were these corners computed?"
        )
    for trial in c.trials:
        yield (
            f"{trial.part}: {'in the model' if trial.needed else 'left out'}, without them the cost rises by "
            f"{trial.rise:.1f} (chance: up to {trial.limit:.1f})"
            f"{f', if the {trial.instead} is not as given' if trial.instead else ''}"
        )
    wrong = sum(map(len, c.wrong))
    if wrong:
        yield f"{wrong} of {c.images} images do not fit the others and were rejected"
    for a, b, r in [pair for pair in c.correlations if abs(pair[2]) > HIGH][:5]:
        yield f"{a} and {b} are hardly separable (correlation {r:+.3f})"
    if c.weakest:
        yield f"weakest direction: {', '.join(f'{name} ({share:+.2f})' for name, share in c.weakest)}"
    if c.excess > max(c.excess_limit, 1.0):
        yield (
            f"images agree {np.sqrt(c.excess):.1f} times less well with each other than corners and encoders explain, "
            "perhaps because the arm does not repeat well; all uncertainties are scaled by this"
        )
    if not c.reasons and c.fit.chi2_dof <= c.chi2_limit:
        for hypothesis in [s for s in c.hypotheses if s.sure or _would_matter(c, s)][:1]:
            yield f"worth a look: {describe(hypothesis)}"


def _would_matter(c: ChainCalibration, s: ChainErrorHypothesis) -> bool:
    """Whether link errors may compensate for a wrong target size: then it is hardly significant, but it matters."""
    return s.name == "target size" and abs(s.amount) > _HINT * s.sigma and s.moves > c.limits.held_out


former_names(__name__, __name__, judged="with_verdict")
