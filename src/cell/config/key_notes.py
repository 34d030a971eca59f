"""What the files of a new cell say of every key: what to measure, in which unit, what happens if it is wrong.

The values are those of the project's own scenes; `cell.commands.new_cell` puts the two together.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

Notes = Mapping[str, str]
"""Of a file: by dotted key the comment above it, by a table's name the one above the table, "" at the head, and
``TABLE.*`` the lines that may be added below the table's keys, as they are."""

_OFFERED = re.compile(r"^# (\w+) +=", re.MULTILINE)


def known_keys(notes: Notes) -> frozenset[str]:
    """Dotted keys that a file may have, those that are only offered included."""
    plain = {key for key in notes if key and not key.endswith("*")}
    offered = {
        key.removesuffix("*") + name
        for key, lines in notes.items()
        if key.endswith("*")
        for name in _OFFERED.findall(lines)
    }
    return frozenset(plain | offered)


CELL: Notes = {
    "": (
        "The work cell {name}: what you know of it. Lengths in mm, angles in degrees, in the arm's base"
        " frame: x forward at J1 = 0, y to the left, z up, origin in the middle of the mounting plane. "
        "The values are those of a lab: measure yours. What a calibration finds better than a tape says"
        " so."
    ),
    "unit": (
        "Which arm: crs93 or crs97. Ask who keeps it: the controller cannot tell, and no command finds "
        "it. Wrong: joints are up to 11 degrees off."
    ),
    "camera": (
        "Lens and place of the camera. `a465 calibrate camera` finds the lens, `a465 calibrate hand-eye"
        " --apply` the place and the zeros of the arm's joints, and adds the key calibration below."
    ),
    "q_start_deg": (
        "J1 to J6 in degrees, where the arm stands while the camera looks. No board may be hidden from "
        "the camera, and nothing nearer than clearance_mm: `a465 check cell.toml --q=J1,J2,J3,J4,J5,J6`"
        " lists what is how near. Wrong: boards are not found, or the plan is refused with the two "
        "bodies that are too near."
    ),
    "*": """# arm_padding_mm = 10                # the arm's links are bodies of assumed size: this is taken off every
#                                    # distance to them. More than the error of any; see docs/real-cell.md, step 2
# arm_compared = ""                  # date and name of who compared the bodies with the arm; less padding needs it""",
    "tool": (
        "The gripper: a round body, a palm and two fingers. No command finds its lengths. The values are "
        "those of the shipped one. A gripper of another kind is described by a URDF: docs/new-cell.md."
    ),
    "tool.length_mm": (
        "From the flange's face to the finger tips, by calliper, to 0.2 mm. Wrong by 1 mm: the fingers "
        "go 1 mm deeper than was certified, or grip 1 mm higher."
    ),
    "tool.finger_mm": (
        "A finger as a box: across the way that it closes, along it, and its length from the palm to the "
        "tip; rounded up, but the last. Too small: it may touch a plate or the next cube."
    ),
    "tool.palm_mm": (
        "What the fingers stand on as a box, in the same directions; cables, screws and the motor "
        "included. Too small: it may touch a cube that is gripped deep, or a wall."
    ),
    "tool.body_radius_mm": (
        "Of the round body between flange and palm, rounded up; its length is what is left of length_mm."
    ),
    "tool.*": """# jaw_shut_mm = 0                    # between the fingers' inner faces when they are shut
# close_to_mm = 6                    # that the jaws are told to close to on a cube; they stop on it before
# force_v = 7.5                      # of the gripper's motor, 0.75 to 11.25: how hard it holds
# grip_tolerance_mm = 3              # by how much the jaws may stand wider or narrower on a cube than it is;
# beyond that they have not gripped it, which is told before the arm lifts""",
    "tool.jaw_opening_mm": (
        "Between the fingers' inner faces when open, to 0.5 mm. Wrong: open fingers are elsewhere than "
        "was certified and may touch the next cube, and the jaws close too far or not far enough."
    ),
    "tool.grip_height_mm": (
        "How far the finger tips stay above the plate's top when they grip a cube in its hole. You "
        "choose: lower holds better, higher stays away from the plate. Too low: the way into a hole is "
        "refused."
    ),
    "tool.settle_s": (
        "Seconds that are waited for the jaws at least. Watch them close once. Too short: the arm "
        "leaves with a cube that is not held yet."
    ),
    "cube.size_mm": (
        "Edge of the cubes, by calliper, to 0.2 mm. Wrong: holes are taken for full or empty that are "
        "not, and the jaws close too far or not far enough."
    ),
    "cube.*": """# size_tolerance_mm = 0.1            # by how much edges differ from that. Each is measured in its hole
# before it is moved; where that could not be done, a cube is confirmed at its place only if a height
# of some mm cannot be mistaken for a wider cube""",
    "boards.files": (
        "A CSV file for each board that may stand in the cell. Line 1: the ids of its two markers. "
        "Lines 2 to 5: x,y of a hole's centre in mm, from the centre of the marker with the lower id, "
        "along the plate's edges; by calliper, to 0.2 mm. Wrong by 1 mm: cubes are gripped and let go 1"
        " mm off; a hole forgives 2 mm. No command finds them."
    ),
    "boards.marker_size_mm": (
        "Edge of the markers' black square as printed, by calliper, to 0.1 mm: printers scale. Wrong by"
        " 1 mm: heights are 24 mm off; a look refuses a board whose markers say otherwise, and tells "
        "the size that fits."
    ),
    "boards.pocket_mm": (
        "Width of a pocket at its mouth and at its floor, 10 mm below, by calliper. A cube must wedge in "
        "it 8 mm deep, to 1 mm. Wrong: holes are unsure, or the jaws close too high or too low."
    ),
    "boards.made_within_mm": (
        "How well markers and holes are where the CSV says: two standard deviations, in x and in y; 0.1 of"
        " machined plates with markers laid in, 0.2 glued on by hand with a calliper. It is part of what "
        "a look says of its own error. Too small: errors are larger than is told."
    ),
    "boards.dictionary": (
        "Of the markers, by OpenCV's name: DICT_4X4_50, ..., DICT_APRILTAG_36h11. Wrong: none is found."
    ),
    "boards.tilts_deg": (
        "The angles at which your stands hold boards. Asked only where photographs alone do not tell a "
        "tilt from its mirror image. Leave it out if you do not know. Wrong: such a board may be taken "
        "for its mirror image."
    ),
    "boards.stand_size_mm": (
        "Footprint of a stand, x and y, under the plate's centre, rounded up. Too small: the arm may "
        "touch it."
    ),
    "boards.zone_centre_mm": (
        "Centre and size of the box in which boards may stand, plates and cubes included; by tape, "
        "rounded up by some cm. Until boards have been seen, all of it counts as occupied. Too small: "
        "the arm may touch a board before the first look. Too large: no way around it is found."
    ),
    "boards.zone_size_mm": "x, y and z.",
    "table": "The table that the arm stands on. By tape, to 2 mm; sizes rounded up.",
    "table.centre_mm": "x and y of the middle of its top.",
    "table.size_mm": "Along x and y.",
    "table.top_z_mm": (
        "Height of its top above the arm's mounting plane, to 1 mm; negative if it is below. Too low: "
        "the arm may touch the table. Too high: holes seem to lie below it, which a plan refuses and "
        "names."
    ),
    "table.thickness_mm": "Of the top.",
    "walls": (
        "Walls, posts, boxes, a cage: [[walls]] for each thing that the arm could reach, by tape, sizes"
        " rounded up by the tape's error. What is missing here can be hit: nothing else knows of it. "
        "Also cylinders, balls, capsules and meshes (docs/scenes.md)."
    ),
    "walls.name": "Any, but two things may not share it; refusals use it.",
    "walls.centre_mm": "Of the box.",
    "walls.size_mm": "Along x, y and z.",
    "look.photographs": "To a look. More of them average the camera's noise.",
    "look.moved_mm": (
        "A board of which any point moved more than this since the last look, or that turned more than "
        "moved_deg, makes the rest be planned anew. Less goes unnoticed, so every distance to boards "
        "and cubes is taken as this much shorter. Too small: what the camera sees differs that much "
        "from look to look, and runs stop. Too large: the ways into holes are refused."
    ),
    "look.moved_deg": "Degrees.",
    "look.*": """# least_certain_mm = 0.6             # boards that are less certain are refused: sideways,
# least_certain_height_mm = 2.0      # in height,
# least_certain_deg = 1.0            # and in turn; standard deviations

# [look.basler]                      # the real cell's camera; docs/cameras.md. `a465 doctor` lists those that are there
# device = "name:MY-CAMERA"          # or serial:NUMBER, ip:ADDRESS
# exposure_us = 8000                 # a look tells if photographs are too bright or too dark
# gain_db = 0""",
    "motion.offset_mm": "Length of the straight way into and out of a hole, along the board's normal.",
    "motion.clearance_mm": (
        "That transits keep from everything, at least 5 (or least_clearance_mm). Add the error of your tape "
        "and of your calibration. Too much: no way is found, and the refusal says where."
    ),
    "motion.speed": (
        "More than 0 to 1: velocities times speed, accelerations times its square. --speed is for one "
        "command: begin with --speed 0.1 on a real arm."
    ),
    "motion.approach_mm_s": "Speed of the finger tips into and out of a hole, at speed 1.",
    "motion.*": """# rest_tolerance_counts = 25         # by which an axis may rest from where it was sent; at more
# a run stops, and tells what was read. One public recording has 93 to 220 on J1. In no certificate
# velocity_fraction = 0.9            # of the limits that motion is planned for; the rest is for
# acceleration_fraction = 0.5        # rounding, and for what the controller adds where segments join
# least_clearance_mm = 5.0           # that clearance_mm may be; less is told wherever a plan is shown
# jerk_time_s = 0.0                  # s in which an acceleration builds up; the arm then rests at every corner
# speed_registers = [...]            # of the controller, six whole numbers; up to twice the unit's default,
# acceleration_registers = [...]     # never past the data sheet""",
}

