"""``a465 calibrate hand-eye`` and ``kinematic``: recorded images in, a calibration with its verdict out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.armcalibration import ArmCalibration, write_arm_calibration
from arm.errors import InputError
from arm.files import keep_apart, write_atomic
from arm.links import LinkErrors
from calib.arm_recording import ArmRecording, read_arm_recording
from calib.chain_calibration import ChainCalibration, ChainLimits
from calib.hand_eye import HAND_EYE_LIMITS, HandEye, calibrate_hand_eye
from calib.kinematic import NAO_LIMITS, calibrate_nao
from calib.nao import NaoUnknowns
from calib.nao_recording import read_nao_recording
from calib.next_poses import next_poses
from calib.twin import TWINS, self_test
from cell.chainpage import chain_page
from cell.chainresult import (
    Tables,
    hand_eye_json,
    hand_eye_tables,
    kinematic_json,
    kinematic_tables,
    tell_hand_eye,
    tell_kinematic,
)
from cell.console import Console

_ALL = NaoUnknowns(head=True, springs=True, play=True)


def limits_of(limits: ChainLimits, limit_mm: float | None) -> ChainLimits:
    """The limits of the verdict, with the one that a person gives.

    Raises:
        InputError: it breaks its rule.
    """
    if limit_mm is None:
        return limits
    if not 0.0 < limit_mm < np.inf:
        raise InputError(
            f"--limit-mm {limit_mm:g}: must be above 0 mm, and a number", option="--limit-mm", value=limit_mm
        )
    return replace(limits, held_out=limit_mm / 1e3)


def _step(encoder_step_deg: float | None) -> float | None:
    if encoder_step_deg is None:
        return None
    if not 0.0 <= encoder_step_deg <= 5.0:
        raise InputError(
            f"--encoder-step-deg {encoder_step_deg:g}: must be from 0 to 5 deg", value=encoder_step_deg
        )
    return float(np.radians(encoder_step_deg))


def kinematic_step(
    data: Path,
    output: Path | None,
    report: Path | None,
    limit_mm: float | None,
    encoder_step_deg: float | None,
    console: Console,
) -> dict[str, Any]:
    """Calibrate camera and legs of a NAO from recorded images; the file is written only if it is accepted.

    Raises:
        InputError: a file or an option is wrong.
        CalibrationRefused: nothing could be computed.
    """
    limits, step = limits_of(NAO_LIMITS, limit_mm), _step(encoder_step_deg)
    report = report_beside(output, report)
    keep_apart(output, data)
    keep_apart(report, data)
    require_files(output, report)
    recording = read_nao_recording(data)
    console.step(f"fit: {len(recording.pixels)} images of {len(recording.board)} vertices")
    calibration = calibrate_nao(recording, limits, step)
    result = kinematic_json(calibration, _ALL.si()) | _tested(calibration, console)
    tell_kinematic(calibration, _ALL.si(), console)
    tables = kinematic_tables(calibration, _ALL.si())
    _write_report(report, "Camera and legs of a NAO", data, calibration, tables, console)
    if output is not None and calibration.accepted:
        write_atomic(output, json.dumps(result, indent=2, allow_nan=False) + "\n")
        console.say(f"written: {output}")
    return result


def hand_eye_step(
    data: Path,
    output: Path | None,
    report: Path | None,
    limit_mm: float | None,
    encoder_step_deg: float | None,
    console: Console,
) -> dict[str, Any]:
    """Calibrate an arm before a fixed camera from recorded images; the file is written only if it is accepted.

    Raises:
        InputError: a file or an option is wrong.
        CalibrationRefused: nothing could be computed.
    """
    limits, step = limits_of(HAND_EYE_LIMITS, limit_mm), _step(encoder_step_deg)
    report = report_beside(output, report)
    keep_apart(output, data)
    keep_apart(report, data)
    require_files(output, report)
    recording = read_arm_recording(data)
    return solve_hand_eye(data, recording, recording.unit, output, report, limits, step, console)


def report_beside(output: Path | None, report: Path | None) -> Path | None:
    """Where the report goes: beside the result if it is not said."""
    return report or (output.with_suffix(".html") if output is not None else None)


def require_files(*written: Path | None) -> None:
    """Before anything is done that takes long, see that what comes of it can be written.

    Raises:
        InputError: one of the files to write is something else than a file, or two are the same.
    """
    given = [path for path in written if path is not None]
    for path in given:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is no ordinary file; give the name of a file", path=str(path))
    if len({path.resolve() for path in given}) < len(given):
        raise InputError(
            f"{given[0]}: is the name of the report too; give -o and --report different names",
            path=str(given[0]),
        )


def _write_report(
    report: Path | None, title: str, data: Path, c: ChainCalibration, tables: Tables, console: Console
) -> None:
    if report is not None:
        write_atomic(report, chain_page(title, data.name, c, tables))
        console.say(f"report: {report}")


def _tested(c: ChainCalibration, console: Console) -> dict[str, Any]:
    """A self-test on synthetic twins of the data, told; what is refused needs none."""
    if not c.accepted:
        return {}
    test = self_test(c)
    low, high = test.limits
    verdict = "as predicted" if test.passed else "NOT as predicted: do not rely on the standard deviations"
    console.step(
        f"self-test on {TWINS} synthetic twins: squared errors {test.nees_dof:.2f} of the predicted ones (chance: "
        f"{low:.2f} to {high:.2f}), {verdict}"
    )
    return {
        "self_test": {
            "nees_dof": test.nees_dof,
            "limits": list(test.limits),
            "worst_sigmas": test.worst,
            "passed": test.passed,
        }
    }


def solve_hand_eye(
    data: Path,
    recording: ArmRecording,
    unit: str,
    output: Path | None,
    report: Path | None,
    limits: ChainLimits,
    encoder_step: float | None,
    console: Console,
) -> dict[str, Any]:
    """Calibrate from the recording of a file, of a unit (its name, or ""); tell, and write."""
    console.step(f"fit: {len(recording.joints)} poses of {recording.kind} ({len(recording.points)} points)")
    found = calibrate_hand_eye(recording, limits, encoder_step)
    more = next_poses(found)
    result = hand_eye_json(found, more) | _tested(found.chain, console)
    tell_hand_eye(found, console, more)
    _write_report(report, "Camera and arm", data, found.chain, hand_eye_tables(found), console)
    if output is not None and found.chain.accepted:
        calibration = arm_calibration(found, unit)
        write_arm_calibration(output, calibration)
        result["id"] = calibration.id
        console.say(
            f'written: {output} ({calibration.id}); name it in the cell file: calibration = "{output.name}"'
        )
    elif output is None and found.chain.accepted:
        console.say("no calibration file was written: -o FILE writes it")
    return result


def arm_calibration(found: HandEye, unit: str) -> ArmCalibration:
    """What a cell needs of a calibration."""
    c = found.chain
    return ArmCalibration(
        found.T_base_camera,
        found.joint_offsets,
        LinkErrors(*found.link_errors),
        unit,
        found.recording.camera.lens_digest,
        found.recording.dh.digest,
        {
            "poses": c.images - sum(map(len, c.wrong)),
            "target": found.recording.kind,
            "held_out_px": round(c.held_out.px, 4),
            "held_out_mm": round(1e3 * c.held_out.metres, 4),
            "chi2_dof": round(c.fit.chi2_dof, 4),
            "camera_std_mm": round(1e3 * float(np.linalg.norm(found.camera_sigma[0])), 4),
        },
    )
