"""Comments for every key of a new cell's files: what to measure, in which unit, and what a wrong value causes.

The values come from the project's own scenes; `cell.commands.new_cell` combines the two.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

Notes = Mapping[str, str]
"""Comments of a file: by dotted key for the line above the key, by table name for the line above the table, "" for the
head of the file, and ``TABLE.*`` for optional lines that are written verbatim below the table's keys."""

_OFFERED = re.compile(r"^# (\w+) +=", re.MULTILINE)


def known_keys(notes: Notes) -> frozenset[str]:
    """Return the dotted keys that a file may have, including those that appear only as optional lines."""
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
        "The work cell {name}: its measured values. Lengths in mm, angles in degrees, in the arm's base frame: x "
        "forward at J1 = 0, y to the left, z up, origin in the middle of the mounting plane. The values are those of "
        "a lab: replace them with your own. Values that a calibration finds better than a tape are marked."
    ),
    "unit": (
        "The arm: crs93 or crs97. Ask who maintains it: the controller cannot report it, and no command can find it. "
        "If wrong, joints are up to 11 degrees off."
    ),
    "camera": (
        "File with the camera's lens and pose. `a465 calibrate camera` finds the lens; `a465 calibrate hand-eye "
        "--apply` finds the pose and the arm's joint offsets (zeros), and adds the key calibration below."
    ),
    "q_start_deg": (
        "J1 to J6 in degrees, the configuration for looks. The arm must hide no board from the camera, and keep "
        "clearance_mm from everything: `a465 check cell.toml --q=J1,J2,J3,J4,J5,J6` lists the closest bodies. If "
        "wrong, boards are not detected, or the plan is refused with the names of the two bodies that are too close."
    ),
    "*": """# arm_padding_mm = 10                # subtracted from every distance to the arm's links, whose shapes are
#                                    # assumed; must exceed their error. See docs/real-cell.md, step 2
# arm_compared = ""                  # date and name of who compared them with the arm; needed for less padding""",
    "tool": (
        "The gripper: a round body, a palm and two fingers. No command can measure it. The values are those of the "
        "shipped gripper. Another kind of gripper is described by a URDF: see docs/new-cell.md."
    ),
    "tool.length_mm": (
        "Distance from the flange to the finger tips. Measure by calliper, to 0.2 mm. If wrong by 1 mm, the fingers "
        "go 1 mm deeper than certified, or grip 1 mm higher."
    ),
    "tool.finger_mm": (
        "Box around a finger: across the closing direction, along it, and the length from palm to tip. Round up, "
        "except the length. If too small, a finger may touch a plate or the next cube."
    ),
    "tool.palm_mm": (
        "Box around the palm, in the same directions, including cables, screws and the motor. If too small, it may "
        "touch a deeply gripped cube or a wall."
    ),
    "tool.body_radius_mm": (
        "Radius of the round body between flange and palm, rounded up; its length is the remainder of length_mm."
    ),
    "tool.*": """# jaw_shut_mm = 0                    # distance between the fingers' inner faces when shut
# close_to_mm = 6                    # commanded jaw opening for gripping; the jaws stop earlier, on the cube
# force_v = 7.5                      # voltage of the gripper's motor, 0.75 to 11.25: the gripping force
# grip_tolerance_mm = 3              # largest difference between jaw opening and cube; beyond it the grip has failed,
# which is reported before the arm lifts""",
    "tool.jaw_opening_mm": (
        "Distance between the fingers' inner faces when open, to 0.5 mm. If wrong, the open fingers are not where "
        "they were certified and may touch the next cube, and the jaws close too far or not far enough."
    ),
    "tool.grip_height_mm": (
        "Height of the finger tips above the plate's top when they grip a cube in its hole. Your choice: lower holds "
        "better, higher stays clear of the plate. If too low, the approach into a hole is refused."
    ),
    "tool.settle_s": (
        "Least time for the jaws to act, in seconds. Watch them close once. If too short, the arm leaves before the "
        "cube is held."
    ),
    "cube.size_mm": (
        "Edge of the cubes. Measure by calliper, to 0.2 mm. If wrong, full holes may be classified as empty or empty "
        "ones as full, and the jaws close too far or not far enough."
    ),
    "cube.*": """# size_tolerance_mm = 0.1            # largest deviation of an edge. Each cube is measured in its hole
# before it is moved. If that fails, the cube is confirmed at its destination only if a height error of some
# mm cannot be mistaken for a wider cube""",
    "boards.files": (
        "A CSV file for each board that may stand in the cell. Line 1: the ids of its two markers. Lines 2 to 5: x,y "
        "of a hole's centre in mm, from the centre of the marker with the lower id, along the plate's edges. Measure "
        "by calliper, to 0.2 mm. If wrong by 1 mm, cubes are gripped and released 1 mm off; a hole tolerates 2 mm. No "
        "command can measure this."
    ),
    "boards.marker_size_mm": (
        "Edge of the markers' black square as printed (printers scale). Measure by calliper, to 0.1 mm. If wrong by 1 "
        "mm, heights are 24 mm off; a look refuses boards whose markers disagree, and reports the size that fits."
    ),
    "boards.pocket_mm": (
        "Width of a pocket at its mouth and at its floor, 10 mm below, by calliper. A cube must wedge in it 8 mm "
        "deep, within 1 mm. If wrong, the state of holes is unsure, or the jaws close too high or too low."
    ),
    "boards.made_within_mm": (
        "Manufacturing tolerance of markers and holes relative to the CSV: two standard deviations, in x and in y. "
        "0.1 for machined plates with inlaid markers, 0.2 for markers glued on by hand with a calliper. It enters the "
        "stated uncertainty of a look. If too small, errors exceed the stated uncertainty."
    ),
    "boards.dictionary": (
        "The markers' dictionary, by OpenCV's name: DICT_4X4_50, ..., DICT_APRILTAG_36h11. If wrong, no marker is "
        "found."
    ),
    "boards.tilts_deg": (
        "Angles at which your stands hold boards. Used only where images do not distinguish a tilt from its mirror "
        "image. Leave it out if unknown. If wrong, such a board may be detected as its mirror image."
    ),
    "boards.stand_size_mm": (
        "Footprint of a stand under the plate's centre, x and y, rounded up. If too small, the arm may touch it."
    ),
    "boards.zone_centre_mm": (
        "Centre of the box in which boards may stand, plates and cubes included. Measure by tape, and round the size "
        "up by some cm. Until boards are detected, the whole box counts as occupied. If too small, the arm may touch "
        "a board before the first look; if too large, no motion around it is found."
    ),
    "boards.zone_size_mm": "Size of that box: x, y and z.",
    "table": "The table that the arm stands on. Measure by tape, to 2 mm; round sizes up.",
    "table.centre_mm": "x and y of the middle of its top.",
    "table.size_mm": "Size of its top along x and y.",
    "table.top_z_mm": (
        "Height of its top above the arm's mounting plane, to 1 mm; negative if below. If too low, the arm may touch "
        "the table. If too high, holes seem to lie below it; the plan is refused and names them."
    ),
    "table.thickness_mm": "Thickness of its top.",
    "walls": (
        "Walls, posts, boxes, a cage: one [[walls]] for each thing within the arm's reach. Measure by tape, and round "
        "sizes up by the tape's error. The arm can hit anything that is missing here. Cylinders, spheres, capsules "
        "and meshes are possible too (docs/scenes.md)."
    ),
    "walls.name": "Any unique name; refusals mention it.",
    "walls.centre_mm": "Centre of the box.",
    "walls.size_mm": "Size along x, y and z.",
    "look.photographs": "Number of images per look. More of them average the camera's noise.",
    "look.moved_mm": (
        "If any point of a board moved by more than this since the last look, or the board rotated by more than "
        "moved_deg, the rest is replanned. Less goes unnoticed, so it is subtracted from every distance to boards and "
        "cubes. If too small, runs stop because looks differ that much; if too large, the approaches into holes are "
        "refused."
    ),
    "look.moved_deg": "Rotation in degrees.",
    "look.*": """# least_certain_mm = 0.6             # boards with larger standard deviations are refused: sideways,
# least_certain_height_mm = 2.0      # in height,
# least_certain_deg = 1.0            # and in rotation

# [look.basler]                      # camera of the real cell; docs/cameras.md. `a465 doctor` lists those connected
# device = "name:MY-CAMERA"          # or serial:NUMBER, ip:ADDRESS
# exposure_us = 8000                 # a look reports images that are too bright or too dark
# gain_db = 0""",
    "motion.offset_mm": "Length of the straight approach and retract, along the board's normal.",
    "motion.clearance_mm": (
        "Clearance of transits from everything, at least 5 (or least_clearance_mm). Add the error of your tape and of "
        "your calibration. If too large, no motion is found, and the refusal names the place."
    ),
    "motion.speed": (
        "From 0.01 to 1: scales velocities, and accelerations with its square. --speed overrides it for one "
        "command: start with --speed 0.1 on a real arm."
    ),
    "motion.approach_mm_s": "Speed of the finger tips in approach and retract, at speed 1.",
    "motion.*": """# rest_tolerance_counts = 25         # largest error of an axis at rest; beyond it a run stops and
# reports what was read. One public recording has 93 to 220 on J1. No certificate includes it
# velocity_fraction = 0.9            # fractions of the limits that plans use; the rest is for
# acceleration_fraction = 0.5        # rounding, and for what the controller adds where segments join
# least_clearance_mm = 5.0           # smallest value allowed for clearance_mm; less is noted wherever a plan is shown
# jerk_time_s = 0.0                  # time in which an acceleration builds up, s; the arm then stops at every corner
# speed_registers = [...]            # of the controller, six integers; up to twice the unit's default,
# acceleration_registers = [...]     # within the data sheet""",
}