CAMERA: Notes = {
    "": (
        "PLACEHOLDER: the nominal lens and place of a lab's camera, not of yours. Good for the "
        "simulated cell. Pixels, and metres in the pose. `a465 calibrate camera` finds your lens, with "
        "its uncertainty, and writes a file like this without [pose]."
    ),
    "intrinsics": "The lens. Wrong by 1 %: all is 1 % nearer or farther than it seems, 12 mm at 1.2 m.",
    "intrinsics.size_px": "Width and height of the photographs. A photograph of another size is refused.",
    "intrinsics.K_px": "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]",
    "intrinsics.distortion_k1k2p1p2k3": "As OpenCV has it.",
    "pose": (
        "Where the camera is in the base frame, 4 x 4, m. The columns: where the image's right, the "
        "image's down and the line of sight point, and where the lens is. By tape, to some cm and "
        "degrees, so that the arm can show the camera a target; then `a465 calibrate hand-eye` finds "
        "it, to tenths of a mm. Wrong by 1 mm before that: every grip is 1 mm off."
    ),
    "pose.T_base_camera": "Any turn that is nearly one is made one.",
    "calibration": "For people.",
    "calibration.id": "Where the values are from.",
}

HAND: Notes = {
    "": (
        "The target that the gripper holds for `a465 calibrate hand-eye --collect`: a ChArUco board on "
        "a stiff flat plate."
    ),
    "kind": "charuco: a chessboard with markers in its white squares.",
    "squares": "Along x and y.",
    "square_mm": (
        "Edge of a square as printed: measure over all of them and divide, to 0.02 mm. It decides all "
        "lengths: 1 % wrong, and all is 1 % too near; the calibration names it if it can."
    ),
    "marker_mm": "Edge of a marker's black square.",
    "dictionary": "By OpenCV's name; another one than the boards'.",
    "hand": (
        "How the gripper holds it, to some cm and ten degrees: the calibration finds the rest. Wrong by"
        " more: the target is not seen where it should be, which is told."
    ),
    "hand.centre_mm": "Of the printed side, from the middle of the flange's face, in its directions.",
    "hand.rpy_deg": "Of the printed side: x along its columns, y down its rows, z into the plate.",
    "hand.plate_mm": (
        "The plate along x and y of the print, and its thickness. The plate counts as part of the arm: "
        "too small, and it may touch something."
    ),
}

