"""The wire board on photographs of a real cell, with its outline as witness: python bench/real_outline.py FOLDER.

FOLDER is that of bench/real_cell.py. Where both markers show, one of them is also withheld, and the pose from the other
and the outline is compared with that from both. The board of group B stood still, and never shows both: its poses are
compared with each other, and with the borders of marker 2 that the wire leaves.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from real_cell import DISTANCE, Photos, Watched, assumed_camera, spread, table, versions, wire_board

from arm.board import Board, Outline, Plate
from arm.errors import A465Error
from arm.poses import BoardPose
from arm.se3 import Array, inverse, rotation_vector
from vision.background.camera_shift import as_calibrated, measure_shift
from vision.boards.checks import BoardLimits
from vision.boards.outline import find_sides
from vision.boards.outline_pose import assess_with_outline
from vision.boards.pose import assess_board
from vision.camera.model import Camera, Image
from vision.camera.projection import Projection
from vision.markers.detect import Marker, detect_markers
from vision.observe import look

DICTIONARY = "DICT_4X4_50"
PLATE = Plate((0.125, 0.125, 0.003), (0.0375, -0.0375))
CORNERS = ((-0.025, 0.025), (0.1, 0.025), (0.1, -0.1), (-0.025, -0.1))  # m
LIMITS = BoardLimits(height_m=4e-3)  # of scenes/hoop/cell.toml
LEAST_SEEN = 0.25  # part of a border of the half hidden marker
MOST_TURNED_PX = 2.0  # of its ends against each other


def outlined(made_mm: float, within_mm: float) -> Board:
    """The wire board with its outline, made within these tolerances, mm."""
    return replace(wire_board(made_mm / 1e3), plate=PLATE, outline=Outline(CORNERS, within_mm / 1e3))


@dataclass(frozen=True)
class Shot:
    """A photograph of the wire board."""

    name: str
    image: Image
    frame: list[Marker]


def shots(photos: Photos, camera: Camera) -> list[Shot]:
    """The photographs that show a marker of the board and no other sheet."""
    found = []
    for name in photos.catalog:
        if name.startswith("hoop_arm/"):
            image = photos.image(name)
            frame = detect_markers(image, camera)
            if 0 < len(frame) <= 2 and {m.id for m in frame} <= {1, 2}:
                found.append(Shot(name, image, frame))
    return found


def counts(every: Sequence[Shot], camera: Camera) -> None:
    """How many photographs have a pose."""
    table(
        "The wire board in single photographs",
        "made_within, outline_within mm; limit of height mm",
        "both markers show: by them alone",
        "with the outline",
        "one marker shows",
    )
    for made_mm, within_mm, limits in ((0.1, 0.5, BoardLimits()), (0.1, 0.5, LIMITS), (0.3, 0.5, LIMITS)):
        board, alone = outlined(made_mm, within_mm), 0
        posed = {1: 0, 2: 0}
        for shot in every:
            if len(shot.frame) == 2:
                alone += assess_board(board, [shot.frame], camera, limits).accepted
            posed[len(shot.frame)] += isinstance(pose_or_reason(shot, board, camera, limits), BoardPose)
        both = sum(len(s.frame) == 2 for s in every)
        kind = f"{made_mm:g}, {within_mm:g}; {1e3 * limits.height_m:g}"
        ones = len(every) - both
        print(f"| {kind} | {alone} of {both} | {posed[2]} of {both} | {posed[1]} of {ones} |", flush=True)


def pose_or_reason(shot: Shot, board: Board, camera: Camera, limits: BoardLimits) -> BoardPose | str:
    """What a look makes of one photograph."""
    try:
        found = look([shot.image], camera, [board], DICTIONARY, 0.04, limits)
    except A465Error as error:
        return str(error)
    return found.poses[0] if found.boards else found.missing[board.name]


def singles(every: Sequence[Shot], board: Board, camera: Camera) -> None:
    """Each photograph in which one marker shows."""
    table(
        "One marker shows: each photograph (made_within 0.1, outline_within 0.5, limit of height 4 mm)",
        *("photograph", "marker", "tilt to the optical axis deg", "told x, y, z mm; deg", "refused"),
    )
    for shot in every:
        if len(shot.frame) == 1:
            said = pose_or_reason(shot, board, camera, LIMITS)
            cells = f"| | {said}" if isinstance(said, str) else f"{tilt(said):.1f} | {told(said)} |"
            print(f"| {shot.name} | {shot.frame[0].id} | {cells} |", flush=True)


def tilt(pose: BoardPose) -> float:
    """Angle of the board's normal to the optical axis, deg."""
    return float(np.degrees(np.arccos(min(1.0, abs(pose.T_base_board[2, 2])))))


def told(pose: BoardPose) -> str:
    """Standard deviations of a pose."""
    sd = np.sqrt(np.diag(pose.covariance))
    return (
        f"{', '.join(f'{1e3 * v:.2f}' for v in sd[:3])}; {', '.join(f'{np.degrees(v):.2f}' for v in sd[3:])}"
    )


