"""Keys of the world file that make the simulated cell as imperfect as a real one; by default it is ideal.

`docs/simulated-cell.md` has what a real cell measures for each of them.
"""

from __future__ import annotations

from arm.io.keys import Keys, key
from arm.io.rules import number, numbers
from arm.se3 import Array


class ImageKeys(Keys):
    """Keys of ``[image]``: the camera's motion and its images."""

    sway: float = key("image.sway_px", number("px", 0, 20), 0)
    sway_turn: float = key("image.sway_turn_deg", number("deg", 0, 1), 0)
    drift: float = key("image.drift_px", number("px", 0, 50), 0)
    turned: Array = key("image.turned_deg", numbers(3, "deg", -10, 10), [0] * 3)
    corner_scatter: float = key("image.corner_scatter_px", number("px", 0, 5), 0)
    blur: float = key("image.blur_px", number("px", 0, 10), 0.7)
    exposure: float = key("image.exposure", number("", 0.05, 20), 1)
    exposure_scatter: float = key("image.exposure_scatter", number("", 0, 1), 0)
    gamma: float = key("image.gamma", number("", 0.2, 5), 1)
    gradient: Array = key("image.gradient", numbers(2, "", -0.9, 0.9), [0, 0])


class TableKeys(Keys):
    """Keys of ``[table]``: the look of the table's top."""

    grain: float = key("table.grain_grey", number("grey levels", 0, 50), 0)
    stain: float = key("table.stain_grey", number("grey levels", 0, 50), 0)
    specks: float = key("table.specks_per_m2", number("", 0, 10000), 0)
    scratches: float = key("table.scratches_per_m2", number("", 0, 10000), 0)


class PrintKeys(Keys):
    """Keys of ``[print]``: markers and calibration targets as printed and glued."""

    black: float = key("print.black_grey", number("grey levels", 0, 255), 22)
    white: float = key("print.white_grey", number("grey levels", 0, 255), 235)
    spread: float = key("print.spread_mm", number("mm", 0, 2), 0)
    border: float = key("print.border_mm", number("mm", 0, 2), 0)
    print_scale: float = key("print.scale", number("", 0.9, 1.1), 1)
    warp: float = key("print.warp_mm", number("mm", 0, 2), 0)
    glued: float = key("print.glued_mm", number("mm", 0, 10), 0)
    glued_turn: float = key("print.glued_deg", number("deg", 0, 10), 0)


class MadeKeys(Keys):
    """Keys of ``[made]``: sizes and positions of what a workshop made."""

    hole: float = key("made.hole_mm", number("mm", 0, 5), 0)
    pocket: float = key("made.pocket_mm", number("mm", 0, 1), 0)
    cube: float = key("made.cube_mm", number("mm", 0, 1), 0)


class ArmKeys(Keys):
    """Keys of ``[arm]``: what the encoders do not read."""

    scatter: Array = key("arm.scatter_deg", numbers(6, "deg", 0, 1), [0] * 6)
    eccentricity: Array = key("arm.eccentricity_deg", numbers(6, "deg", 0, 1), [0] * 6)
    sag: Array = key("arm.sag_deg", numbers(2, "deg", 0, 2), [0] * 2)
    backlash: Array = key("arm.backlash_deg", numbers(6, "deg", 0, 2), [0] * 6)
    warm_up: Array = key("arm.warm_up_deg", numbers(6, "deg", -2, 2), [0] * 6)
    warm_up_s: float = key("arm.warm_up_s", number("s", 1, 1e6), 1800)


class ToolKeys(Keys):
    """Keys of ``[tool]``: a tool without jaws as it truly is."""

    tool_off: Array = key("tool.off_mm", numbers(3, "mm", -50, 50), [0] * 3)
    tool_turned: Array = key("tool.turned_deg", numbers(3, "deg", -20, 20), [0] * 3)
    ring: Array | None = key("tool.ring_mm", numbers(3, "mm", 0.5, 1000), None)


class WorkKeys(Keys):
    """Keys of ``[work]``: where the workpiece of a program truly is."""

    work_off: Array = key("work.off_mm", numbers(3, "mm", -50, 50), [0] * 3)
    work_turned: Array = key("work.turned_deg", numbers(3, "deg", -20, 20), [0] * 3)


class ContactKeys(Keys):
    """Keys of ``[contact]``: what contact physics needs to know; all are assumed."""

    jaw_friction: float = key("contact.jaw_friction", number("", 0.05, 2), 0.8)
    friction: float = key("contact.friction", number("", 0.05, 2), 0.2)
    stand_friction: float = key("contact.stand_friction", number("", 0.05, 2), 0.8)
    jaw_force: float = key("contact.jaw_force_n", number("N", 1, 100), 20)
    cube_mass: float = key("contact.cube_mass_kg", number("kg", 0.005, 2), 0.04)
    plate_mass: float = key("contact.plate_mass_kg", number("kg", 0.05, 20), 0.4)
    servo_share: float = key("contact.servo_share", number("", 0, 1), 1)
    hand_stiffness: float = key("contact.hand_stiffness_n_mm", number("N/mm", 1, 200), 20)
