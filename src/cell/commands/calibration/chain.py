"""``a465 calibrate hand-eye`` and ``kinematic``: calibrate from recorded images and judge the result."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.controller.unit import UNITS
from arm.errors import InputError
from arm.io.storage import keep_apart, open_file, write_atomic
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array
from calib.chain.result import ChainCalibration, ChainLimits
from calib.chain.self_test import SelfTest, self_test
from calib.hand_eye.calibrate import HAND_EYE_LIMITS, HandEye, calibrate_hand_eye
from calib.hand_eye.next_poses import next_poses
from calib.nao.calibrate import NAO_LIMITS, calibrate_nao
from calib.nao.chain import SIDES, NaoUnknowns
from calib.nao.recording import read_nao_recording
from calib.recordings.arm import ArmRecording, read_arm_recording
from cell.console import Console
from cell.files.apply_calibration import apply_calibration, name_in, naming
from cell.report.chain import chain_page
from cell.report.chain_text import (
    describe_self_test,
    hand_eye_json,
    hand_eye_tables,
    kinematic_json,
    kinematic_tables,
    self_test_json,
    tell_hand_eye,
    tell_kinematic,
)

_ALL = NaoUnknowns(head=True, springs=True, play=True)
_HEAD = 4096  # bytes of a file that identify its content


@dataclass(frozen=True)
class Results:
    """Files that a calibration writes.

    Attributes:
        output: calibration file, written if it is accepted; None: not written.
        report: HTML report; None: not written.
    """

    output: Path | None
    report: Path | None

    @classmethod
    def beside(cls, output: Path | None, report: Path | None, *inputs: Path) -> Results:
        """Return the files to write, the report beside the calibration by default.

        Check first that the output can be written, before the long computation.

        Raises:
            InputError: an output file is one of `inputs`, not a regular file, not written by this command before, or
                named twice; or its folder is not writable.
        """
        for path in (output, report):
            if path is not None:
                _require_name(path)
        if report is None and output is not None:
            report = output.with_suffix(".html")
        outputs = [path for path in (output, report) if path is not None]
        for path in outputs:
            keep_apart(path, *inputs)
            if any(path.resolve() == read.resolve() for read in inputs):  # they may not exist yet
                raise InputError(f"{path}: is also the name of an input; give another file", path=str(path))
            if path.exists() and not path.is_file():
                raise InputError(f"{path}: is not a regular file; give the name of a file", path=str(path))
            _require_folder(path)
        _require_ours(output, "calibration", (b'id = "hand-eye-', b'"parameters"'))
        _require_ours(report, "report", (b"<!doctype html",))
        if len({path.resolve() for path in outputs}) < len(outputs):
            raise InputError(
                f"{outputs[0]}: is also the name of the report; give -o and --report different names",
                path=str(outputs[0]),
            )
        return cls(output, report)

    def write_report(self, page: Callable[[], str], console: Console) -> None:
        """Write the report, if any, and print its name."""
        if self.report is not None:
            write_atomic(self.report, page())
            console.say(f"report: {self.report}")


def _require_name(path: Path) -> None:
    """Refuse a path that the operating system does not accept as a file name."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ValueError) as error:  # OSError: too long, circular links; ValueError: a zero byte
        why = error.strerror if isinstance(error, OSError) else "it contains a zero byte"
        raise InputError(f"{path}: cannot be the name of a file: {why}", path=str(path)) from error
    if not path.name:
        raise InputError(f"{path}: is not a regular file; give the name of a file", path=str(path))


def _require_folder(path: Path) -> None:
    """Refuse a path whose folder is not writable and cannot be created."""
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: {folder} is not writable; give another file", path=str(path))


def _require_ours(path: Path | None, what: str, marks: Sequence[bytes]) -> None:
    """Refuse to overwrite a file that this command did not write, such as a cell file given by mistake."""
    if path is None or not path.exists():
        return
    try:
        with open_file(path, "JSON") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}", path=str(path)) from error
    if head and not any(mark in head for mark in marks):
        raise InputError(
            f"{path}: exists and is no {what} that this command wrote, so it is not overwritten; give another file, "
            "or remove it first",
            path=str(path),
        )


def limits_of(limits: ChainLimits, limit_mm: float | None) -> ChainLimits:
    """Return the limits of the verdict, with ``--limit-mm`` applied.

    Raises:
        InputError: `limit_mm` is out of range.
    """
    if limit_mm is None:
        return limits
    if not 0.0 < limit_mm < np.inf:
        raise InputError(
            f"--limit-mm {limit_mm:g}: must be above 0 mm and finite", option="--limit-mm", value=limit_mm
        )
    return replace(limits, held_out=limit_mm / 1e3)


