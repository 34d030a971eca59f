"""``a465 calibrate hand-eye`` and ``kinematic``: calibrate from recorded images and judge the result."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from arm.calibration_file import COVARIANCE, ArmCalibration, write_arm_calibration
from arm.controller.unit import UNITS
from arm.errors import FileInputError, InputError
from arm.io.storage import write_atomic
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array
from calib.chain.result import ChainCalibration, ChainLimits
from calib.chain.self_test import SelfTest, self_test
from calib.hand_eye.calibrate import HAND_EYE_LIMITS, HandEye, calibrate_hand_eye
from calib.hand_eye.next_poses import next_poses
from calib.hand_eye.verdict import HandEyeLimits
from calib.model.intrinsics import vector_of
from calib.nao.calibrate import NAO_LIMITS, calibrate_nao
from calib.nao.chain import SIDES, NaoUnknowns
from calib.nao.recording import read_nao_recording
from calib.recordings.arm import ArmRecording, read_arm_recording
from cell.commands.calibration.cell_change import change_of, work_place
from cell.commands.calibration.options import OUTPUT, REPORT, ResultOptions, checked_limit, option_error
from cell.config.cell import Cell
from cell.console import Console
from cell.files.apply_calibration import apply_calibration, name_in, naming
from cell.files.task import cell_of
from cell.report.chain import chain_page
from cell.report.chain_text import (
    describe_self_test,
    hand_eye_json,
    hand_eye_tables,
    kinematic_json,
    kinematic_tables,
    print_chain,
    print_hand_eye,
    self_test_json,
)

_ALL = NaoUnknowns(head=True, compliance=True, backlash=True, limbs=True)

Limits = TypeVar("Limits", bound=ChainLimits)

MARKS = {OUTPUT: (b'id = "hand-eye-', b'"parameters"'), REPORT: (b"<!doctype html",)}
"""Texts at the start of the files that these commands write: an existing file without one is not overwritten."""


@dataclass(frozen=True)
class ChainOptions(ResultOptions):
    """Options of a calibration from recorded images; `limit_mm` is for predicted images.

    Attributes:
        encoder_step_deg: encoder resolution; None: estimated from the readings.
        cell: cell file (or task file) of the calibrated arm; None: unknown.
        apply: whether an accepted calibration is entered in the cell file.
    """

    encoder_step_deg: float | None = None
    cell: Path | None = None
    apply: bool = False

    def checked_all(self, inputs: Sequence[Path], format: str = ".toml") -> Self:
        """Check all options, and return them with the name of the report; see `ResultOptions.checked`."""
        self.limits(HAND_EYE_LIMITS)
        self.encoder_step()
        return self.checked(inputs, MARKS, format)

    def limits(self, usual: Limits, cell: Cell | None = None) -> Limits:
        """Return the limits of the verdict; `limit_mm` is that of held-out images, and of the tool in all directions.

        Raises:
            InputError: `limit_mm` is out of range.
        """
        if self.limit_mm is None and cell is not None and isinstance(usual, HandEyeLimits):
            return replace(usual, sideways=cell.tool_sideways, height=cell.tool_height)
        if self.limit_mm is None:
            return usual
        limit = checked_limit(self.limit_mm) / 1e3
        if isinstance(usual, HandEyeLimits):
            return replace(usual, held_out=limit, sideways=limit, height=limit)
        return replace(usual, held_out=limit)

    def encoder_step(self) -> float | None:
        """Return the encoder resolution in rad.

        Raises:
            InputError: it is out of range.
        """
        step = self.encoder_step_deg
        if step is not None and not 0.0 <= step <= 5.0:
            raise option_error("--encoder-step-deg", step, "must be from 0 to 5 deg")
        return None if step is None else float(np.radians(step))


def kinematic_step(data: Path, options: ChainOptions, console: Console) -> dict[str, Any]:
    """Calibrate camera and legs of a NAO from recorded images; write the file only if it is accepted.

    Raises:
        InputError: a file or an option is wrong.
        CalibrationRefused: nothing could be computed.
    """
    options = options.checked_all((data,), ".json")
    recording = read_nao_recording(data)
    console.step(f"fit: {len(recording.pixels)} images of {len(recording.board)} vertices")
    images = [of for number in range(len(SIDES)) if len(of := np.flatnonzero(recording.side == number))]
    calibration, test = _tested(
        calibrate_nao(recording, options.limits(NAO_LIMITS), options.encoder_step()), console
    )
    result = kinematic_json(calibration, _ALL.si(), images) | self_test_json(test)
    tables = kinematic_tables(calibration, _ALL.si())
    print_chain(calibration, tables, console, images)
    options.write_report(
        lambda: chain_page("Camera and legs of a NAO", data.name, calibration, tables, test, images), console
    )
    if options.output is not None and calibration.accepted:
        write_atomic(options.output, json.dumps(result, indent=2, allow_nan=False) + "\n")
        console.say(f"written: {options.output}")
    return result


def hand_eye_step(data: Path, options: ChainOptions, console: Console) -> dict[str, Any]:
    """Calibrate an arm and a fixed camera from recorded images; write the file only if it is accepted.

    Raises:
        InputError: a file or an option is wrong.
        CalibrationRefused: nothing could be computed.
    """
    cell = None
    if options.cell is not None:
        cell = cell_of(options.cell, without_calibration(console))
        options = replace(options, cell=cell.file)
    options = options.checked_all((data,) if cell is None else (data, cell.file, cell.camera_file))
    recording = read_arm_recording(data)
    if cell is not None and recording.unit and recording.unit != cell.unit.name:
        rule = f"must be {cell.unit.name!r}, the unit of {cell.file}"
        help = f"record that arm, or give the cell of the {recording.unit}"
        raise FileInputError(data, "unit", recording.unit, rule, help)
    if cell is not None and recording.camera.lens_digest != cell.nominal_camera.lens_digest:
        console.say(
            f"NOTE: the lens of {data} is not that of {cell.camera_file.name}: {cell.file} takes no calibration that "
            "was made with another lens; record with this lens, or give the cell of the recording"
        )
    return solve_hand_eye(data, recording, options, console, cell=cell)


def without_calibration(console: Console) -> Callable[[InputError], None]:
    """Return what says that a cell's calibration cannot be used; a calibration can begin without it."""
    return lambda why: console.step(f"started without the cell's calibration: {why}")


