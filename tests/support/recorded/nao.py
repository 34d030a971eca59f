"""Recordings of a NAO that looks at its own soles, from the scenes of `recorded.nao_scenes`."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm.se3 import Array, frozen
from calib.nao.chain import SIDES, NaoUnknowns
from calib.nao.recording import NaoRecording
from recorded.nao_scenes import BOARD, CAMERA, ON_ITS_BACK, STEP, sightings


def nao_recording(
    seed: int, true: NaoUnknowns, stances: int = 8, step: float = STEP
) -> tuple[NaoRecording, Array]:
    """A recording and its truth, SI."""
    found, x = sightings(seed, true, NaoUnknowns(), stances, step)
    side = np.concatenate([np.full(len(s.readings), number) for number, s in enumerate(found)])
    readings = np.concatenate([s.readings for s in found])
    pixels = np.concatenate([s.pixels for s in found])
    stance = np.tile(np.repeat(np.arange(stances), 3), 2)
    recording = NaoRecording(
        CAMERA,
        BOARD,
        np.array(ON_ITS_BACK),
        frozen(side),
        frozen(stance),
        readings[:, :6],
        readings[:, 6:],
        pixels,
    )
    return recording, x


def as_json(r: NaoRecording) -> dict[str, Any]:
    """The recording as a file has it."""
    return {
        "camera": {
            "focal_px": float(r.camera.K[0, 0]),
            "centre_px": r.camera.K[:2, 2].tolist(),
            "size_px": list(r.camera.size),
        },
        "noise": {"pixel_sigma": 0.04},
        "board": {"vertices_sole_m": r.board.tolist()},
        "gravity_m_s2": r.gravity.tolist(),
        "images": [
            {
                "side": SIDES[int(side)],
                "stance": int(stance),
                "leg_encoder_deg": np.degrees(leg).tolist(),
                "head_encoder_deg": np.degrees(head).tolist(),
                "vertices_px": pixels.tolist(),
            }
            for side, stance, leg, head, pixels in zip(r.side, r.stance, r.leg, r.head, r.pixels, strict=True)
        ],
        "truth": {"CamPitch_deg": 0.4},
    }
