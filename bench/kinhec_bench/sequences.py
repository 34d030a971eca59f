"""Sequences of kinhec's pose streams, generated here, and the pairs of poses that its protocol gives to solvers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import yaml
from kinhec.benchmark import KEYFRAME_MIN_ROT_DEG, KEYFRAME_MIN_TRANS_M, MAX_KEYFRAMES
from kinhec.io import Sequence, iter_sequences
from kinhec.motions import select_keyframes
from kinhec.pipeline import generate_dataset

from arm.se3 import Array
from calib.robot_world.reml import inverses
from calib.robot_world.solve import PosePairs

TIER = Path(__file__).with_name("tier.yaml")


@dataclass(frozen=True, eq=False)
class Sample:
    """One sequence.

    Attributes:
        sequence: kinhec's.
        group: track, and what sets its parts apart.
        A, B: (n, 4, 4) with A X = Y B, of the keyframes of kinhec's protocol.
        frames: (n,) of the keyframes among the camera's.
    """

    sequence: Sequence
    group: str
    A: Array
    B: Array
    frames: npt.NDArray[np.intp]

    @property
    def pairs(self) -> PosePairs:
        """For our estimator."""
        held = self.sequence.eye_in_hand
        return PosePairs(self.A, inverses(self.B) if held else self.B, held)

    @property
    def wrong(self) -> npt.NDArray[np.bool_]:
        """(n,) keyframes that are planted outliers."""
        return np.asarray(self.sequence.camera.outlier[self.frames], dtype=bool)


def generated(seed: int, folder: Path, workers: int) -> Path:
    """The tier with a global seed, generated into a folder unless it is there already."""
    spec = {**yaml.safe_load(TIER.read_text()), "global_seed": seed}
    folder.mkdir(parents=True, exist_ok=True)
    tier = folder / f"lab_{seed}.yaml"
    tier.write_text(yaml.safe_dump(spec, sort_keys=False))
    data = folder / f"data_{seed}"
    generate_dataset(
        str(tier), data, workers=workers, work_dir=folder / "logs", write_card=False, progress=False
    )
    return data


def samples(data: Path, tracks: list[str] | None = None) -> Iterator[Sample]:
    """All sequences of a generated tier."""
    for sequence in iter_sequences(data, tracks=tracks):
        A, B = sequence.axyb_poses()
        frames = np.flatnonzero(sequence.camera.has_measurement)
        chosen = select_keyframes(A, KEYFRAME_MIN_ROT_DEG, KEYFRAME_MIN_TRANS_M, MAX_KEYFRAMES)
        if len(chosen) < 3:
            chosen = np.arange(len(A))
        yield Sample(sequence, _group(sequence), A[chosen], B[chosen], frames[chosen])


def _group(sequence: Sequence) -> str:
    track, tags = sequence.config.track, sequence.config.tags
    if track == "outliers":
        return f"outliers {100 * tags['fraction']:.0f} %"
    if track != "motion":
        return str(track)
    if tags["subtrack"] == "cone":
        return f"cone {tags['cone_half_angle_deg']:g} deg"
    if tags["subtrack"] == "joint_subsets":
        return "parallel joints" if tags["subset"] == "parallel" else "all joints"
    return f"{tags['n_stations']} poses"