def _tested(c: ChainCalibration, console: Console) -> tuple[ChainCalibration, SelfTest | None]:
    """Run the self-test of an accepted calibration on synthetic data; refuse the calibration if the test fails."""
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


def solve_hand_eye(
    data: Path,
    recording: ArmRecording,
    options: ChainOptions,
    console: Console,
    pool: Array | None = None,
    cell: Cell | None = None,
) -> dict[str, Any]:
    """Calibrate from a recording, print the results and write them.

    Args:
        data: file of the recording.
        recording: its content.
        options: checked ones.
        console: output.
        pool: readings (n, joints), rad, from which further poses are proposed; None: any near the recorded ones.
        cell: of the arm and the camera: its changes are printed, and it has the verdict's limits; None: unknown.

    Raises:
        InputError: a file cannot be written.
        CalibrationRefused: nothing could be computed.
    """
    console.step(f"fit: {len(recording.joints)} poses of {recording.kind} ({len(recording.points)} points)")
    found = calibrate_hand_eye(
        recording,
        options.limits(HAND_EYE_LIMITS, cell),
        options.encoder_step(),
        None if cell is None else work_place(cell),
    )
    chain, test = _tested(found.chain, console)
    found = replace(found, chain=chain)
    more = next_poses(found, pool=pool)
    result = hand_eye_json(found, more) | self_test_json(test)
    page = partial(chain_page, "Camera and arm", data.name, chain, test=test)
    if cell is None:
        console.say("not compared with a cell: --cell FILE tells how far camera and joints have moved")
    else:
        change = change_of(found, cell)
        console.say(str(change))
        result["changed"] = change.json()
        page = partial(page, changed=change.rows, against=change.cell)
    print_hand_eye(found, console, more)
    tables = hand_eye_tables(found)
    options.write_report(lambda: page(found=tables), console)
    output = options.output
    if output is None:
        if found.chain.accepted:
            console.say("no calibration file was written; give -o FILE to write one")
        return result
    if found.chain.accepted:
        calibration = arm_calibration(found, test)
        write_arm_calibration(output, calibration)
        result["id"] = calibration.id
        console.say(f"written: {output} ({calibration.id})")
        if options.cell is not None and options.apply:
            console.say(f"{options.cell} now has: {apply_calibration(options.cell, output)}")
        else:
            console.say(_how_to_use(output, recording, options.cell))
    return result


def _how_to_use(output: Path, recording: ArmRecording, cell_file: Path | None) -> str:
    """Return how to enter the calibration in a cell file, or why no cell accepts it."""
    if cell_file is not None:
        return f"to use it, add to {cell_file}: {naming(name_in(cell_file, output))}"
    if not recording.unit:
        return (
            "the recording is of no unit, so no cell accepts this calibration: add the name of the arm's unit "
            f"({', '.join(UNITS)}, or that in its unit file) to the recording as key unit, and calibrate again"
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
    made: dict[str, Any] = {
        "poses": c.images - sum(map(len, c.wrong)),
        "target": found.recording.kind,
        "held_out_px": round(c.held_out.px, 4),
        "held_out_mm": round(1e3 * c.held_out.metres, 4),
        "chi2_dof": round(c.fit.chi2_dof, 4),
        "camera_std_mm": round(1e3 * float(np.linalg.norm(found.camera_sigma[0])), 4),
    }
    if found.tool.holes:
        made["tool_sideways_mm"] = round(1e3 * found.tool.sideways, 4)
        made["tool_height_mm"] = round(1e3 * found.tool.height, 4)
    if test is not None:
        made["self_test"] = "passed" if test.passed else "failed"
        made["self_test_nees_dof"] = round(test.nees_dof, 4)
        made["self_test_limits"] = [round(limit, 4) for limit in test.limits]
    return ArmCalibration(
        found.T_base_camera,
        found.joint_offsets,
        LinkErrors(*found.link_errors),
        found.recording.unit,
        found.recording.camera.lens_digest,
        found.recording.dh.digest,
        made,
        vector_of(found.camera) if found.lens_factor.shape[1] else None,
        found.joint_scatter,
        _rounded(found.covariance) if len(found.covariance) == sum(COVARIANCE) else None,
    )


def _rounded(covariance: Array) -> Array:
    """Return the values to nine digits, which is more than they are worth and keeps the file readable."""
    return np.array([[float(f"{value:.8e}") for value in row] for row in covariance])