def encoder_step_of(encoder_step_deg: float | None) -> float | None:
    """Convert ``--encoder-step-deg`` to rad.

    Raises:
        InputError: it is out of range.
    """
    if encoder_step_deg is None:
        return None
    if not 0.0 <= encoder_step_deg <= 5.0:
        raise InputError(
            f"--encoder-step-deg {encoder_step_deg:g}: must be from 0 to 5 deg",
            option="--encoder-step-deg",
            value=encoder_step_deg,
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
    """Calibrate camera and legs of a NAO from recorded images; write the file only if it is accepted.

    Raises:
        InputError: a file or an option is wrong.
        CalibrationRefused: nothing could be computed.
    """
    limits, step = limits_of(NAO_LIMITS, limit_mm), encoder_step_of(encoder_step_deg)
    results = Results.beside(output, report, data)
    recording = read_nao_recording(data)
    console.step(f"fit: {len(recording.pixels)} images of {len(recording.board)} vertices")
    images = [of for number in range(len(SIDES)) if len(of := np.flatnonzero(recording.side == number))]
    calibration, test = _tested(calibrate_nao(recording, limits, step), console)
    result = kinematic_json(calibration, _ALL.si(), images) | _test_json(test)
    tell_kinematic(calibration, _ALL.si(), console, images)
    tables = kinematic_tables(calibration, _ALL.si())
    results.write_report(
        lambda: chain_page("Camera and legs of a NAO", data.name, calibration, tables, test, images), console
    )
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
    """Calibrate an arm and a fixed camera from recorded images; write the file only if it is accepted.

    Raises:
        InputError: a file or an option is wrong.
        CalibrationRefused: nothing could be computed.
    """
    limits, step = limits_of(HAND_EYE_LIMITS, limit_mm), encoder_step_of(encoder_step_deg)
    results = Results.beside(output, report, data)
    return solve_hand_eye(data, read_arm_recording(data), results, limits, step, console)


def _tested(c: ChainCalibration, console: Console) -> tuple[ChainCalibration, SelfTest | None]:
    """Run the self-test of an accepted calibration on synthetic data and refuse the calibration if it fails."""
    if not c.accepted:
        return c, None
    test = self_test(c)
    console.step(f"self-test: {describe_self_test(test)}")
    if test.passed:
        return c, test
    reason = (
        f"the self-test fails: {describe_self_test(test)}, so the standard deviations are unreliable; more images in "
        "more varied configurations would help"
    )
    return replace(c, reasons=(reason,)), test


def _test_json(test: SelfTest | None) -> dict[str, Any]:
    return {} if test is None else {"self_test": self_test_json(test)}


def solve_hand_eye(
    data: Path,
    recording: ArmRecording,
    results: Results,
    limits: ChainLimits,
    encoder_step: float | None,
    console: Console,
    cell_file: Path | None = None,
    apply: bool = False,
    pool: Array | None = None,
) -> dict[str, Any]:
    """Calibrate from a recording, print the results and write them.

    Args:
        data: file of the recording.
        recording: its content.
        results: files to write.
        limits: limits of the verdict.
        encoder_step: encoder resolution, rad; None: estimated from the readings.
        console: output.
        cell_file: cell file of the recorded arm; None: unknown.
        apply: enter an accepted calibration in the cell file.
        pool: readings (n, joints), rad, from which further poses are proposed; None: any near the recorded ones.

    Raises:
        InputError: a file cannot be written.
        CalibrationRefused: nothing could be computed.
    """
    console.step(f"fit: {len(recording.joints)} poses of {recording.kind} ({len(recording.points)} points)")
    found = calibrate_hand_eye(recording, limits, encoder_step)
    chain, test = _tested(found.chain, console)
    found = replace(found, chain=chain)
    more = next_poses(found, pool=pool)
    result = hand_eye_json(found, more) | _test_json(test)
    tell_hand_eye(found, console, more)
    tables = hand_eye_tables(found)
    results.write_report(lambda: chain_page("Camera and arm", data.name, chain, tables, test), console)
    output = results.output
    if output is None:
        if found.chain.accepted:
            console.say("no calibration file was written; give -o FILE to write one")
        return result
    if found.chain.accepted:
        calibration = arm_calibration(found, test)
        write_arm_calibration(output, calibration)
        result["id"] = calibration.id
        console.say(f"written: {output} ({calibration.id})")
        if cell_file is not None and apply:
            console.say(f"{cell_file} now has: {apply_calibration(cell_file, output)}")
        else:
            console.say(_how_to_use(output, recording, cell_file))
    return result


def _how_to_use(output: Path, recording: ArmRecording, cell_file: Path | None) -> str:
    """Return how to enter the calibration in a cell file, or why no cell accepts it."""
    if cell_file is not None:
        return f"to use it, add to {cell_file}: {naming(name_in(cell_file, output))}"
    if recording.unit not in UNITS:
        of = f"of unit {recording.unit!r}" if recording.unit else "of no unit"
        return (
            f"the recording is {of}, so no cell accepts this calibration: add the arm's unit "
            f"({' or '.join(UNITS)}) to the recording as key unit, and calibrate again"
        )
    if recording.dh.digest != A465.digest:
        return "the recording's dh are not the parameters of the A465, so no cell accepts this calibration"
    return (
        f"to use it, add to the cell file of the {recording.unit}, with the path relative to its folder; in the same "
        f"folder: {naming(output.name)}"
    )


def arm_calibration(found: HandEye, test: SelfTest | None = None) -> ArmCalibration:
    """Return the part of a calibration that a cell needs, with the result of the self-test."""
    c = found.chain
    return ArmCalibration(
        found.T_base_camera,
        found.joint_offsets,
        LinkErrors(*found.link_errors),
        found.recording.unit,
        found.recording.camera.lens_digest,
        found.recording.dh.digest,
        {
            "poses": c.images - sum(map(len, c.wrong)),
            "target": found.recording.kind,
            "held_out_px": round(c.held_out.px, 4),
            "held_out_mm": round(1e3 * c.held_out.metres, 4),
            "chi2_dof": round(c.fit.chi2_dof, 4),
            "camera_std_mm": round(1e3 * float(np.linalg.norm(found.camera_sigma[0])), 4),
            **({} if test is None else _made_of(test)),
        },
    )


def _made_of(test: SelfTest) -> dict[str, Any]:
    return {
        "self_test": "passed" if test.passed else "failed",
        "self_test_nees_dof": round(test.nees_dof, 4),
        "self_test_limits": [round(limit, 4) for limit in test.limits],
    }
