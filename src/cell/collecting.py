"""``a465 calibrate hand-eye --collect``: the arm shows a target to the camera in poses that tell most.

Every way between poses is planned and certified before it is driven, around everything that the cell file has and the
whole zone in which boards may stand. The recording is written after every pose: what was interrupted goes on.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm.dh import A465
from arm.errors import ImpossibleError, InputError
from arm.files import write_atomic
from arm.se3 import Array, frozen
from calib.arm_recording import FEWEST_CORNERS, ArmRecording, read_arm_recording
from calib.hand_eye import HAND_EYE_LIMITS
from calib.next_poses import plan_poses
from cell.console import Console
from cell.handposes import hand_pool, nearest_order
from cell.handtarget import HandTarget
from cell.planning import options_of, provenance
from cell.scenery import unseen_scene
from cell.taskrun import TaskRun
from plan.scene import Scene
from plan.way import plan_way
from vision.frames import FrameSource
from vision.target import TargetFinder

FEWEST_POSES = HAND_EYE_LIMITS.images
POOL = 300  # configurations from which poses are chosen
SETTLE_S = 0.5  # of the controller, after the arm has stopped: plates ring


@dataclass(frozen=True)
class CollectOptions:
    """What a person asks for.

    Attributes:
        poses: how many.
        seed: of their choice.
    """

    poses: int = 24
    seed: int = 0

    def __post_init__(self) -> None:
        if not FEWEST_POSES <= self.poses <= 300:
            raise InputError(
                f"--poses {self.poses}: must be from {FEWEST_POSES} to 300",
                option="--poses",
                value=self.poses,
            )
        if self.seed < 0:
            raise InputError(f"--seed {self.seed}: must be 0 or more", option="--seed", value=self.seed)


class Collector:
    """Drives the arm from pose to pose and records what the camera sees.

    Args:
        run: of an open cell; its task says which cell.
        hand: target in the gripper, about where it is.
        file: recording to write; poses that are in it already count.
        options: what is asked for.
        console: where progress is told.
    """

    def __init__(
        self, run: TaskRun, hand: HandTarget, file: Path, options: CollectOptions, console: Console
    ) -> None:
        self.run, self.hand, self.file, self.options, self.console = run, hand, file, options, console
        cell = run.task.cell
        self.robot = hand.carried_by(cell.robot())
        bare = unseen_scene(cell)
        self.scene = Scene(self.robot, self.robot, bare.bodies, ())
        self.finder = TargetFinder(hand.target)
        self.joints: list[Array] = []
        self.pixels: list[Array] = []
        if file.exists():
            self._go_on()

    def _go_on(self) -> None:
        before = read_arm_recording(self.file)
        cell, points = self.run.task.cell, self.hand.target.points()
        other = {
            "target": before.points.shape != points.shape
            or not np.allclose(before.points, points, atol=1e-9),
            "camera": before.camera.lens_digest != cell.camera.lens_digest,
            "arm": before.dh.digest != A465.digest or before.unit != cell.unit.name,
        }
        differing = [name for name, is_other in other.items() if is_other]
        if differing:
            raise InputError(
                f"{self.file}: holds poses of another {' and '.join(differing)}; give a new file",
                file=str(self.file),
                differing=differing,
            )
        self.joints, self.pixels = list(before.joints), list(before.pixels)
        self.console.say(
            f"{self.file}: {len(self.joints)} poses are there from before; the plate must not have moved"
        )

    def recording(self) -> ArmRecording:
        """What was recorded so far; joints are what the unit's own zeros say."""
        camera = self.run.task.cell.camera.at(np.eye(4))
        return ArmRecording(
            camera,
            A465,
            self.hand.target.points(),
            self.hand.target.kind,
            frozen(np.array(self.joints)),
            frozen(np.array(self.pixels)),
            self.run.task.cell.unit.name,
        )

    def choose(self) -> list[Array]:
        """Configurations still to be taken, in the order in which they are driven."""
        cell = self.run.task.cell
        progress = lambda part: self.console.progress("poses that the camera sees", part)  # noqa: E731
        pool = hand_pool(
            self.robot,
            self.scene.bodies,
            cell.limits,
            cell.camera,
            self.hand,
            cell.clearance,
            POOL,
            self.options.seed,
            progress,
        )
        missing = self.options.poses - len(self.joints)
        if missing <= 0:
            return []
        plan = plan_poses(
            pool.q,
            missing,
            A465,
            cell.camera.at(np.eye(4)),
            self.hand.target.points(),
            cell.camera.T_base_camera,
            self.hand.T_flange_target,
            np.array([self._read(j) for j in self.joints]) if self.joints else None,
        )
        self.console.step(
            f"{missing} of {len(pool.q)} poses chosen: the camera's place will be known to about "
            f"{1e3 * plan.sigma:.2f} mm and {np.degrees(plan.sigma_turn):.3f} deg"
        )
        left = pool.q[list(plan.places)]
        return [left[i] for i in nearest_order(self.run.q_now(), left)]

    def _read(self, recorded: Array) -> Array:
        """A recorded configuration as the cell's unit has it."""
        cell = self.run.task.cell
        return cell.unit.positions(cell.nominal_unit.counts(recorded))

    def collect(self) -> int:
        """Take all poses that are left; how many were taken.

        Raises:
            ImpossibleError: no pose can be driven to, or the target is not seen where it should be.
            ExecutionStopped: motion stopped; what was recorded before is in the file.
        """
        left = self.choose()
        total, taken, unseen = len(left), 0, 0
        for number, q in enumerate(left, start=1):
            if not self._drive(q, f"pose {number} of {total}"):
                continue
            if self._photograph():
                taken += 1
                self.write()
                seen = f"{int(np.isfinite(self.pixels[-1][:, 0]).sum())} corners"
            else:
                unseen += 1
                seen = "the target was not seen"
            self.console.step(f"pose {number} of {total}: {seen}, {len(self.joints)} recorded")
            if unseen >= 5 and unseen > taken:
                raise ImpossibleError(
                    f"the target was not seen in {unseen} of {number} poses: is it {self.hand.target.label()}, lit, "
                    "and held about where the target file says?",
                    unseen=unseen,
                    poses=number,
                )
        return taken

    def take_into_use(self) -> None:
        """Home the arm. The jaws stay as they are: they may hold the plate."""
        mars, cell = self.run.connection.mars, self.run.task.cell
        self.console.step(
            "homing: the controller moves every axis, nothing checks its way; the jaws stay as they are, the plate "
            "must be firm in the hand"
        )
        mars.initialise(home=True, soft_home=False)
        mars.set_registers(cell.speed_registers, cell.acceleration_registers)
        self.run.homed = True

    def home(self) -> None:
        """Back to q_start, the target still in hand."""
        self._drive(self.run.task.cell.q_start, "back to q_start")

    def _drive(self, q: Array, what: str) -> bool:
        """Plan the way to a configuration, certify it, drive it; False if there is none."""
        task = self.run.task
        try:
            plan = plan_way(
                self.scene,
                self.run.q_now(),
                q,
                task.cell.unit,
                task.cell.limits,
                options_of(task, self.run.speed),
                provenance(task),
                {"name": task.name, "kind": task.kind},
            )
        except ImpossibleError as error:
            self.console.step(f"{what}: left out, {error}")
            return False
        if plan is not None:
            self.run.execute(plan.steps)
        return True

    def _photograph(self) -> bool:
        """Photograph the target with the arm at rest, and keep its corners' means over the frames."""
        mars, cell = self.run.connection.mars, self.run.task.cell
        mars.link.wait(SETTLE_S)
        counts = mars.settled_counts()
        corners = seen_corners(self.run.connection.frames, self.finder, cell.photographs)
        if mars.settled_counts() != counts or np.isfinite(corners[:, 0]).sum() < FEWEST_CORNERS:
            return False
        self.joints.append(frozen(cell.nominal_unit.positions(counts)))
        self.pixels.append(corners)
        return True

    def write(self) -> None:
        """Write the recording, whole or not at all."""
        write_atomic(self.file, json.dumps(recording_json(self.recording()), indent=1) + "\n")


