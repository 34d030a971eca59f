"""Boards of which one marker shows, and boards with equal ids, on drawn pictures: python bench/outline.py.

Pictures have what photographs of a real cell have (tests/support/outlined/puzzle.py): outlines that are not square,
prints with a shape, saturated white, uneven light, blur, foam, a table in use, wires, the image's edge. A board lies
anywhere in the view, turned and tilted anyhow.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from real_cell import table, versions

from arm.board import Board, Outline
from arm.errors import A465Error
from arm.poses import BoardPose
from arm.robot.shapes import Body
from arm.se3 import Array, inverse, rotation_vector
from outlined.puzzle import (
    DICTIONARY,
    FOAM_GREY,
    PUZZLE,
    Made,
    corners_of,
    lying,
    made,
    picture,
    real_look,
    view_of,
    wire,
)
from vision.boards.checks import BoardLimits
from vision.boards.outline_pose import assess_with_outline
from vision.camera.model import Camera, Image
from vision.markers.detect import Marker, detect_markers
from vision.observe import look

LIMITS = BoardLimits(height_m=4e-3)  # of scenes/hoop/cell.toml
TILTS = (0.0, 7.0, 15.0)
TOLERATED = 3.0 * np.array([LIMITS.sideways_m, LIMITS.height_m, LIMITS.turn_rad])  # see `BoardLimits`


def puzzle(made_mm: float, within_mm: float) -> Board:
    """The puzzle board with these tolerances, mm."""
    outline = PUZZLE.outline
    if outline is None:
        sys.exit("the puzzle board's file gives no outline")
    return replace(PUZZLE, tolerance=made_mm / 1e3, outline=Outline(outline.corners, within_mm / 1e3))


def anywhere(rng: np.random.Generator) -> Array:
    """T_base_board of a board anywhere in the view, or partly beyond its edges."""
    tilt = float(rng.choice([*TILTS, rng.uniform(0.0, 20.0)]))
    middle = (rng.uniform(0.33, 0.57), rng.uniform(-0.24, 0.24), rng.uniform(0.03, 0.06))
    return lying(middle, rng.uniform(-180, 180), tilt, rng.uniform(-180, 180))


def some_wire(rng: np.random.Generator, T: Array) -> list[Body]:
    """A wire on the board, or none."""
    letter = str(rng.choice(["a", "b", "c", "d", "e", ""]))
    return wire(letter, T) if letter else []


def off(pose: BoardPose, T: Array) -> Array:
    """Twist (6,) m and rad from a pose to the true one."""
    E = inverse(pose.T_base_board) @ T
    return np.concatenate([E[:3, 3], rotation_vector(E[:3, :3])])


def is_wrong(pose: BoardPose, T: Array) -> bool:
    """Whether the middle of the board, its height or its rotation is further off than a task tolerates."""
    middle = np.array([*pose.board.plate.centre, 0.0, 1.0])
    E = inverse(T) @ pose.T_base_board
    d = (E @ middle - middle)[:3]
    errors = np.hypot(d[0], d[1]), abs(d[2]), np.linalg.norm(rotation_vector(E[:3, :3]))
    return bool((np.array(errors) > TOLERATED).any())


def why(error: object) -> str:
    """The kind of a refusal."""
    text = str(error)
    kinds = {
        "does not confirm": "too little of the outline shows",
        "do not fit one board": "markers and outline do not fit",
        "too uncertain": "too uncertain",
        "distinguished": "tilt ambiguous",
        "shows in part": "a second board with these ids shows in part",
        "in view twice": "a marker is in view twice",
        "all four borders": "the marker is not whole",
        "neither of its markers": "no marker shows",
        "do not fit (residual": "markers do not fit one board",
        "fit it in no pose": "markers do not fit one board",
        "does not fit its images": "markers do not fit one board",
        "moved between": "moved",
    }
    return next((kind for part, kind in kinds.items() if part in text), text)


@dataclass(frozen=True)
class Shot:
    """A drawn picture of one board."""

    camera: Camera
    image: Image
    T: Array
    frame: list[Marker]


def shots(
    board: Board, count: int, seed: int, spoil: Callable[[Made, np.random.Generator], tuple[Made, float]]
) -> Iterator[tuple[Shot, np.random.Generator]]:
    """Pictures of single boards with a marker in view, of which one alone is left."""
    number = 0
    while number < count:
        seed += 1
        rng = np.random.default_rng(seed)
        T = anywhere(rng)
        one, foam = spoil(made(board, rng), rng)
        camera = view_of(corners_of(T, board))
        image = picture(camera, [(one, T)], real_look(rng), rng, some_wire(rng, T), foam)
        frame = detect_markers(image, camera, DICTIONARY)
        if frame:
            number += 1
            left = int(rng.integers(len(frame)))
            yield Shot(camera, image, T, frame[left : left + 1]), rng


def hidden(board: Board, count: int, first: int) -> None:
    """Boards as their files say, one marker showing."""
    errors, told, nees, again = [], [], [], []
    refused: Counter[str] = Counter()
    wrong: list[str] = []
    for shot, _ in shots(board, count, first, lambda one, _: (one, FOAM_GREY)):
        verdict = assess_with_outline(
            board, [shot.frame], shot.image.astype(np.float32), shot.camera, DICTIONARY, LIMITS
        )
        if not verdict.accepted or verdict.pose is None:
            refused[why(verdict.doubts[0])] += 1
        if verdict.pose is None or any("uncertain" not in str(d) for d in verdict.doubts):
            continue
        x, C = off(verdict.pose, shot.T), verdict.pose.covariance
        nees.append(float(x @ np.linalg.solve(C, x)) / 6.0)
        errors.append(x / np.sqrt(np.diag(C)))
        if verdict.accepted:
            told.append(np.sqrt(np.diag(C)))
            again.append(x)
            if is_wrong(verdict.pose, shot.T):
                wrong.append(f"- wrong: off {words(1e3 * x[:3], np.degrees(x[3:]))}; told {said(C)}")
    z = np.array(errors)
    sd, x = np.array(told), np.array(again)
    within, made_ = 1e3 * (board.outline.tolerance if board.outline else 0.0), 1e3 * board.tolerance
    reasons = ", ".join(f"{n} {kind}" for kind, n in refused.most_common())
    rms = 1e3 * np.sqrt(np.mean(x[:, :3] ** 2, axis=0)), np.degrees(np.sqrt(np.mean(x[:, 3:] ** 2, axis=0)))
    says = (
        1e3 * np.sqrt(np.mean(sd[:, :3] ** 2, axis=0)),
        np.degrees(np.sqrt(np.mean(sd[:, 3:] ** 2, axis=0))),
    )
    print(
        f"| {made_:g}, {within:g} | {count} | {len(told)} | {len(wrong)} | {reasons} | {words(*rms)} | "
        f"{words(*says)} | {words(*np.split(np.sqrt(np.mean(z**2, axis=0)), 2))} | {np.mean(nees):.2f} ({len(nees)}) |",
        *wrong,
        sep="\n",
        flush=True,
    )


def said(covariance: Array) -> str:
    """Standard deviations of a covariance (6, 6)."""
    sd = np.sqrt(np.diag(covariance))
    return words(1e3 * sd[:3], np.degrees(sd[3:]))


def words(shift: Array, turn: Array) -> str:
    """Numbers of the three axes, of shift and turn."""
    return "; ".join(", ".join(f"{v:.2f}" for v in part) for part in (shift, turn))


def another_size(one: Made, rng: np.random.Generator) -> tuple[Made, float]:
    """A plate that is 2 to 4 mm larger or smaller than its file says."""
    middle = one.outline.mean(axis=0)
    scale = 1.0 + float(rng.choice([-1.0, 1.0])) * rng.uniform(2.0, 4.0) / 125.0
    return replace(one, outline=middle + scale * (one.outline - middle)), FOAM_GREY


def glued_elsewhere(one: Made, rng: np.random.Generator) -> tuple[Made, float]:
    """Both markers 2 to 4 mm aside on the plate."""
    angle, far = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(2e-3, 4e-3)
    return replace(one, outline=one.outline + far * np.array([np.cos(angle), np.sin(angle)])), FOAM_GREY


def wedge_shaped(one: Made, rng: np.random.Generator) -> tuple[Made, float]:
    """A plate one of whose sides is turned by 1 to 2 deg."""
    k, outline = int(rng.integers(4)), one.outline.copy()
    outline[k] += rng.uniform(2e-3, 4e-3) * (outline.mean(axis=0) - outline[k]) / 0.088
    return replace(one, outline=outline), FOAM_GREY


def no_contrast(one: Made, rng: np.random.Generator) -> tuple[Made, float]:
    """Foam as bright as the board."""
    return one, float(rng.uniform(228.0, 242.0))


def spoilt(board: Board, count: int) -> None:
    """Boards that are not as their files say: is a pose that is wrong accepted?"""
    table(
        "Boards that are not as their file says", "fault", "pictures", "accepted", "of these wrong", "refused"
    )
    for seed, spoil in enumerate((another_size, glued_elsewhere, wedge_shaped, no_contrast)):
        accepted, wrong = 0, 0
        refused: Counter[str] = Counter()
        for shot, _ in shots(board, count, 100_000 * (seed + 1), spoil):
            verdict = assess_with_outline(
                board, [shot.frame], shot.image.astype(np.float32), shot.camera, DICTIONARY, LIMITS
            )
            if verdict.accepted and verdict.pose is not None:
                accepted, wrong = accepted + 1, wrong + is_wrong(verdict.pose, shot.T)
            else:
                refused[why(verdict.doubts[0])] += 1
        said = str(spoil.__doc__).rstrip(".").lower()
        reasons = ", ".join(f"{n} {kind}" for kind, n in refused.most_common())
        print(f"| {said} | {count} | {accepted} | {wrong} | {reasons} |", flush=True)


def equal_ids(board: Board, count: int) -> None:
    """Two boards with the same markers, wires and the image's edge hiding some: is a pose made of both?"""
    mixed = posed = 0
    seen: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    for seed in range(count):
        rng = np.random.default_rng(500_000 + seed)
        poses = [anywhere(rng)]
        while len(poses) < 2:
            other = anywhere(rng)
            if np.linalg.norm((other - poses[0])[:2, 3]) > 0.23:
                poses.append(other)
        camera = view_of(np.vstack([corners_of(T, board) for T in poses]))
        wires = [b for k, T in enumerate(poses) for b in renamed(some_wire(rng, T), k)]
        image = picture(camera, [(made(board, rng), T) for T in poses], real_look(rng), rng, wires)
        ids = [m.id for m in detect_markers(image, camera, DICTIONARY)]
        seen[" ".join(map(str, ids)) or "none"] += 1
        try:
            found = look([image], camera, [board], DICTIONARY, 0.04, LIMITS)
        except A465Error as error:
            refused[why(error)] += 1
            continue
        if not found.boards:
            refused[why(found.missing[board.name])] += 1
            continue
        posed += 1
        mixed += all(is_wrong(found.boards[0].pose, T) for T in poses)
    table(
        "Two boards with equal ids",
        "pictures",
        "posed",
        "of these of neither board",
        "refused",
        "markers in view",
    )
    reasons = ", ".join(f"{n} {kind}" for kind, n in refused.most_common())
    markers = ", ".join(f"{n} of {ids}" for ids, n in seen.most_common())
    print(f"| {count} | {posed} | {mixed} | {reasons} | {markers} |")


