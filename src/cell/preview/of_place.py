"""``a465 view``: a cell, task, program or arm file as a page, with no plan: the arm at rest among the bodies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from arm.arguments import option_numbers
from arm.board import Board
from arm.controller.segments import CountPath, Segment
from arm.errors import ImpossibleError, InputError
from arm.io.outputs import keep_page
from arm.io.storage import keep_unread
from arm.numerics.products import mul
from arm.plan_file import Move, Plan
from arm.se3 import Array, transform
from cell.config.arm_file import ArmFile
from cell.config.doubts.angles import doubt_of_deg
from cell.console import Console
from cell.files.observation import read_observation
from cell.files.task import task_or_cell
from cell.preview.overlays import Refused
from cell.preview.page import Drawn, write_preview
from cell.program.planning import program_scene
from cell.program.program_file import ProgramTask, place_of_file
from cell.scene.build import build_scene
from cell.task.pose_list_planning import place_of_arm
from plan.collision.world import World
from plan.failure import nearness
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentState
from plan.program.planned import Planned
from plan.program.setting import Setting
from plan.trajectory.virtual_unit import is_virtual
from vision.camera.frame_source import read_grey
from vision.camera.model import Image
from vision.observation import Observation

LEAST_CONTRAST = 8  # between the darkest and the brightest pixel of a photograph, of 255
KINDS = ("task", "program", "arm", "camera", "q_start_deg")  # keys, of which each file has one
REST_MS = 1000  # that the page shows


def view_step(
    file: Path,
    look: Path | None,
    angles: str | None,
    output: Path | None,
    console: Console,
    image: Path | None = None,
) -> dict[str, Any]:
    """Write the page of a place, by default beside its file, and return a summary as JSON types.

    Args:
        file: cell, task, program or arm file.
        look: detected boards and cubes to add.
        angles: where the arm is: numbers with commas, deg; of an arm without a unit rad, m where a joint slides.
            Default: q_start.
        output: page to write.
        console: for what is said.
        image: photograph of the cell's camera.

    Raises:
        InputError: a file or value is wrong, or the photograph is of another size than the camera's.
        ImpossibleError: the workpiece of a program is on a board, and there is no look with it.
    """
    output = output or Path(f"{file.stem or 'view'}.html")  # . and / have no stem; they are told below
    keep_page(output, file, look, image)
    keep_unread(output)
    setting, drawn, q_start, _ = place_shown(file, look)
    if image is not None:
        drawn["photograph"] = photograph_for(drawn, image, file)
    q = q_start if angles is None else _configuration(setting, angles)
    if angles is not None and not is_virtual(setting.unit) and (doubt := doubt_of_deg(q, setting.unit)):
        console.say(f"NOTE: --q {doubt}")
    for doubt in place_of_file(file).doubts():
        console.say(f"NOTE: {doubt}")
    closest = world_of(setting).distance(q)
    if closest.value <= 0.0:
        drawn["refused"] = Refused(nearness(closest.pair, closest.value, 0.0), 0.0, closest.pair)
    plan = resting(setting, q, "at q_start" if angles is None else "at the given angles", file.stem)
    robots = setting.scene.robot_open, setting.scene.robot_holding
    write_preview(plan, *robots, setting.unit, output, **drawn)
    seen = " - ".join(closest.pair)
    console.say(
        f"closest at {'q_start' if angles is None else 'these angles'}: {seen}, {1e3 * closest.value:.1f} mm"
    )
    console.say(f"open {output} in a browser")
    return {"page": str(output), "closest": list(closest.pair), "distance_mm": 1e3 * closest.value}


def photograph_for(drawn: Drawn, image: Path, file: Path) -> Image:
    """Read a photograph by the camera of what is drawn.

    Raises:
        InputError: there is none (`file` is named), or the photograph cannot be read, is of another size or shows
            nothing.
    """
    camera = drawn.get("camera")
    if camera is None:
        raise InputError(f"--image goes with a cell that has a camera ({file})", option="--image")
    photograph = read_grey(image)
    camera.require_size(photograph, str(image))
    low, high = int(photograph.min()), int(photograph.max())
    if high - low < LEAST_CONTRAST:
        why = f"{image}: shows nothing: all its grey values are from {low} to {high} of 0 to 255"
        raise InputError(f"{why}; is the lens covered, or the exposure wrong?", path=str(image))
    return photograph


def world_of(setting: Setting) -> World:
    """Return the arm with open jaws among all that is shown."""
    return World(setting.robot, (*setting.scene.bodies, *setting.scene.cubes))


def resting(setting: Setting, q: Array, step: str, name: str) -> Plan:
    """Return a plan in which the arm rests at q (n,) for `REST_MS`, for a page: named, and its step too."""
    closest = world_of(setting).distance(q)
    counts = tuple(setting.unit.counts(q).tolist())
    rest = CountPath(counts, (Segment(REST_MS, ((0,) * len(counts),) * 3),))
    move = Move(step, "transit", None, rest, None, 0.0, max(closest.value, 0.0), closest.pair)
    nothing = AttachmentState(None, None, ())
    return Planned(setting, q, q, (move,), (), 0.0, nothing, task={"name": name}).plan()


class Shown(NamedTuple):
    """A place that is shown: the arm among its bodies, what else is drawn, q_start, and boards and holes by name."""

    setting: Setting
    drawn: Drawn
    q_start: Array
    known: Mapping[str, Array]


def place_shown(file: Path, look: Path | None, whole: bool = True) -> Shown:
    """Return what a cell, task, program or arm file describes, and what was detected.

    Without `whole`, the workpiece of a program is left out where it cannot be placed.
    """
    root = task_or_cell(file)
    if not any(name in root for name in KINDS):
        raise root.error("must be a cell, task, program or arm file", "a scene file is for a465 check")
    place = place_of_file(file)
    if isinstance(place, ArmFile):
        if look is not None:
            raise InputError(f"--look does not go with an arm file ({file})", option="--look")
        arm = place_of_arm(place, place.speed)
        setting = Setting(arm.scene, arm.unit, arm.limits, arm.options)
        return Shown(setting, Drawn(resting=True), arm.q_start, {})
    cell = place.cell
    seen = Observation() if look is None else read_observation(look, cell)
    try:
        scene = program_scene(place, seen) if isinstance(place, ProgramTask) else build_scene(cell, seen)
    except ImpossibleError:
        if whole:
            raise
        scene = build_scene(cell, seen)
    drawn = Drawn(boards=cell.boards, dictionary=cell.dictionary, camera=cell.camera, resting=True)
    setting = Setting(scene, cell.unit, cell.limits, PlanOptions(speed=cell.speed))
    known = {board.name: mul(board.pose.T_base_board, _middle(board.pose.board)) for board in seen.boards}
    holes = {hole.name: hole.T_base_hole for board in seen.boards for hole in board.pose.holes}
    return Shown(setting, drawn, cell.q_start, known | holes)


def _middle(board: Board) -> Array:
    """Return the pose 4x4 of the middle of a board's plate in the board's frame."""
    return transform(t=(*board.plate.centre, 0.0))


def _configuration(setting: Setting, text: str) -> Array:
    """Return a configuration within the limits, rad (m where a joint slides).

    Raises:
        InputError: another number of joints, or a limit is exceeded.
    """
    names, own = setting.robot.joint_names, is_virtual(setting.unit)
    what = f"{', '.join(names)}, in {'rad, m where a joint slides' if own else 'deg'}"
    given = option_numbers("--q", text, len(names), what)
    q = given if own else np.radians(given)
    outside = np.flatnonzero((q < setting.limits.lower) | (q > setting.limits.upper))
    if len(outside):
        joint = int(outside[0])
        low, high = setting.limits.lower[joint], setting.limits.upper[joint]
        within = f"{low:g} to {high:g}" if own else f"{np.degrees(low):.1f} to {np.degrees(high):.1f} deg"
        why = f"q = {text!r}: {names[joint]} must be from {within}"
        raise InputError(why, option="--q", joint=names[outside[0]])
    return q