def withheld(every: Sequence[Shot], board: Board, camera: Camera) -> None:
    """Poses from one marker and the outline against those from both markers."""
    header = "photographs", "poses", "refused", "off mm, median, most", "off deg, median, most"
    table("One of two markers withheld, against the pose from both markers", *header, "NEES per component")
    for kind in ("data_", "image_"):
        off, nees, refused, count = [], [], 0, 0
        for shot in every:
            both = assess_board(board, [shot.frame], camera).pose if len(shot.frame) == 2 else None
            if both is None or kind not in shot.name:
                continue
            for marker in shot.frame:
                count += 1
                of_one = assess_with_outline(
                    board, [[marker]], shot.image.astype(np.float32), camera, DICTIONARY, LIMITS
                )
                if not of_one.accepted or of_one.pose is None:
                    refused += 1
                    continue
                x = between(of_one.pose, both)
                C = of_one.pose.covariance + both.covariance
                off.append((1e3 * np.linalg.norm(x[:3]), np.degrees(np.linalg.norm(x[3:]))))
                nees.append(float(x @ np.linalg.solve(C, x)) / 6.0)
        far, turn = np.array(off).T
        print(
            f"| {kind} | {len(off)} of {count} | {refused} | {np.median(far):.2f}, {far.max():.2f} | "
            f"{np.median(turn):.2f}, {turn.max():.2f} | {np.mean(nees):.2f} |",
            flush=True,
        )


def between(a: BoardPose, b: BoardPose) -> Array:
    """Twist (6,) m and rad from one pose to another."""
    E = inverse(a.T_base_board) @ b.T_base_board
    return np.concatenate([E[:3, 3], rotation_vector(E[:3, :3])])


def still(photos: Photos, board: Board, camera: Camera) -> None:
    """Group B: scatter of poses, and where the half hidden marker shows that the board is."""
    watched, names = Watched(photos, camera), [f"hoop_arm/{n}.png" for n in photos.groups["B"]["photographs"]]
    reference = watched.background(names[0])
    poses, off, sds = [], [], []
    for name in names:
        image = photos.image(name)
        image = as_calibrated(image, camera, measure_shift(reference, image, camera, DISTANCE))
        grey, frame = image.astype(np.float32), detect_markers(image, camera)
        verdict = assess_with_outline(board, [frame], grey, camera, DICTIONARY, LIMITS)
        if not verdict.accepted or verdict.pose is None:
            print(f"- {name}: {verdict.doubts[0]}")
            continue
        poses.append(verdict.pose)
        across, sd = half_hidden(grey, verdict.pose, camera)
        off += across
        sds += sd
    table(
        "A board that stands still (group B), one marker and the outline, camera's shift corrected",
        *("photographs", "scatter across, depth mm", "repeatability across, depth mm", "ratio"),
        *("deg, repeatability, ratio", "standard deviation of the pose across, depth mm; deg"),
    )
    print(f"| {len(poses)} | {spread(poses)} |")
    far = 1e3 * np.array(off)
    print(
        f"\nborders of marker 2 that the wire leaves: {len(off)}, off by {np.sqrt(np.mean(far**2)):.2f} mm rms (mean "
        f"{far.mean():+.2f}, most {np.abs(far).max():.2f}); told {1e3 * np.sqrt(np.mean(np.square(sds))):.2f} mm"
    )


def half_hidden(
    image: np.ndarray[tuple[int, int], np.dtype[np.float32]], pose: BoardPose, camera: Camera
) -> tuple[list[float], list[float]]:
    """How far the visible borders of marker 2 are from where a pose puts them, and told, m."""
    square = pose.board.marker_corners()[1, :, :2]
    corners = tuple((float(x), float(y)) for x, y in square)
    dark = replace(pose.board, outline=Outline(corners, 0.0))
    off, told_ = [], []
    # in the negative, a marker is lighter than what surrounds it
    for side in find_sides(np.float32(255.0) - image, dark, pose.T_base_board, camera, 2e-3):
        if side.seen < LEAST_SEEN:
            continue
        seen = Projection(camera, pose.T_base_board, side.points)
        ends = (side.inwards * (side.found_px - seen.pixels)).sum(axis=-1)
        if np.ptp(ends) > MOST_TURNED_PX:  # the wire's edge
            continue
        across = float(ends.mean())
        J = np.einsum("ni,nij->nj", side.inwards, seen.by_target).mean(axis=0)
        px_per_m = float(np.linalg.norm(np.einsum("ni,nij->nj", side.inwards, seen.by_point), axis=-1).mean())
        off.append(across / px_per_m)
        told_.append(float(np.sqrt(J @ pose.covariance @ J)) / px_per_m)
    return off, told_


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("folder", type=Path, help="of bench/real_cell.py")
    photos, camera = Photos(parser.parse_args().folder), assumed_camera()
    print(f"# The wire board and its outline\n\n{versions()}")
    every, board = shots(photos, camera), outlined(0.1, 0.5)
    counts(every, camera)
    singles(every, board, camera)
    withheld(every, board, camera)
    still(photos, board, camera)


if __name__ == "__main__":
    main()