CAMERA: Notes = {
    "": (
        "PLACEHOLDER: nominal lens and pose of a lab's camera, not of yours; good for the simulated cell. Pixels; "
        "metres in the pose. `a465 calibrate camera` finds your lens with its uncertainty, and writes a file like "
        "this without [pose]."
    ),
    "intrinsics": "The lens. If wrong by 1 %, everything seems 1 % nearer or farther: 12 mm at 1.2 m.",
    "intrinsics.size_px": "Width and height of the images. An image of another size is refused.",
    "intrinsics.K_px": "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]",
    "intrinsics.distortion_k1k2p1p2k3": "Distortion coefficients in OpenCV's order.",
    "pose": (
        "Pose of the camera in the base frame, 4 x 4, m. Columns: directions of the image's right, the image's down "
        "and the line of sight, and the position of the lens. Measure by tape, to some cm and degrees, so that the "
        "arm can show the camera a target; `a465 calibrate hand-eye` then finds it to tenths of a mm. If wrong by 1 "
        "mm, every grip is 1 mm off."
    ),
    "pose.T_base_camera": "A rotation that is not quite orthogonal is corrected.",
    "calibration": "For information only.",
    "calibration.id": "Source of the values.",
}

HAND: Notes = {
    "": (
        "The target that the gripper holds for `a465 calibrate hand-eye --collect`: a ChArUco board on a stiff flat "
        "plate."
    ),
    "kind": "charuco: a chessboard with markers in its white squares.",
    "squares": "Number of squares along x and y.",
    "square_mm": (
        "Edge of a square as printed: measure over all of them and divide, to 0.02 mm. It scales all lengths: if 1 % "
        "wrong, everything is 1 % too near. The calibration reports this if it can."
    ),
    "marker_mm": "Edge of a marker's black square.",
    "dictionary": "The markers' dictionary, by OpenCV's name; must differ from the boards'.",
    "hand": (
        "How the gripper holds it, to some cm and ten degrees: the calibration finds the rest. If wrong by more, the "
        "target is not detected where it should be, which is reported."
    ),
    "hand.centre_mm": "Centre of the printed side, in the flange frame.",
    "hand.rpy_deg": "Orientation of the printed side: x along its columns, y down its rows, z into the plate.",
    "hand.plate_mm": (
        "Size of the plate along x and y of the print, and its thickness. The plate counts as part of the arm: if too "
        "small, it may touch something."
    ),
}