def renamed(bodies: list[Body], number: int) -> list[Body]:
    """Bodies with names of their own."""
    return [replace(b, name=f"{b.name} of {number}") for b in bodies]


TABLES = ("hidden", "spoilt", "ids")


def main() -> None:
    """Print the tables that were asked for."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--tables", nargs="*", choices=TABLES, default=TABLES)
    parser.add_argument("--pictures", type=int, default=300, help="of boards as their files say")
    parser.add_argument("--first", type=int, default=10_000, help="seed before that of the first of these")
    parser.add_argument("--spoilt", type=int, default=25, help="of each fault")
    parser.add_argument("--pairs", type=int, default=200, help="of two boards")
    options = parser.parse_args()
    print(f"# Outlines of boards, drawn pictures\n\n{versions()}; limits of scenes/hoop/cell.toml")
    if "hidden" in options.tables:
        header = (
            *("made_within, outline_within mm", "pictures", "accepted", "of these wrong", "refused"),
            *("off rms, x y z mm; deg", "told rms", "error over told, rms", "NEES per component (poses)"),
        )
        table("One marker shows", *header)
        hidden(puzzle(0.1, 0.5), options.pictures, options.first)
    if "spoilt" in options.tables:
        spoilt(puzzle(0.1, 0.5), options.spoilt)
    if "ids" in options.tables:
        equal_ids(puzzle(0.1, 0.5), options.pairs)


if __name__ == "__main__":
    main()
