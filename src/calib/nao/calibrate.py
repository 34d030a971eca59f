"""Kinematic calibration of the NAO of the second seed from recorded images: model, fit and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.chain.fit import MOST_STEPS, Problem
from calib.chain.model_selection import Choice, Part, choose_model
from calib.chain.per_image_poses import fit_free_poses
from calib.chain.result import ChainCalibration, ChainLimits, calibrate_chain
from calib.chain.verdict import judged
from calib.nao.backlash import fit_springs_and_play
from calib.nao.chain import SIDES, NaoUnknowns
from calib.nao.recording import NaoRecording
from calib.recordings.encoder_steps import reading_sigmas
from calib.recordings.points import numbers_of_this_world

HEAD, SPRINGS, PLAY = "offsets of the head", "springs in the joints", "play in the joints"
WELL_KEPT = 0.95  # share of the images, from which no other start is tried
_ASTRAY = 100.0  # chi2 per degree of freedom at which a fit that found no end is not looked into
_CERTAIN = 5.0  # standard deviations from which a sign is certain
GEARS = np.radians(2.0)  # rad/Nm and rad: how soft and how loose the gears of such a robot may be
_ALL = NaoUnknowns(head=True, springs=True, play=True)
NAO_LIMITS = ChainLimits(held_out=2e-3)


def _shaped(
    choice: Choice,
    full: Problem,
    parts: Sequence[Part],
    recording: NaoRecording,
    sides: Sequence[str],
    noise_freedom: float,
) -> Choice:
    """The choice made again with the shape of the play that the images show, if there are springs or play.

    Images that seemed wrong are given another chance: where play changes sides all at once, those near a change do not
    fit play that is smooth.
    """
    gears = [i for i, name in enumerate(_ALL.names) if "compliance" in name or "backlash" in name]
    astray = choice.fit.iterations >= MOST_STEPS and choice.fit.chi2_dof > _ASTRAY
    if astray or not choice.problem.free[gears].any():
        return choice
    full = replace(full, reading_sigma=choice.problem.reading_sigma)
    best: Choice | None = None
    for weights in (None, choice.fit.weights):
        shaped = fit_springs_and_play(full, _ALL, sides, recording.gravity, weights)
        again = choose_model(shaped.problem, parts, shaped.fit.weights, noise_freedom)
        if best is None or _kept(again) > _kept(best):
            best = again
        if _kept(best) >= WELL_KEPT:
            break
    return choice if best is None else best


def _kept(choice: Choice) -> float:
    """Share of the images that are not left out."""
    return float(np.mean(np.concatenate(choice.fit.weights) > 0.0))


def calibrate_nao(
    recording: NaoRecording, limits: ChainLimits = NAO_LIMITS, encoder_step: float | None = None
) -> ChainCalibration:
    """Camera, legs and boards of a NAO, with those of head, springs and play that the images show.

    Args:
        recording: images.
        limits: of the verdict.
        encoder_step: rad; None to see it from the readings.

    Raises:
        CalibrationRefused: the recording has numbers that no robot and camera have.
    """
    with numbers_of_this_world():
        return _calibrated(recording, limits, encoder_step)


def _calibrated(recording: NaoRecording, limits: ChainLimits, encoder_step: float | None) -> ChainCalibration:
    names, si = _ALL.names, _ALL.si()
    recorded = recording.sightings(_ALL)
    alone = fit_free_poses(recording.camera, recording.board, np.concatenate([s.pixels for s in recorded]))
    ends = np.cumsum([len(s.readings) for s in recorded])[:-1]
    sightings = [
        replace(s, pixels=np.where(wrong[..., None], np.nan, s.pixels), noise=noise)
        for s, wrong, noise in zip(
            recorded, np.split(alone.wrong, ends), np.split(alone.noise, ends), strict=True
        )
    ]
    if encoder_step is None:
        reading_sigma = reading_sigmas([s.readings for s in sightings])
    else:
        reading_sigma = np.full(sightings[0].readings.shape[1], encoder_step / np.sqrt(12.0))
    gears = np.array(["compliance" in name or "backlash" in name for name in names])
    seen = {side for number, side in enumerate(SIDES) if (recording.side == number).any()}
    shown = np.array([name[0] in seen or name.startswith(("Cam", "Head")) for name in names])
    parts = {
        HEAD: [name.startswith("Head") for name in names],
        SPRINGS: ["compliance" in name for name in names],
        PLAY: ["backlash" in name for name in names],
    }
    problem = Problem(
        sightings,
        recording.camera,
        np.zeros(len(names)),
        np.where(gears, GEARS, np.inf),
        alone.pixel_sigma,
        reading_sigma,
        shown,
    )
    optional = [Part(name, tuple(np.flatnonzero(of & shown).tolist())) for name, of in parts.items()]
    calibration = calibrate_chain(
        names,
        np.array([name.endswith("_mm") for name in names]),
        problem,
        optional,
        limits,
        None,
        alone.freedom,
        lambda choice: _shaped(choice, problem, optional, recording, sorted(seen), alone.freedom),
        step_known=encoder_step is not None,
    )

    def in_words(name: str, value: float) -> str:
        unit = name.rpartition("_")[2] if "_per_" not in name else "deg/Nm"
        return f"{value / si[names.index(name)]:.3g} {unit}"

    calibration = judged(calibration, in_words)
    return replace(calibration, reasons=(*calibration.reasons, *_pushing_springs(calibration)))


def _pushing_springs(c: ChainCalibration) -> list[str]:
    """Joints that give way against their load, which no spring does."""
    values, sigma = c.fit.unknowns, np.sqrt(np.diag(c.covariance))
    wrong = [
        name
        for name, value, s in zip(c.names, values, sigma, strict=True)
        if "compliance" in name and value < -_CERTAIN * s
    ]
    if not wrong:
        return []
    return [
        f"{len(wrong)} joints give way against their load ({', '.join(wrong[:3])}{', ...' if len(wrong) > 3 else ''} "
        "below 0): is gravity_m_s2 the other way round? On its back it is -9.81, 0, 0 in the torso's frame"
    ]