_TASK: Notes = {
    "task": "board-to-board, or clear-board: to the table.",
    "cell": "Its cell file.",
    "from_board": "The two marker ids of the board that holds the cubes.",
    "look_after": "Look again after each cube, never, or 2: after every second cube.",
    "order": "Order of the cubes. free: chosen for time; given: as the holes are numbered.",
    "assignment": "Destinations of the cubes. free: chosen for time; given: the next one.",
    "seed": "Seed of every random choice. The same seed gives the same plan, byte for byte.",
}

TASK1: Notes = {
    **_TASK,
    "": "Task 1: clear four cubes off a flat board to free places on the table.",
    "board_height_mm": (
        "Height of the plate's top above the table, by calliper, to 1 mm. A look that disagrees with it is refused."
    ),
    "places": "Grid of places for cubes on the table.",
    "places.origin_mm": "x and y of its first place, in the base frame.",
    "places.step_mm": "Step to the next place along x, and along y.",
    "places.count": (
        "Number of places along x and y: at least four in total. Places that are out of reach or covered by a board "
        "are skipped; if too few remain, the plan is refused."
    ),
    "places.yaw_deg": "Yaw of a cube there.",
}

TASK2: Notes = {
    **_TASK,
    "": "Task 2: move four cubes from one board to another.",
    "to_board": "The two marker ids of the board that receives the cubes.",
}

WORLD: Notes = {
    "": (
        "Ground truth of the simulated cell, for rehearsals. The real cell does not use it, so there is nothing to "
        "measure: there, boards may stand anywhere in the zone. The simulated arm and camera are nominal, so a "
        "rehearsal with the calibration of a real arm misses by the calibrated errors: rehearse with a copy of the "
        "cell file without the key calibration."
    ),
    "seed": "Seed of the noise, and of the arm's configuration at power-up.",
    "noise_grey": "Standard deviation of the camera's noise, grey levels.",
    "boards": "A board that stands in the cell.",
    "boards.file": "One of the board files of the cell file.",
    "boards.centre_mm": "Centre of the plate's top.",
    "boards.yaw_deg": "Rotation about the vertical.",
    "boards.tilt_deg": "Tilt of the plate.",
    "boards.lean_azimuth_deg": "Azimuth towards which its normal leans.",
    "boards.cubes": "Holes, 1 to 4, that hold a cube.",
}
