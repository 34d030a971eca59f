"""Verdict on a chain calibration: whether it is good enough, and if not, why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from arm.former import former_names
from calib.chain.result import ChainCalibration
from calib.chain.score_tests import ChainErrorHypothesis

HIGH = 0.95  # correlations to report
_HINT = 2.0  # standard deviations from which a wrong target size is mentioned


def with_verdict(c: ChainCalibration, shown: Callable[[str, float], str]) -> ChainCalibration:
    """Return the calibration with its verdict; each reason gives value, limit and remedy.

    Args:
        c: a calibration.
        shown: formats an unknown with its unit, from its name and its value in SI.
    """
    reasons = tuple(_too_few_images(c)) or (
        *_too_many_wrong(c),
        *_changed(c),
        *_complete(c),
        *_compensated(c),
        *_accuracy(c),
        *_undetermined(c, shown),
    )
    c = replace(c, reasons=reasons)
    return replace(c, remarks=tuple(_remarks(c)))


def _too_few_images(c: ChainCalibration) -> list[str]:
    used = c.images - sum(map(len, c.wrong))
    if used >= c.limits.images:
        return []
    return [f"{used} images are usable, at least {c.limits.images} are needed"]


def _too_many_wrong(c: ChainCalibration) -> list[str]:
    wrong = sum(map(len, c.wrong))
    if wrong <= c.limits.wrong * c.images:
        return []
    return [
        f"{wrong} of {c.images} images do not fit the others, at most {100 * c.limits.wrong:.0f} % may: do all show "
        "the same target, camera and arm, and were joints and images taken at the same time?"
    ]


def _changed(c: ChainCalibration) -> list[str]:
    if c.change is None:
        return []
    cause = next((f": most likely {describe(s)}" for s in c.hypotheses if s.sure and "moved" in s.name), "")
    return [f"images from number {c.change} on do not fit the earlier ones{cause}"]


def _compensated(c: ChainCalibration) -> list[str]:
    """A model error that other unknowns compensate for, and that shifts predicted targets."""
    if c.fit.chi2_dof > c.chi2_limit or c.change is not None:
        return []  # reported already
    cause = next((s for s in c.hypotheses if s.sure), None)
    if cause is None or not cause.moves > c.limits.held_out:
        return []
    return [
        f"predicted targets are off by {1e3 * cause.moves:.2f} mm, the limit is "
        f"{1e3 * c.limits.held_out:g} mm, because of {describe(cause)}"
    ]


def _complete(c: ChainCalibration) -> list[str]:
    if c.fit.chi2_dof <= c.chi2_limit:
        return []
    times = np.sqrt(c.fit.chi2_dof)
    cause = next((describe(s) for s in c.hypotheses if s.sure), "")
    return [
        f"residuals are {times:.2f} times those expected from corner and encoder noise (chi2/dof "
        f"{c.fit.chi2_dof:.2f}, the limit is {c.chi2_limit:.2f}): something moves that is not in the model"
        + (f"; most likely {cause}" if cause else "")
    ]


def _accuracy(c: ChainCalibration) -> list[str]:
    if c.held_out.metres <= c.limits.held_out:
        return []
    off = "more than a metre" if c.held_out.metres > 1.0 else f"{1e3 * c.held_out.metres:.2f} mm"
    return [
        f"predictions of held-out targets are off by {off}, the limit is "
        f"{1e3 * c.limits.held_out:g} mm: take more images in more varied postures"
    ]


def _undetermined(c: ChainCalibration, shown: Callable[[str, float], str]) -> list[str]:
    sigma = np.sqrt(np.diag(c.covariance))
    free = np.flatnonzero(c.problem.free & np.isinf(c.problem.prior_sigma))
    undetermined = [int(i) for i in free if not sigma[i] < c.limits.undetermined[int(c.lengths[i])]]
    if not undetermined:
        return []
    worst = max(undetermined, key=lambda i: sigma[i] / c.limits.undetermined[int(c.lengths[i])])
    return [
        f"{len(undetermined)} unknowns are not determined by these images, the worst is {c.names[worst]} "
        f"(+- {shown(c.names[worst], float(sigma[worst]))}): take images with other joint angles"
    ]


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
        case _:
            return f"the {hypothesis.name}: off by {100 * amount:+.3f} +- {100 * sigma:.3f} %"


def _remarks(c: ChainCalibration) -> list[str]:
    remarks = [
        f"{trial.part}: {'in the model' if trial.needed else 'left out'}, without them the cost rises by "
        f"{trial.rise:.1f} (chance: up to {trial.limit:.1f})"
        for trial in c.trials
    ]
    wrong = sum(map(len, c.wrong))
    if wrong:
        remarks.append(f"{wrong} of {c.images} images do not fit the others and were rejected")
    remarks += [
        f"{a} and {b} are hardly separable (correlation {r:+.3f})"
        for a, b, r in c.correlations
        if abs(r) > HIGH
    ][:5]
    if c.weakest:
        together = ", ".join(f"{name} ({share:+.2f})" for name, share in c.weakest)
        remarks.append(f"weakest direction: {together}")
    if c.excess > max(c.excess_limit, 1.0):
        remarks.append(
            f"images agree {np.sqrt(c.excess):.1f} times less well with each other than corners and encoders explain, "
            "perhaps because the arm does not repeat well; all uncertainties are scaled by this"
        )
    if not c.reasons and c.fit.chi2_dof <= c.chi2_limit:
        remarks += [f"worth a look: {describe(s)}" for s in c.hypotheses if s.sure or _would_matter(c, s)][:1]
    return remarks


def _would_matter(c: ChainCalibration, s: ChainErrorHypothesis) -> bool:
    """Whether it is a wrong target size compensated by link errors: it would matter but is hardly significant."""
    return s.name == "target size" and abs(s.amount) > _HINT * s.sigma and s.moves > c.limits.held_out


former_names(__name__, __name__, judged="with_verdict")
