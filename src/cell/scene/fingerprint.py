"""The fingerprint of a plan's inputs: what must be as it was when the plan is executed."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from arm.io.storage import sha256
from cell.files.task import Task

NO_CALIBRATION = "none"  # in place of the name of a calibration


def plan_fingerprint(task: Task) -> dict[str, Any]:
    """Fingerprint of a plan's inputs: hashes, and task and cell file key by key, compared before execution.

    `notes` are not compared (`arm.plan_file.Plan.notes`).
    """
    cell = task.cell
    registers = {"speed": list(cell.speed_registers), "acceleration": list(cell.acceleration_registers)}
    return {
        "notes": {"a465": version("a465")},
        "limits": sha256({"unit": cell.unit.digest, **registers}),
        "calibration": cell.camera.digest,
        "calibration_id": cell.calibration.id if cell.calibration is not None else NO_CALIBRATION,
        "task": task.digest,
        "inputs": {"task": dict(task.inputs), "cell": dict(cell.inputs)},
        "seed": task.seed,
    }
