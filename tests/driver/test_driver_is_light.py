"""What the driver rests on."""

from __future__ import annotations

import subprocess
import sys


def test_the_driver_knows_no_kinematics() -> None:
    code = (
        "import sys, driver.execution.execute, driver.line.wire_log\n"
        "heavy = {'pinocchio', 'coal', 'arm.robot.model', 'cv2', 'toppra'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
