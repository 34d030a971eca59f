"""What a hand-eye calibration changes of a cell: how far the camera has moved, and the joint offsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.robot.shapes import Box
from arm.se3 import Array, angle_between, apply
from calib.hand_eye.calibrate import HandEye
from calib.hand_eye.verdict import WorkPlace
from cell.config.cell import Cell
from cell.report.chain import Changed

_ACROSS = np.array([-0.4, 0.0, 0.4])  # of the zone
_SURE = 2.0  # standard deviations from which a change is told
_CAMERA_AND_OFFSETS = 6


@dataclass(frozen=True, eq=False)
class CellChange:
    """Differences between a calibration and the cell.

    Attributes:
        cell: name of the cell file, with its calibration if it has one.
        camera: distance (m) and angle (rad) between the poses of the camera.
        camera_sigma: their standard deviations, m and rad.
        offsets: changes of the joint offsets, (joints,) rad.
        offset_sigma: their standard deviations, (joints,) rad.
        shift: of the camera in the base frame, (3,) m, and its standard deviations.
        before: joint offsets of the cell, (joints,) rad.
        links: largest change of a link's length (m) and of an alpha (rad); of the last link none is used.
    """

    cell: str
    camera: tuple[float, float]
    camera_sigma: tuple[float, float]
    offsets: Array
    offset_sigma: Array
    links: tuple[float, float]
    shift: tuple[Array, Array]
    before: Array

    @property
    def rows(self) -> tuple[Changed, ...]:
        """What changed, for a page."""
        moved, sigma = (1e3 * v for v in self.shift)
        were, are, spread = (
            np.degrees(v) for v in (self.before, self.before + self.offsets, self.offset_sigma)
        )
        return (
            *(Changed(f"camera {'xyz'[k]}, mm", 0.0, float(moved[k]), float(sigma[k])) for k in range(3)),
            *(
                Changed(f"J{j + 1}, deg", float(were[j]), float(are[j]), float(spread[j]))
                for j in range(len(were))
            ),
        )

    def __str__(self) -> str:
        mm, deg = 1e3 * self.camera[0], float(np.degrees(self.camera[1]))
        moved = any(v > _SURE * s for v, s in zip(self.camera, self.camera_sigma, strict=True))
        changes = [f"camera {'moved' if moved else 'as before, within'} {_mm(mm)}, {_deg(deg)}"]
        turned = np.abs(self.offsets) > _SURE * self.offset_sigma
        changes += [
            ", ".join(f"J{j + 1} {_deg(np.degrees(self.offsets[j]), '+')}" for j in np.flatnonzero(turned))
        ]
        if any(self.links):
            changes += [f"links by up to {_mm(1e3 * self.links[0])}, {_deg(np.degrees(self.links[1]))}"]
        return f"{'; '.join(filter(None, changes))} (against {self.cell})"

    def json(self) -> dict[str, Any]:
        """Return the change as JSON types."""
        return {
            "against": self.cell,
            "camera_mm": 1e3 * self.camera[0],
            "camera_deg": float(np.degrees(self.camera[1])),
            "joints_deg": np.degrees(self.offsets).tolist(),
            "links_mm": 1e3 * self.links[0],
            "links_deg": float(np.degrees(self.links[1])),
        }


def _mm(value: float) -> str:
    return f"{value:.{1 if value >= 1.0 else 2}f} mm"


def _deg(value: float, sign: str = "") -> str:
    return f"{value:{sign}.{2 if abs(value) >= 0.1 else 3}f} deg"


def change_of(found: HandEye, cell: Cell) -> CellChange:
    """Compare a calibration with what the cell uses now, its own calibration included."""
    before = cell.calibration
    T, was = found.T_base_camera, cell.camera.T_base_camera
    links = np.array(found.link_errors)[:, :-1]
    offsets = np.asarray(found.joint_offsets)
    if before is not None:
        links = links - np.array([before.links.d, before.links.a, before.links.alpha])[:, :-1]
        offsets = offsets - before.joint_offsets
    sigma = np.sqrt(np.diag(found.covariance))[_CAMERA_AND_OFFSETS : _CAMERA_AND_OFFSETS + len(offsets)]
    name = cell.file.name if before is None else f"{cell.file.name} with {before.id}"
    metres, radians = (float(np.linalg.norm(of)) for of in found.camera_sigma)
    offsets_were = np.zeros(len(offsets)) if before is None else np.asarray(before.joint_offsets)
    return CellChange(
        name,
        (float(np.linalg.norm(T[:3, 3] - was[:3, 3])), angle_between(T[:3, :3], was[:3, :3])),
        (metres, radians),
        offsets,
        sigma,
        (float(np.abs(links[:2]).max()), float(np.abs(links[2]).max())),
        (T[:3, 3] - was[:3, 3], found.camera_sigma[0]),
        offsets_were,
    )


def work_place(cell: Cell) -> WorkPlace:
    """Return where a calibration of this cell is to be right: all over the zone of its boards."""
    tool = cell.tool.T_flange_tool
    if not isinstance(cell.zone.shape, Box):
        return WorkPlace(None, tool)
    grid = np.stack(np.meshgrid(_ACROSS, _ACROSS, _ACROSS[::2], indexing="ij"), axis=-1).reshape(-1, 3)
    return WorkPlace(apply(cell.zone.T_base_body, grid * np.array(cell.zone.shape.size)), tool)
