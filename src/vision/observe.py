"""Detect boards and the cubes in their holes in images of the cell at rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from arm.board import Board
from arm.errors import ImpossibleError, InputError
from arm.former import former_names
from arm.numerics.products import mul
from arm.poses import BoardPose, adjoint
from arm.se3 import apply, frozen, inverse
from vision.background.camera_shift import CameraShift
from vision.background.watch import CameraWatch
from vision.boards.outline_pose import assess_with_outline
from vision.boards.pose import BoardLimits, accepted_pose, assess_board
from vision.camera.frame_source import Image, as_grey
from vision.camera.model import Camera
from vision.drawing import Pen
from vision.markers.detect import SEARCH_WIDTH_PX, Marker, detect_markers
from vision.markers.edge_blur import SHARP_PX, marker_blur
from vision.markers.exposure import darkness, exposure_complaint, whiteness
from vision.observation import Observation, ObservedBoard
from vision.occupancy.agreement import agreed_occupancy
from vision.targets.marker_print import MarkerPrint

AXIS_LENGTH = 0.05  # m, of the axes drawn
COLOURS = {"cube": (60, 170, 40), "empty": (200, 120, 30), "unsure": (30, 90, 230)}  # BGR
AXES = (((0, 0, 220), "x"), ((0, 160, 0), "y"), ((220, 60, 0), "z"))
MARKER_COLOUR = (200, 0, 200)


def look(
    images: Sequence[Image],
    camera: Camera,
    boards: Sequence[Board],
    dictionary: str,
    cube_size: float,
    limits: BoardLimits | None = None,
    arm_in_view: bool = False,
    tilts: Sequence[float] = (),
    watch: CameraWatch | None = None,
) -> Observation:
    """Detect boards and cubes in images of a cell at rest.

    Args:
        images: all of the same scene; several average the noise.
        camera: the camera that took them.
        boards: all that may be in view.
        dictionary: of the markers, OpenCV's name.
        cube_size: edge of a cube, m.
        limits: for accepting a board's pose.
        arm_in_view: whether the arm may hide part of a marker and so falsify its corners. Then a board whose pose is
            refused counts as missing.
        tilts: of the board stands, rad, see `assess_board`.
        watch: compares the images with the background; they are corrected for a small shift of the camera, whose
            uncertainty goes into the poses' covariances. None: the camera is taken to stand where it was calibrated.

    Raises:
        InputError: no image, an image of another size than the camera's, a marker that belongs to none of `boards`, or
            a marker in view twice.
        ImpossibleError: the images are black or white, the camera has moved too far (`CameraWatch.steady`), or (unless
            `arm_in_view`) both markers of a board are in view but its pose is refused, or not all of them are in the
            region for which the lens was calibrated. Such a board is in the cell, so
            it cannot be ignored like a missing one.
    """
    if not images:
        raise InputError("a look needs at least one image", count=0)
    for number, image in enumerate(images, start=1):
        camera.require_size(image, f"image {number} of {len(images)}")
    shift = None
    if watch is not None and not darkness(max(images, key=np.max)):
        images, shift = watch.steady(images, camera)
    frames = tuple(tuple(detect_markers(image, camera, dictionary)) for image in images)
    _require_known(frames, boards)
    detected = {marker.id for frame in frames for marker in frame}
    if not detected and (dark := darkness(max(images, key=np.max))):
        raise ImpossibleError(f"the images show {dark}", brightest=int(max(i.max() for i in images)))
    if not detected and (white := whiteness(min(images, key=np.mean))):
        raise ImpossibleError(f"the images show {white}", darkest=int(min(i.min() for i in images)))
    others = ""
    if not detected & {marker for board in boards for marker in board.marker_ids}:
        _refuse_mirrored(images[0], camera, dictionary, boards)
        others = _other_markers(images[0], dictionary, boards)
    found: list[ObservedBoard] = []
    missing: dict[str, str] = {}
    for board in boards:
        hidden = [i for i in board.marker_ids if i not in detected]
        if len(hidden) == 2 or (hidden and board.outline is None):
            missing[board.name] = _why_missing(board, hidden) + others
            continue
        try:
            _require_in_region(board, frames, camera)
            pose = _pose(board, frames, images, camera, dictionary, limits, tilts, boards)
        except ImpossibleError as error:
            if not arm_in_view and not hidden:
                if why := _bad_image(images[0], frames[0], dictionary):
                    raise ImpossibleError(f"{error}; image 1 is {why}", **error.data) from error
                raise
            missing[board.name] = f"marker {hidden[0]} is hidden; {error}" if hidden else str(error)
            continue
        if shift is not None:
            pose = with_camera_uncertainty(pose, camera, shift)
        cubes = tuple(agreed_occupancy(images, camera, pose, i, cube_size) for i in range(len(board.holes)))
        found.append(ObservedBoard(pose, cubes))
    half_seen = tuple(b.name for b in boards if b.name in missing and detected & set(b.marker_ids))
    return Observation(tuple(found), missing, half_seen, tuple(images), frames, shift)


def _refuse_mirrored(image: Image, camera: Camera, dictionary: str, boards: Sequence[Board]) -> None:
    """Refuse an image that shows both markers of a board only if left and right, or black and white, are exchanged."""
    mirrored = {
        marker.id for marker in detect_markers(np.ascontiguousarray(image[:, ::-1]), camera, dictionary)
    }
    for board in boards:
        if mirrored.issuperset(board.marker_ids):
            why = "the images are mirrored (left and right exchanged): markers are found in their mirror image alone"
            raise ImpossibleError(f"{why}; switch off the mirroring of the camera", board=board.name)
    negative = {marker.id for marker in detect_markers(255 - image, camera, dictionary)}
    if any(negative.issuperset(board.marker_ids) for board in boards):
        why = (
            "the images, or the prints, are negatives: markers are found with black and white exchanged alone"
        )
        raise ImpossibleError(f"{why}; give images as the camera takes them, or print black squares on white")


def _other_markers(image: Image, dictionary: str, boards: Sequence[Board]) -> str:
    """Say which markers of another dictionary an image shows: of a target, or of the boards; empty if none."""
    grey = as_grey(image)
    shrink = max(1, grey.shape[1] // SEARCH_WIDTH_PX)
    size = (grey.shape[1] // shrink, grey.shape[0] // shrink)
    small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    shown = MarkerPrint.in_image(small)
    if shown is None or shown.dictionary == dictionary:
        return ""
    if shown.layout is None and any(set(board.marker_ids) <= set(shown.ids.tolist()) for board in boards):
        return f", but {shown.words()} are: are the boards of these? boards.dictionary is {dictionary}"
    what = (
        "is this the target of a calibration?"
        if shown.layout
        else "are these of a target, or of other boards?"
    )
    return f", but {shown.words()} are: {what} boards have {dictionary} (boards.dictionary)"


def _pose(
    board: Board,
    frames: Sequence[Sequence[Marker]],
    images: Sequence[Image],
    camera: Camera,
    dictionary: str,
    limits: BoardLimits | None,
    tilts: Sequence[float],
    boards: Sequence[Board],
) -> BoardPose:
    """Return the pose of a board of which a marker shows; its outline, if it has one, is asked where markers do not do.

    Raises:
        ImpossibleError: the pose is refused.
    """
    if set(board.marker_ids) <= {m.id for frame in frames for m in frame}:
        by_markers = assess_board(board, frames, camera, limits, tilts)
        # what more evidence cures: a board that does not fit its markers is not asked further
        unsure = bool(by_markers.doubts) and all(d.data.keys() & {"odds", "turn"} for d in by_markers.doubts)
        if board.outline is None or not unsure:
            return accepted_pose(board, by_markers)
    mean = np.asarray(np.mean([as_grey(image) for image in images], axis=0, dtype=np.float32))
    others = [i for other in boards if other is not board for i in other.marker_ids]
    assessment = assess_with_outline(board, frames, mean, camera, dictionary, limits, tilts, others)
    return accepted_pose(board, assessment)


def _require_in_region(board: Board, frames: Sequence[Sequence[Marker]], camera: Camera) -> None:
    """Check that a board is in the part of the image for which the lens was calibrated.

    Raises:
        ImpossibleError: it is not; data: marker and its corner.
    """
    if camera.region is None:
        return
    left, top, right, bottom = camera.region
    for marker in (m for frame in frames for m in frame if m.id in board.marker_ids):
        outside = ((marker.corners_px < (left, top)) | (marker.corners_px > (right, bottom))).any(axis=1)
        if outside.any():
            x, y = marker.corners_px[outside][0]
            raise ImpossibleError(
                f"board {board.name}: a corner of marker {marker.id} is at {x:.0f}, {y:.0f} px, but the lens was "
                f"calibrated for {left:g}, {top:g} to {right:g}, {bottom:g} px only (intrinsics.region_px); move the "
                "board there, or calibrate the lens for the whole image",
                board=board.name,
                marker=marker.id,
                corner_px=[float(x), float(y)],
                region_px=list(camera.region),
            )


def with_camera_uncertainty(pose: BoardPose, camera: Camera, shift: CameraShift) -> BoardPose:
    """Return a board's pose with the uncertainty of the camera's measured shift added to its covariances."""
    Ad = adjoint(mul(inverse(pose.T_base_board), camera.T_base_camera))
    added = mul(mul(Ad, shift.twist_covariance), Ad.T)
    again = None if pose.repeatability is None else frozen(pose.repeatability + added)
    return replace(pose, covariance=frozen(pose.covariance + added), repeatability=again)


def _bad_image(image: Image, markers: Sequence[Marker], dictionary: str) -> str:
    """What is wrong with focus or exposure of an image; "" if nothing is."""
    blur = marker_blur(image, markers, dictionary)
    if blur is not None and blur > SHARP_PX:
        return f"blurred by {blur:.1f} px (at most {SHARP_PX:g}): focus, or expose for a shorter time"
    return exposure_complaint(image, markers) or ""


def _why_missing(board: Board, hidden: Sequence[int]) -> str:
    if len(hidden) == 2:
        return f"neither of its markers {board.marker_ids[0]} and {board.marker_ids[1]} is in view"
    other = next(i for i in board.marker_ids if i not in hidden)
    return (
        f"marker {hidden[0]} is hidden, or less than 3 px inside the image; marker {other} alone does not determine "
        "the tilt"
    )


def _require_known(frames: Sequence[Sequence[Marker]], boards: Sequence[Board]) -> None:
    known = {i for board in boards for i in board.marker_ids}
    for frame in frames:
        twice = [i for i, n in Counter(m.id for m in frame).items() if n > 1 and i in known]
        if twice:
            raise InputError(
                f"marker {twice[0]} is in view twice; every board needs its own markers", marker=twice[0]
            )
    # clutter may look like a marker in one image; a board is detected in most of them
    count = Counter(m.id for frame in frames for m in frame if m.id not in known)
    strange = sorted(i for i, n in count.items() if 2 * n > len(frames))
    if strange:
        names = ", ".join(map(str, strange))
        raise InputError(
            f"marker {names} is in view but belongs to no board of the cell file (known: "
            f"{', '.join(map(str, sorted(known)))}); list its board's CSV under [boards] files, or remove it from view",
            markers=strange,
            known=sorted(known),
        )


def annotated(image: Image, camera: Camera, observation: Observation) -> Image:
    """Draw the markers of the first frame, each board's axes and its holes' occupancy onto a copy in BGR.

    Args:
        image: the first image of the observation.
        camera: the camera that took it.
        observation: markers and boards to draw.
    """
    colour_image = image.copy() if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    picture = np.asarray(colour_image, dtype=np.uint8)
    pen = Pen(picture)
    for marker in observation.frames[0]:
        pen.outline(marker.corners_px, MARKER_COLOUR)
        pen.text(str(marker.id), marker.corners_px.mean(axis=0), MARKER_COLOUR)
    square = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
    for board in observation.boards:
        mouth = board.pose.board.pocket[0] * square
        T = board.pose.T_base_board
        for axis, (colour, name) in enumerate(AXES):
            tip = AXIS_LENGTH * np.eye(3)[axis]
            ends = camera.project_base(apply(T, np.stack([np.zeros(3), tip])))
            pen.arrow(ends[0], ends[1], colour)
            pen.text(name, ends[1], colour)
        for hole, now in zip(board.pose.holes, board.occupancy, strict=True):
            outline = camera.project_base(apply(hole.T_base_hole, mouth))
            pen.outline(outline, COLOURS[now.state])
            pen.text(f"{hole.name}\n{now.state}", outline.mean(axis=0), COLOURS[now.state])
    return picture


former_names(__name__, "vision.observation", Look="Observation", BoardSight="ObservedBoard")
