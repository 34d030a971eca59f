"""Kinematic calibration of the NAO from recorded images: model, fit and verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from calib.chain.fit import Problem, fit_chains
from calib.chain.model_selection import Choice, Part, choose_model, without
from calib.chain.per_image_poses import fit_per_image_poses
from calib.chain.result import ChainCalibration, ChainLimits, calibrate_chain
from calib.chain.score_tests import most_significant_first
from calib.chain.verdict import with_verdict
from calib.nao.backlash import fit_compliance_and_backlash
from calib.nao.chain import SIDES, NaoUnknowns
from calib.nao.limbs import LIMB_SIGMA, find_limb_errors, is_astray, limb_trial, limb_unknowns
from calib.nao.recording import NaoRecording
from calib.recordings.encoder_steps import encoder_sigmas
from calib.recordings.points import plausible_numbers

HEAD, COMPLIANCE, BACKLASH = "offsets of the head", "compliance of the joints", "backlash of the joints"
LIMBS = "lengths of the limbs"
WELL_KEPT = 0.95  # fraction of images kept at which no other start is tried
_CERTAIN = 5.0  # standard deviations above which a sign is certain
GEARS = np.radians(2.0)  # prior on compliance, rad/Nm, and backlash, rad
_ALL = NaoUnknowns(head=True, compliance=True, backlash=True, limbs=True)
_GEARS = [i for i, name in enumerate(_ALL.names) if "compliance" in name or "backlash" in name]
NAO_LIMITS = ChainLimits(held_out=2e-3)


def _shaped(
    choice: Choice, full: Problem, parts: Sequence[Part], recording: NaoRecording, sides: Sequence[str]
) -> Choice:
    """Repeat the choice with the shape of backlash that fits better, if the model has compliance or backlash.

    Rejected images are tried again: if backlash is abrupt, images near a change of sides do not fit smooth backlash.
    """
    if is_astray(choice.fit) or not choice.problem.free[_GEARS].any():
        return choice
    full = replace(full, reading_sigma=choice.problem.reading_sigma)
    tried: list[Choice] = []
    for weights in (None, choice.fit.weights):
        shaped = fit_compliance_and_backlash(full, _ALL, sides, recording.gravity, weights)
        tried.append(choose_model(shaped.problem, parts, shaped.fit.weights))
        if _kept(tried[-1]) >= WELL_KEPT:
            break
    return max(tried, key=_kept)


def _with_limbs(
    limbless: Choice, full: Problem, parts: Sequence[Part], recording: NaoRecording, sides: Sequence[str]
) -> Choice:
    """Put limbs, the last of `parts`, in a model if the images show them; otherwise it stays as it was.

    `full` has the unknowns of all parts free.
    """
    if is_astray(limbless.fit):
        return limbless
    test = find_limb_errors(limbless.problem, limbless.fit, _ALL, sides)
    trial = limb_trial(limbless.problem, limbless.fit, test, LIMBS)
    if trial.needed:
        full = replace(full, reading_sigma=limbless.problem.reading_sigma)
        other = _shaped(choose_model(full, parts), full, parts, recording, sides)
        if other.problem.free[parts[-1].unknowns[0]]:
            return other
        trial = next(t for t in other.trials if t.part == LIMBS)
    return replace(limbless, trials=(*limbless.trials, trial))


def _kept(choice: Choice) -> float:
    """Fraction of the images that are kept."""
    return float(np.mean(np.concatenate(choice.fit.weights) > 0.0))


@plausible_numbers()
def calibrate_nao(
    recording: NaoRecording,
    limits: ChainLimits = NAO_LIMITS,
    encoder_step: float | None = None,
    limbs: bool = True,
) -> ChainCalibration:
    """Calibrate camera, legs and boards of a NAO.

    Head offsets, compliance, backlash and limb lengths are in the model if the images show them.

    Args:
        recording: images.
        limits: of the verdict.
        encoder_step: rad; default: estimated from the readings.
        limbs: whether limb lengths may enter the model; otherwise a score test alone tells errors of theirs.

    Raises:
        CalibrationRefused: the recording's numbers are implausible.
    """
    names, si = _ALL.names, _ALL.si()
    recorded = recording.sightings(_ALL)
    alone = fit_per_image_poses(
        recording.camera, recording.board, np.concatenate([s.pixels for s in recorded])
    )
    ends = np.cumsum([len(s.readings) for s in recorded])[:-1]
    sightings = [
        replace(s, pixels=np.where(wrong[..., None], np.nan, s.pixels), noise=noise)
        for s, wrong, noise in zip(
            recorded, np.split(alone.wrong, ends), np.split(alone.noise, ends), strict=True
        )
    ]
    sigma = np.full(len(names), np.inf)
    sigma[_GEARS] = GEARS
    seen = {side for number, side in enumerate(SIDES) if (recording.side == number).any()}
    shown = np.array([name[0] in seen or name.startswith(("Cam", "Head")) for name in names])
    sides = sorted(seen)
    lengths = limb_unknowns(_ALL, sides)
    sigma[lengths] = LIMB_SIGMA
    limbless = shown.copy()
    limbless[lengths] = False
    parts = {
        HEAD: [name.startswith("Head") for name in names],
        COMPLIANCE: ["compliance" in name for name in names],
        BACKLASH: ["backlash" in name for name in names],
    }
    problem = Problem(
        sightings,
        recording.camera,
        np.zeros(len(names)),
        sigma,
        alone.pixel_sigma,
        encoder_sigmas([s.readings for s in sightings], encoder_step),
        limbless,
        alone.freedom,
    )
    optional = [Part(name, tuple(np.flatnonzero(of & shown).tolist())) for name, of in parts.items()]

    every_part = [*optional, Part(LIMBS, tuple(lengths))]
    longer = replace(problem, free=shown)

    def limbs_explain() -> bool:
        plain = without(problem, *optional)
        fit = fit_chains(plain)
        return limb_trial(plain, fit, find_limb_errors(plain, fit, _ALL, sides), LIMBS).needed

    # limbs that are off distort compliance and backlash, whose fit then takes long: try them first
    first = limbs and limbs_explain()

    def refined(choice: Choice) -> Choice:
        if first:
            if choice.fit.chi2_dof < limits.chi2_dof and not choice.problem.free[_GEARS].any():
                return choice
            choice = choose_model(replace(problem, reading_sigma=choice.problem.reading_sigma), optional)
        choice = _shaped(choice, problem, optional, recording, sides)
        return _with_limbs(choice, longer, every_part, recording, sides) if limbs else choice

    calibration = calibrate_chain(
        names,
        np.array([name.endswith("_mm") for name in names]),
        longer if first else problem,
        every_part if first else optional,
        limits,
        refined=refined,
        step_known=encoder_step is not None,
    )
    if not calibration.problem.free[lengths].any():
        more = find_limb_errors(calibration.problem, calibration.fit, _ALL, sides).limbs
        hypotheses = most_significant_first((*calibration.hypotheses, *more))
        calibration = replace(calibration, hypotheses=hypotheses)

    def in_words(name: str, value: float) -> str:
        unit = name.rpartition("_")[2] if "_per_" not in name else "deg/Nm"
        return f"{value / si[names.index(name)]:.3g} {unit}"

    calibration = with_verdict(calibration, in_words)
    return replace(calibration, reasons=(*calibration.reasons, *_negative_compliance(calibration)))


def _negative_compliance(c: ChainCalibration) -> Iterator[str]:
    """Refuse joints that deflect against their load."""
    values, sigma = c.fit.unknowns, np.sqrt(np.diag(c.covariance))
    wrong = [
        name
        for name, value, s in zip(c.names, values, sigma, strict=True)
        if "compliance" in name and value < -_CERTAIN * s
    ]
    if wrong:
        names = ", ".join(wrong[:3]) + (", ..." if len(wrong) > 3 else "")
        yield (
            f"{len(wrong)} joints have negative compliance ({names}): is the sign of gravity_m_s2 right? With the "
            "robot on its back it is -9.81, 0, 0 in the torso frame"
        )
