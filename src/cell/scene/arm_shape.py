"""State in words whether the arm's assumed bodies were compared with the arm."""

from __future__ import annotations

from cell.config.cell import Cell

COMPARE = "docs/real-cell.md, step 2, explains how to compare these bodies with your arm"


def arm_shape(cell: Cell) -> str:
    """One line: who compared the arm's bodies, and the padding of its links."""
    padded = f"links padded by {1e3 * cell.arm_padding:g} mm, the gripper not"
    if cell.arm_compared.strip():
        return f"the arm's bodies were compared with the arm ({cell.arm_compared.strip()}): {padded}"
    return f"the arm's shape is assumed, nobody has compared it with the arm: {padded}"
