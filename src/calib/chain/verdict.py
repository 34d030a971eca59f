"""Is the calibration of a chain good enough, and if not, why?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib.chain.result import ChainCalibration
from calib.chain.score_tests import ChainSuspect

HIGH = 0.95  # correlations that a person should know of
_HINT = 2.0  # standard deviations from which a size is asked about that would matter


def judged(c: ChainCalibration, shown: Callable[[str, float], str]) -> ChainCalibration:
    """The calibration with its verdict: each reason with its figure, limit and what would help.

    Args:
        c: a calibration.
        shown: a value of an unknown in words, with its unit, from its name and its value in SI.
    """
    reasons = tuple(_number(c)) or (
        *_wrong(c),
        *_changed(c),
        *_complete(c),
        *_caused(c),
        *_accuracy(c),
        *_determined(c, shown),
    )
    c = replace(c, reasons=reasons)
    return replace(c, remarks=tuple(_remarks(c)))


def _number(c: ChainCalibration) -> list[str]:
    used = c.images - sum(map(len, c.wrong))
    if used >= c.limits.images:
        return []
    return [f"{used} images can be used, at least {c.limits.images} are needed"]


def _wrong(c: ChainCalibration) -> list[str]:
    wrong = sum(map(len, c.wrong))
    if wrong <= c.limits.wrong * c.images:
        return []
    return [
        f"{wrong} of {c.images} images do not fit the others, at most {100 * c.limits.wrong:.0f} % may: are all of "
        "one target, one camera and one arm, and are joints and images of one time?"
    ]


def _changed(c: ChainCalibration) -> list[str]:
    if c.change is None:
        return []
    cause = next((f": most likely {describe(s)}" for s in c.suspects if s.sure and "moved" in s.name), "")
    return [f"images from number {c.change} on do not fit those before them{cause}"]


def _caused(c: ChainCalibration) -> list[str]:
    """A cause that the model makes up for, and that puts targets elsewhere than they are."""
    if c.fit.chi2_dof > c.chi2_limit or c.change is not None:
        return []  # told already
    cause = next((s for s in c.suspects if s.sure), None)
    if cause is None or not cause.moves > c.limits.held_out:
        return []
    return [
        f"targets are {1e3 * cause.moves:.2f} mm from where they are predicted, the limit is "
        f"{1e3 * c.limits.held_out:g} mm, because of {describe(cause)}"
    ]


def _complete(c: ChainCalibration) -> list[str]:
    if c.fit.chi2_dof <= c.chi2_limit:
        return []
    times = np.sqrt(c.fit.chi2_dof)
    cause = next((describe(s) for s in c.suspects if s.sure), "")
    return [
        f"residuals are {times:.2f} times what the noise of corners and encoders makes (chi2/dof "
        f"{c.fit.chi2_dof:.2f}, the limit is {c.chi2_limit:.2f}): something moves that the model does not know"
        + (f"; most likely {cause}" if cause else "")
    ]


def _accuracy(c: ChainCalibration) -> list[str]:
    if c.held_out.metres <= c.limits.held_out:
        return []
    off = "more than a metre" if c.held_out.metres > 1.0 else f"{1e3 * c.held_out.metres:.2f} mm"
    return [
        f"targets that were held out are {off} from where they are predicted, the limit is "
        f"{1e3 * c.limits.held_out:g} mm: more images, in more different postures, would help"
    ]


def _determined(c: ChainCalibration, shown: Callable[[str, float], str]) -> list[str]:
    sigma = np.sqrt(np.diag(c.covariance))
    free = np.flatnonzero(c.problem.free & np.isinf(c.problem.prior_sigma))
    lost = [int(i) for i in free if not sigma[i] < c.limits.undetermined[int(c.lengths[i])]]
    if not lost:
        return []
    worst = max(lost, key=lambda i: sigma[i] / c.limits.undetermined[int(c.lengths[i])])
    return [
        f"{len(lost)} unknowns are not determined by these images, least of all {c.names[worst]} "
        f"(+- {shown(c.names[worst], float(sigma[worst]))}): take images in which the joints are turned otherwise"
    ]


def describe(suspect: ChainSuspect) -> str:
    """A cause in words, with its figure."""
    amount, sigma = suspect.amount, suspect.sigma
    match suspect.name:
        case "target size":
            return (
                f"the target's size: the one that was seen is {100 * abs(amount):.2f} +- {100 * sigma:.2f} % "
                f"{'larger' if amount > 0.0 else 'smaller'} than the file says; measure it"
            )
        case "focal length":
            return f"the lens: its focal length is off by {100 * amount:+.2f} +- {100 * sigma:.2f} %; calibrate it"
        case "time skew":
            return (
                f"the time: joints are read {100 * amount:.1f} +- {100 * sigma:.1f} % of the way before or after the "
                "image; wait until the arm has settled"
            )
        case "target moved" | "camera moved":
            return (
                f"that the {suspect.name.split()[0]} moved by about {1e3 * amount:.2f} mm before image "
                f"{suspect.image}; fix it, and take the images again"
            )
        case _:
            return f"the {suspect.name}: off by {100 * amount:+.3f} +- {100 * sigma:.3f} %"


def _remarks(c: ChainCalibration) -> list[str]:
    remarks = [
        f"{trial.part}: {'in the model' if trial.needed else 'left out'}, without them the cost rises by "
        f"{trial.rise:.1f} (chance: up to {trial.limit:.1f})"
        for trial in c.trials
    ]
    wrong = sum(map(len, c.wrong))
    if wrong:
        remarks.append(f"{wrong} of {c.images} images do not fit the others and were left out")
    remarks += [
        f"{a} and {b} can hardly be told apart (correlation {r:+.3f})"
        for a, b, r in c.correlations
        if abs(r) > HIGH
    ][:5]
    if c.weakest:
        together = ", ".join(f"{name} ({share:+.2f})" for name, share in c.weakest)
        remarks.append(f"weakest direction: {together}")
    if c.excess > max(c.excess_limit, 1.0):
        remarks.append(
            f"images agree {np.sqrt(c.excess):.1f} times less well with each other than corners and encoders explain, "
            "as of an arm that does not quite come back; all uncertainties are wider by that"
        )
    if not c.reasons and c.fit.chi2_dof <= c.chi2_limit:
        remarks += [f"worth a look: {describe(s)}" for s in c.suspects if s.sure or _would_matter(c, s)][:1]
    return remarks


def _would_matter(c: ChainCalibration, s: ChainSuspect) -> bool:
    """Whether it is a target's size that links of unknown length follow: where it shows at all, it shows hardly."""
    return s.name == "target size" and abs(s.amount) > _HINT * s.sigma and s.moves > c.limits.held_out
