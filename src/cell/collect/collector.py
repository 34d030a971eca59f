"""``a465 calibrate hand-eye --collect``: show a target to the camera in the most informative poses.

The poses are chosen before anything moves. Every motion between them is planned and certified; it avoids all bodies of
the cell file and the whole zone for boards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from arm.errors import ImpossibleError, InputError
from arm.robot.dh import A465
from arm.se3 import Array, frozen
from calib.hand_eye.calibrate import HAND_EYE_LIMITS
from calib.hand_eye.next_poses import choose_calibration_poses
from calib.recordings.arm import FEWEST_CORNERS
from cell.collect.pose_pool import HandView, hand_pool, nearest_order
from cell.collect.recipe_270 import POSES, recipe_poses
from cell.collect.record import HandRecord
from cell.collect.sway import Sway
from cell.console import Console
from cell.scene.build import unseen_scene
from cell.session.homed import home_or_check
from cell.task.planning import plan_motion
from cell.task.run import TaskRun
from driver.execution.rest import STILL_COUNTS, farthest
from plan.scene import Scene
from vision.camera.model import Image
from vision.targets.target import TargetFinder

FEWEST_POSES = HAND_EYE_LIMITS.images
PLANNED = 24  # default number of poses
POOL = 300  # feasible configurations from which poses are chosen
SETTLE_S = 0.5  # controller time to wait after the arm has stopped: plates vibrate
SAME_PX = 2.0  # rms; a larger shift at the same counts means that the target was touched
SAME_POSE = np.radians(0.05)  # largest difference of any joint
MOST_FAILED = 5  # failed poses after which collection stops if more than half failed
_REPEATS = 3  # poses tried to verify the mount


@dataclass(frozen=True)
class CollectOptions:
    """Options of a collection.

    Attributes:
        poses: number of poses, including those already in the recording.
        seed: seed of their choice.
        recipe: take the poses of the course report (`cell.collect.recipe_270`) instead of the most informative ones.
    """

    poses: int = PLANNED
    seed: int = 0
    recipe: bool = False

    def __post_init__(self) -> None:
        if not FEWEST_POSES <= self.poses <= 300:
            why = f"--poses {self.poses}: must be from {FEWEST_POSES} to 300"
            raise InputError(why, option="--poses", value=self.poses)
        if self.seed < 0:
            raise InputError(f"--seed {self.seed}: must be 0 or more", option="--seed", value=self.seed)

    @classmethod
    def of(cls, poses: int | None, seed: int | None, recipe: bool) -> CollectOptions:
        """Return the options, with defaults for None."""
        usual = POSES if recipe else PLANNED
        return cls(usual if poses is None else poses, seed or 0, recipe)


def hand_scene(record: HandRecord) -> Scene:
    """Return the cell with the target in the gripper and the whole zone occupied."""
    robot = record.hand.carried_by(record.cell.robot())
    return Scene(robot, robot, unseen_scene(record.cell).bodies, ())


def choose_poses(
    record: HandRecord, scene: Scene, options: CollectOptions, console: Console
) -> tuple[Array, Array]:
    """Choose the configurations that a recording still needs.

    Returns:
        The configurations to record (k, 6), rad, and all feasible ones (n, 6), rad, for further proposals.

    Raises:
        ImpossibleError: the target cannot be shown to the camera.
    """
    cell, hand = record.cell, record.hand
    view = HandView(scene.robot_open, scene.bodies, cell.limits, cell.camera, hand, cell.clearance)

    progress = partial(console.progress, "poses in view of the camera")
    missing, taken = options.poses - len(record), record.configurations()
    pool = not_taken(hand_pool(view, POOL, options.seed, progress), taken)
    if options.recipe:
        recipe = recipe_poses(view, options.poses, options.seed, progress)
        left = not_taken(recipe, taken)[:missing]
        console.step(f"{len(left)} of the recipe's {len(recipe)} poses to take")
        return left, pool
    lens, points, about = cell.camera.at(np.eye(4)), hand.target.points(), cell.camera.T_base_camera
    plan = choose_calibration_poses(pool, missing, A465, lens, points, about, hand.T_flange_target, taken)
    console.step(
        f"{missing} of {len(pool)} poses chosen: expected uncertainty of the camera pose "
        f"{1e3 * plan.sigma:.2f} mm and {np.degrees(plan.sigma_turn):.3f} deg"
    )
    return pool[list(plan.places)], pool


def not_taken(q: Array, taken: Array) -> Array:
    """Return the configurations (n, 6) that are not in `taken` (m, 6)."""
    off = np.abs(q[:, None] - taken).max(axis=-1).min(axis=1, initial=np.inf)
    return np.asarray(q[off > SAME_POSE])


class Collector:
    """Move the arm from pose to pose and record the corners seen.

    Args:
        run: run in an open cell.
        record: recording to extend.
        scene: cell with the target in the gripper.
        sway: of the camera, None if it is not measured.
        console: output.
    """

    def __init__(
        self, run: TaskRun, record: HandRecord, scene: Scene, sway: Sway | None, console: Console
    ) -> None:
        self.run, self.record, self.scene, self.sway, self.console = run, record, scene, sway, console
        self.finder = TargetFinder(record.hand.target)
        self._last: Image | None = None
        self._is_whole = False

    def initialise_arm(self) -> None:
        """Home the arm, unless it was homed before. The jaws are not moved: they may hold the plate."""
        mars, cell = self.run.connection.mars, self.run.task.cell
        home_or_check(mars, cell, self.console, self.run.homed_before, jaws_too=False)
        self.run.homed = True

    def home(self) -> bool:
        """Return to q_start with the target in the gripper; return whether a plan was found."""
        return self._drive(self.run.task.cell.q_start, "return to q_start")

    def begin_sway(self) -> None:
        """Take the background before the first pose, with the arm at q_start, unless there is one."""
        if self.sway is None or self.sway.is_measured or len(self.record):
            return
        if self.home():
            self.run.connection.mars.link.wait(SETTLE_S)
            self.sway.begin(self.run.connection.frames)

    def photographs(self) -> Sequence[Image]:
        """Return photographs of now, without the camera's sway since the first pose.

        Raises:
            ImpossibleError: the camera has moved too far.
        """
        images = self.run.connection.frames.grab(self.run.task.cell.photographs)
        return images if self.sway is None else self.sway.steadied(images)

    def require_same_hold(self) -> None:
        """Repeat a recorded pose to verify that the mount of the target is unchanged.

        Raises:
            ImpossibleError: the target appears elsewhere, or no recorded pose can be repeated; data: off_px.
        """
        recorded = self.record.configurations()
        for place in nearest_order(self.run.q_now(), recorded)[:_REPEATS]:
            if not self._drive(recorded[place], f"poses[{place}] again"):
                continue
            _, corners = self._look()
            off = corners - self.record.pixels[place]
            both = np.isfinite(off).all(axis=1)
            if not both.any():
                continue
            off_px = float(np.sqrt(np.mean(np.sum(off[both] ** 2, axis=1))))
            if off_px > SAME_PX:
                raise ImpossibleError(
                    f"at the configuration of poses[{place}] of {self.record.file} the target is {off_px:.1f} px "
                    f"from where it was (allowed {SAME_PX:g}): it was remounted, or the camera or the arm's zeros "
                    "changed; give a new file",
                    off_px=off_px,
                    pose=place,
                )
            self.console.step(f"poses[{place}] again: the target is where it was, within {off_px:.2f} px")
            return
        raise ImpossibleError(
            f"none of {_REPEATS} poses of {self.record.file} could be repeated to verify that the target's mount is "
            "unchanged; give a new file",
            off_px=None,
        )

    def collect(self, wanted: Array, nearest_first: bool) -> int:
        """Move to configurations (k, 6), rad, and record the target; return how many were recorded.

        Raises:
            ImpossibleError: the target is not found in most poses.
            InputError: it is a part of a larger print, or the gripper holds another print.
            ExecutionStopped: motion stopped; earlier poses are in the file.
        """
        order = nearest_order(self.run.q_now(), wanted) if nearest_first else range(len(wanted))
        total, taken, failed = len(wanted), 0, 0
        for number, place in enumerate(order, start=1):
            name = f"pose {number} of {total}"
            if self._take(wanted[place], name):
                taken += 1
                continue
            failed += 1
            if failed >= MOST_FAILED and failed > taken:
                target = self.record.hand.target
                instead = "" if self._last is None else self.finder.seen_instead(self._last, loose=False)
                if instead:
                    raise InputError(
                        f"{failed} of {number} poses do not show the target ({target.label()}); the last image shows "
                        f"{instead}",
                        instead=instead,
                    )
                raise ImpossibleError(
                    f"{failed} of {number} poses failed: is the target {target.label()}, lit, and mounted about as the "
                    "target file says?",
                    failed=failed,
                    poses=number,
                )
        return taken

    def _take(self, q: Array, name: str) -> bool:
        """Go to a configuration and record the corners; return whether that succeeded."""
        if not self._drive(q, name):
            return False
        counts, corners = self._look()
        shown = int(np.isfinite(corners[:, 0]).sum())
        if counts is None:
            found = "left out, the arm was not at rest"
        elif shown < FEWEST_CORNERS:
            found = "left out, the target was not seen"
        else:
            self._require_whole()
            self.record.add(counts, corners)
            found = f"{shown} corners"
        self.console.step(f"{name}: {found}, {len(self.record)} recorded")
        return counts is not None and shown >= FEWEST_CORNERS

    def _require_whole(self) -> None:
        """Check once that the target is no part of a larger print.

        Raises:
            InputError: it is.
        """
        if self._is_whole or self._last is None:
            return
        if part := self.finder.read_in_part(self._last):
            target = self.record.hand.target
            raise InputError(f"the image shows more than the target ({target.label()}): {part}", instead=part)
        self._is_whole = True

    def _drive(self, q: Array, what: str) -> bool:
        """Plan, certify and execute the motion to a configuration; return False if no plan was found."""
        try:
            plan = plan_motion(self.run.task, self.scene, self.run.q_now(), q, self.run.speed)
        except ImpossibleError as error:
            self.console.step(f"{what}: left out, {error}")
            return False
        if plan is not None:
            self.run.execute(plan.steps)
        return True

    def _look(self) -> tuple[tuple[int, ...] | None, Array]:
        """Return the counts, None if the arm was not at rest, and the corners (m, 2), px, averaged over the frames."""
        mars = self.run.connection.mars
        mars.link.wait(SETTLE_S)
        counts = mars.settled_counts()
        images = self.photographs()
        self._last, corners = images[-1], seen_corners(images, self.finder)
        still = farthest(counts, mars.settled_counts()) <= STILL_COUNTS
        return (counts if still else None), corners


def seen_corners(images: Sequence[Image], finder: TargetFinder) -> Array:
    """Return the corners (m, 2), px, of a target at rest, averaged over the images.

    A corner is NaN unless it was detected in more than half of them.
    """
    count = len(images)
    shown = np.full((count, finder.target.corners, 2), np.nan)
    for k, image in enumerate(images):
        view = finder.find(image)
        if view is not None:
            shown[k, view.ids] = view.corners_px
    seen = np.isfinite(shown[..., 0]).sum(axis=0) * 2 > count
    mean = np.full(shown.shape[1:], np.nan)
    mean[seen] = np.nanmean(shown[:, seen], axis=0)
    return frozen(mean)