def seen_corners(frames: FrameSource, finder: TargetFinder, count: int) -> Array:
    """Corners (m, 2) px of a target that stands still, means over frames; NaN where it was not seen in half of them."""
    shown = np.full((count, finder.target.corners, 2), np.nan)
    for k, image in enumerate(frames.grab(count)):
        view = finder.find(image)
        if view is not None:
            shown[k, view.ids] = view.corners_px
    seen = np.isfinite(shown[..., 0]).sum(axis=0) * 2 > count
    mean = np.full(shown.shape[1:], np.nan)
    mean[seen] = np.nanmean(shown[:, seen], axis=0)
    return frozen(mean)


def recording_json(r: ArmRecording) -> dict[str, Any]:
    """A recording as its file has it."""
    dh = r.dh
    return {
        "kind": "eye_to_hand_fixed_camera",
        **({"unit": r.unit} if r.unit else {}),
        "camera": {
            "K_px": r.camera.K.tolist(),
            "distortion_k1k2p1p2k3": r.camera.distortion.tolist(),
            "size_px": list(r.camera.size),
        },
        "dh": {
            "d_m": dh.d.tolist(),
            "a_m": dh.a.tolist(),
            "alpha_rad": dh.alpha.tolist(),
            "theta_offset_rad": dh.theta_offset.tolist(),
        },
        "target": {"kind": r.kind, "points_m": r.points.tolist()},
        "poses": [
            {
                "joints_rad": q.tolist(),
                "corners_px": [[None, None] if np.isnan(c).any() else c.tolist() for c in corners],
            }
            for q, corners in zip(r.joints, r.pixels, strict=True)
        ],
    }
