"""What is known of the arm's own shape, in words: its bodies are assumed until somebody compared them with the arm."""

from __future__ import annotations

from cell.config.cell import Cell

COMPARE = "docs/real-cell.md, step 2, tells how to compare these bodies with your arm"


def arm_shape(cell: Cell) -> str:
    """One line: whose comparison the arm's bodies rest on, and by what its links are padded."""
    padded = f"links padded by {1e3 * cell.arm_padding:g} mm, the gripper not"
    if cell.arm_compared.strip():
        return f"the arm's bodies were compared with the arm ({cell.arm_compared.strip()}): {padded}"
    return f"the arm's shape is assumed, nobody has compared it with the arm: {padded}"
