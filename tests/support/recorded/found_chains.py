"""What is told of calibrated chains, and heard."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.se3 import frozen
from calib.chain.result import ChainCalibration
from calib.hand_eye.calibrate import HandEye
from calib.hand_eye.next_poses import NextPose
from cell.commands.calibration.chain import ChainOptions, hand_eye_step, kinematic_step
from cell.console import Console

Step = Callable[[Path, ChainOptions, Console], dict[str, Any]]


def refused(found: HandEye) -> HandEye:
    return replace(found, chain=replace(found.chain, reasons=("too far off",)))


MORE = [NextPose(frozen(np.radians([10.0, -20.0, 30.0, 40.0, -50.0, 60.0])), 0.25)]


def nao_named(c: ChainCalibration) -> tuple[ChainCalibration, np.ndarray]:
    """The same numbers under names as a NAO's are, and their units in SI."""
    names = [f"P{i}_mm" if i % 2 else f"P{i}_deg" for i in range(len(c.names))]
    names[2] = "P2_compliance_deg_per_Nm"
    si = np.array([1e-3 if name.endswith("_mm") else np.pi / 180.0 for name in names])
    return replace(c, names=tuple(names)), si


STEPS = pytest.mark.parametrize("step", [hand_eye_step, kinematic_step])
