"""An observation of the cell: poses of boards, occupancy of their holes, and why other boards were not detected.

`vision.observe` makes it from images, a file of detected boards keeps it, and planning takes it as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from arm.poses import BoardPose, HolePose
from vision.background.camera_shift import CameraShift
from vision.camera.model import Image
from vision.markers.detect import Marker
from vision.occupancy.classify import HoleState, Occupancy


@dataclass(frozen=True)
class ObservedBoard:
    """A detected board: its pose, and the occupancy of its holes in the order of its CSV."""

    pose: BoardPose
    occupancy: tuple[Occupancy, ...]

    @property
    def name(self) -> str:
        """Name of the board."""
        return self.pose.board.name

    def holes(self, *states: HoleState) -> tuple[HolePose, ...]:
        """Return the holes in one of these states."""
        holes = zip(self.pose.holes, self.occupancy, strict=True)
        return tuple(hole for hole, now in holes if now.state in states)


@dataclass(frozen=True)
class Observation:
    """The boards detected in images of a cell at rest, and why others were not.

    Attributes:
        boards: detected boards, in the order requested.
        missing: per board name, the reason why it was not detected.
        half_seen: names of missing boards that are partly in view, so that their pose is unknown.
        images: from which it was made; empty if it was read from a file.
        frames: markers detected in each image.
        camera_shift: rotation of the camera since its calibration, for which images and poses are corrected; None if it
            was not measured.
        moved_since: places that cubes left or reached after the images were taken.
    """

    boards: tuple[ObservedBoard, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    half_seen: tuple[str, ...] = ()
    images: tuple[Image, ...] = field(default=(), compare=False, repr=False)
    frames: tuple[tuple[Marker, ...], ...] = field(default=(), compare=False, repr=False)
    camera_shift: CameraShift | None = field(default=None, compare=False)
    moved_since: frozenset[str] = field(default=frozenset(), compare=False)

    @property
    def poses(self) -> tuple[BoardPose, ...]:
        """Poses of the detected boards."""
        return tuple(b.pose for b in self.boards)

    def board(self, name: str) -> ObservedBoard | None:
        """Return the board of that name, or None if it was not detected."""
        return next((b for b in self.boards if b.name == name), None)

    def state(self, place: str) -> HoleState | None:
        """Return the state of a hole such as ``01-02/3``; None if it is no hole, or its board was not detected."""
        name, _, number = place.rpartition("/")
        board = self.board(name)
        return None if board is None else board.occupancy[int(number) - 1].state

    def with_states(self, states: Mapping[str, HoleState]) -> Observation:
        """Return the observation with other states of some holes such as ``01-02/3``; ignore other names."""
        boards = []
        for board in self.boards:
            holes = zip(board.pose.holes, board.occupancy, strict=True)
            occupancy = tuple(Occupancy(states[h.name]) if h.name in states else now for h, now in holes)
            boards.append(replace(board, occupancy=occupancy))
        return replace(self, boards=tuple(boards))

    def with_moves(self, moves: Mapping[str, str]) -> Observation:
        """Return the observation to expect after `moves`: from cubes, named by their hole, to places."""
        states: dict[str, HoleState] = {cube.removeprefix("cube "): "empty" for cube in moves}
        states |= dict.fromkeys(moves.values(), "cube")
        return replace(self.with_states(states), moved_since=self.moved_since | states.keys())

    def changed(self, expected: Observation) -> list[str]:
        """Describe the holes whose state certainly differs from the expected one, one line per hole."""
        lines = []
        for board in self.boards:
            for hole, now in zip(board.pose.holes, board.occupancy, strict=True):
                was = expected.state(hole.name)
                if was not in (None, now.state, "unsure") and now.state != "unsure":
                    lines.append(f"hole {hole.name} looks {now.state}, not {was}")
        return lines
