"""Recordings of an arm with one thing wrong, and the cause that should be named for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from arm.se3 import Array, frozen, transform
from calib.recordings.arm import ArmRecording
from recorded.arm_sets import TARGETS, Truth, draw_truth, recorded, wide

Fault = Callable[[Truth, Array, str, np.random.Generator], ArmRecording]


def larger(truth: Truth, joints: Array, kind: str, rng: np.random.Generator) -> ArmRecording:
    """The target is 1 % larger than its file says."""
    recording = recorded(truth, joints, kind, rng)
    grown = truth.pixels(joints, 1.01 * TARGETS[kind]) - truth.pixels(joints, TARGETS[kind])
    return replace(recording, pixels=frozen(recording.pixels + grown))


def moved(what: str, truth: Truth, joints: Array, kind: str, rng: np.random.Generator) -> ArmRecording:
    """The target slips, or the camera moves, by 1 mm half way."""
    way = rng.standard_normal(3)
    shift = transform(t=1e-3 * way / np.linalg.norm(way))
    then = replace(truth, **{what: getattr(truth, what) @ shift})
    half = len(joints) // 2
    first, second = (recorded(t, joints, kind, rng) for t in (truth, then))
    return replace(first, pixels=frozen(np.concatenate([first.pixels[:half], second.pixels[half:]])))


def late(truth: Truth, joints: Array, kind: str, rng: np.random.Generator) -> ArmRecording:
    """The joints are read when 2 % of the way from the pose before are still to go."""
    read = joints.copy()
    read[1:] += 0.02 * (joints[:-1] - joints[1:])
    return replace(recorded(truth, joints, kind, rng), joints=frozen(read))


def geared(j: int, truth: Truth, joints: Array, kind: str, rng: np.random.Generator) -> ArmRecording:
    """A joint turns by 0.2 % more than it says."""
    gear = np.ones(6)
    gear[j] = 1.002
    return recorded(replace(truth, gear=gear), joints, kind, rng)


FAULTS: dict[str, tuple[Fault, str]] = {
    "target 1 % larger": (larger, "target size"),
    "target slips 1 mm half way": (partial(moved, "T_gripper_target"), "target moved"),
    "camera moves 1 mm half way": (partial(moved, "T_base_camera"), "camera moved"),
    "joints read 2 % of the way early": (late, "time skew"),
    **{f"J{j + 1} geared 0.2 % otherwise": (partial(geared, j), f"scale of J{j + 1}") for j in range(6)},
}
"""By what is wrong: how it is drawn, and the name of its cause."""


def faulty(name: str, seed: int = 1, count: int = 30, kind: str = "charuco") -> tuple[ArmRecording, Truth]:
    """A recording with that fault, and the truth."""
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng)
    return FAULTS[name][0](truth, wide(truth, TARGETS[kind], count, rng), kind, rng), truth