_TASK: Notes = {
    "task": "board-to-board, or clear-board: to the table.",
    "cell": "Its cell file.",
    "from_board": "The two marker ids of the board that holds the cubes.",
    "look_after": "Look again after each cube, or never, or 2: after every second one.",
    "order": "Which cube is next. free: chosen for time; given: as the holes are numbered.",
    "assignment": "Which free place it goes to. free: chosen for time; given: the next one.",
    "seed": "Of every random choice. The same seed gives the same plan, byte for byte.",
}

TASK1: Notes = {
    **_TASK,
    "": "Task 1: clear four cubes off a flat board to free places on the table.",
    "board_height_mm": (
        "Of the plate's top above the table, by calliper, to 1 mm. What is seen must agree, or the look"
        " is refused."
    ),
    "places": "Cubes go to free places of a grid on the table.",
    "places.origin_mm": "x and y of its first place, in the base frame.",
    "places.step_mm": "To the next place along x, and along y.",
    "places.count": (
        "Along x and y: at least four places. Those that cannot be reached, or that a board covers, are"
        " left out; with too few the plan is refused."
    ),
    "places.yaw_deg": "Of a cube there.",
}

TASK2: Notes = {
    **_TASK,
    "": "Task 2: move four cubes from one board to another.",
    "to_board": "The two marker ids of the board that gets them.",
}

WORLD: Notes = {
    "": (
        "The truth of the simulated cell, for rehearsals. Nothing else reads it, so there is nothing to"
        " measure: on the real cell boards may stand anywhere in the zone. Its arm and camera are as "
        "their own files say, so a rehearsal with the calibration of a real arm misses by what that "
        "found: rehearse with a copy of the cell file without the key calibration."
    ),
    "seed": "Of noise, and of where the arm is when it is switched on.",
    "noise_grey": "Standard deviation of the camera's noise, grey levels.",
    "boards": "A board that stands in the cell.",
    "boards.file": "One of those of the cell file.",
    "boards.centre_mm": "Of the plate's top.",
    "boards.yaw_deg": "Its turn about the vertical.",
    "boards.tilt_deg": "Of the plate.",
    "boards.lean_azimuth_deg": "Direction in which its normal leans.",
    "boards.cubes": "Holes, 1 to 4, that hold a cube.",
}
