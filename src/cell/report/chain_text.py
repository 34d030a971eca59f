"""Output of a kinematic chain's calibration: tables for the user, JSON for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from calib.chain.result import ChainCalibration
from calib.chain.self_test import TWINS, SelfTest
from calib.hand_eye.calibrate import GAUGES, HandEye
from calib.hand_eye.next_poses import NextPose
from cell.console import Console
from cell.report.verdict_text import print_verdict, verdict_json

_DEG = np.degrees(1.0)
_POSES = 12  # parameters of the two poses, which come before those of the joints

Numbers = npt.NDArray[np.intp]
"""Indices of images in a recording, from 0."""


def left_out(c: ChainCalibration, images: Sequence[Numbers] = ()) -> list[list[int]]:
    """Return the indices in the recording, from 0, of the images left out of each chain.

    Args:
        c: the calibration.
        images: for each chain, the indices of its images in the recording, (n,); empty: one chain has all images.
    """
    return [(images[k][of] if images else of).tolist() for k, of in enumerate(c.wrong)]


def numbers(images: Sequence[Sequence[int]]) -> str:
    """Return the image numbers of all chains in one text, such as ``3, 7 to 12, 20``."""
    runs: list[list[int]] = []
    for image in sorted(number for of in images for number in of):
        if runs and image == runs[-1][-1] + 1:
            runs[-1].append(image)
        else:
            runs.append([image])
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def kinematic_json(c: ChainCalibration, si: Any, images: Sequence[Numbers] = ()) -> dict[str, Any]:
    """Return the NAO's result. `si` is the SI value of each parameter's unit, (count,); `images` as in `left_out`."""
    sigma = np.sqrt(np.diag(c.covariance))
    free = np.flatnonzero(c.problem.free)
    return {
        "parameters": {
            c.names[i]: {"value": float(c.fit.unknowns[i] / si[i]), "std": float(sigma[i] / si[i])}
            for i in free
        },
        "held_at_zero": [name for name, fitted in zip(c.names, c.problem.free, strict=True) if not fitted],
        "encoder_std_deg": np.degrees(c.problem.reading_sigma).tolist(),
        **_chain_json(c, images),
    }


def _joint_parameters(h: HandEye) -> list[tuple[str, str, float, Array, Array, Array]]:
    """Return the four parameters of every joint: key, heading, factor to its unit, values, deviations, which are free.

    The arrays are (joints,), SI.
    """
    joints = h.recording.dh.joints
    return list(
        zip(
            ("joint_offsets_rad", "dh_d_error_m", "dh_a_error_m", "dh_alpha_error_rad"),
            ("zero deg", "d mm", "a mm", "alpha deg"),
            (_DEG, 1e3, 1e3, _DEG),
            (h.joint_offsets, *h.link_errors),
            np.sqrt(np.diag(h.chain.covariance))[_POSES : _POSES + 4 * joints].reshape(4, joints),
            h.chain.problem.free[_POSES : _POSES + 4 * joints].reshape(4, joints),
            strict=True,
        )
    )


def hand_eye_json(h: HandEye, more: Sequence[NextPose] = ()) -> dict[str, Any]:
    """Return the result of a hand-eye calibration, and further poses that would help most."""
    (camera_m, camera_rad), (target_m, target_rad) = h.camera_sigma, h.target_sigma
    parameters = _joint_parameters(h)
    return {
        "T_base_camera": h.T_base_camera.tolist(),
        "T_gripper_target": h.T_gripper_target.tolist(),
        **{key: values.tolist() for key, _, _, values, _, _ in parameters},
        "std": {
            "T_base_camera": {"position_m": camera_m.tolist(), "rotation_rad": camera_rad.tolist()},
            "T_gripper_target": {"position_m": target_m.tolist(), "rotation_rad": target_rad.tolist()},
            **{key: sigma.tolist() for key, _, _, _, sigma, _ in parameters},
        },
        "held_out_px": _or_none(h.chain.held_out.px),
        "held_out_mm": _or_none(1e3 * h.chain.held_out.metres),
        "gauges": list(GAUGES),
        "next_poses": [{"joints_rad": p.joints.tolist(), "gain": p.gain} for p in more],
        **_chain_json(h.chain),
    }


def self_test_json(test: SelfTest | None) -> dict[str, Any]:
    """Return the result of the self-test on synthetic twins as ``self_test``; nothing if it was not run."""
    if test is None:
        return {}
    result = {"nees_dof": test.nees_dof, "limits": list(test.limits), "worst_sigmas": test.worst}
    return {"self_test": {**result, "passed": test.passed}}


def describe_self_test(test: SelfTest) -> str:
    """Return the result of the self-test in words."""
    low, high = test.limits
    verdict = "as predicted" if test.passed else "NOT as predicted"
    return (
        f"on {TWINS} synthetic twins squared errors are {test.nees_dof:.2f} times the predicted ones (by chance: "
        f"{low:.2f} to {high:.2f}), {verdict}"
    )


def _chain_json(c: ChainCalibration, images: Sequence[Numbers] = ()) -> dict[str, Any]:
    return {
        "residual_std_px": c.residual_std.tolist(),
        "corner_sigma_px": c.problem.pixel_sigma.tolist(),
        "iterations": c.iterations,
        "solve_s": c.solve_s,
        "chi2_dof": c.fit.chi2_dof,
        "held_out": {"px": _or_none(c.held_out.px), "mm": _or_none(1e3 * c.held_out.metres)},
        "images": c.images,
        "wrong_images": left_out(c, images),
        "model": [{"part": t.part, "in": t.needed, "cost_rise": t.rise, "limit": t.limit} for t in c.trials],
        "correlations": [{"parameters": [a, b], "correlation": r} for a, b, r in c.correlations],
        "weakest_direction": [{"parameter": name, "share": share} for name, share in c.weakest],
        "suspects": [
            {"name": s.name, "amount": s.amount, "std": s.sigma, "sure": s.sure, "cost_drop": s.drop}
            for s in c.hypotheses
        ],
        **verdict_json(c),
    }


def _or_none(value: float) -> float | None:
    """Return None for NaN and infinity, which JSON lacks."""
    return value if np.isfinite(value) else None


Tables = list[tuple[str, Sequence[str], Sequence[Sequence[str]]]]
"""Title, header and rows of each table."""


def kinematic_tables(c: ChainCalibration, si: Any) -> Tables:
    """Return the parameters of a NAO."""
    sigma = np.sqrt(np.diag(c.covariance))
    rows = [
        (name, *with_std(c.fit.unknowns[i] / si[i], sigma[i] / si[i]), unit)
        for i in np.flatnonzero(c.problem.free)
        for name, unit in [_name_and_unit(c.names[i])]
    ]
    return [("Parameters", ("parameter", "value", "std", "unit"), rows)]


def _name_and_unit(name: str) -> tuple[str, str]:
    if name.endswith("_deg_per_Nm"):
        return name.removesuffix("_deg_per_Nm"), "deg/Nm"
    stem, _, unit = name.rpartition("_")
    return stem, unit


def with_std(value: float, std: float) -> tuple[str, str]:
    """Return a number and its standard deviation as text, with the same decimals.

    The deviation has two digits if its first is 1 or 2, else one.
    """
    if not 0.0 < std < np.inf:
        return f"{value:+.4f}", f"{std:.4f}"
    first = int(np.floor(np.log10(std)))
    figures = 2 if std < 3.0 * 10.0**first else 1
    decimals = max(figures - 1 - first, 0)
    return f"{value:+.{decimals}f}", f"{std:.{decimals}f}"


def hand_eye_tables(h: HandEye) -> Tables:
    """Return the poses and joint parameters of a hand-eye calibration."""
    (camera_m, camera_rad), (target_m, target_rad) = h.camera_sigma, h.target_sigma
    places = [
        (
            name,
            *(f"{1e3 * v:.3f}" for v in T[:3, 3]),
            f"{1e3 * float(np.linalg.norm(m)):.3f}",
            f"{np.degrees(float(np.linalg.norm(rad))):.4f}",
        )
        for name, T, m, rad in (
            ("camera in base", h.T_base_camera, camera_m, camera_rad),
            ("target in gripper", h.T_gripper_target, target_m, target_rad),
        )
    ]
    shown = [parameter for parameter in _joint_parameters(h) if parameter[-1].any()]
    joints = [
        (
            f"J{j + 1}",
            *(
                "+-".join(with_std(factor * values[j], factor * sigma[j])) if free[j] else "held"
                for _, _, factor, values, sigma, free in shown
            ),
        )
        for j in range(h.recording.dh.joints)
    ]
    return [
        ("Places", ("", "x mm", "y mm", "z mm", "std mm", "std deg"), places),
        ("Arm", ("joint", *(heading for _, heading, *_ in shown)), joints),
    ]


def print_hand_eye(h: HandEye, console: Console, more: Sequence[NextPose] = ()) -> None:
    """Print poses, joint offsets (zeros), link errors, the verdict, and further poses that would help most."""
    print_chain(h.chain, hand_eye_tables(h), console)
    if more:
        console.say(
            "poses that would help most (joints in deg; reduction of the predicted target's error, each together with "
            "those before it):"
        )
    for pose in more:
        shown = "  ".join(f"{q:7.1f}" for q in np.degrees(pose.joints))
        console.say(f"  {shown}   {100.0 * pose.gain:.0f} %")


def print_chain(
    c: ChainCalibration, tables: Tables, console: Console, images: Sequence[Numbers] = ()
) -> None:
    """Print the tables of results, how well the model fits the images, and the verdict; `images` as in `left_out`."""
    for _, header, rows in tables:
        console.table(header, rows)
        console.say()
    used = c.images - sum(map(len, c.wrong))
    x, y = c.problem.pixel_sigma
    console.say(f"images:      {used} of {c.images} used; noise of the corners {x:.3f} / {y:.3f} px (x / y)")
    if used < c.images:
        console.say(f"left out:    {numbers(left_out(c, images))} (images count from 0)")
    x, y = c.residual_std
    console.say(
        f"fit:         residuals {x:.3f} / {y:.3f} px, chi2/dof {c.fit.chi2_dof:.3f}, {c.iterations} steps in "
        f"{c.solve_s:.2f} s"
    )
    known = c.problem.reading_sigma if c.scattering is None else c.scattering.base
    step = float(np.degrees(known.max()))
    if step > 0.0:
        console.say(f"encoders:    {step:.4f} deg (one standard deviation), estimated from their readings")
    off = "more than 1 m" if c.held_out.metres > 1.0 else f"{1e3 * c.held_out.metres:.3f} mm"
    console.say(f"held out:    {c.held_out.px:.3f} px, {off} across the line of sight")
    print_verdict(c, console)
