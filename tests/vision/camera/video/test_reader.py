"""Frames are dated by their arrival and their stamps, and compared with the one before."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from vision.camera.frame_source import Image
from vision.camera.video.reader import Frame, FrameReader, Lateness, Pauses, grey, keep_coded, retrieve

NOISE = np.random.default_rng(0).integers(0, 256, (4, 6, 8), dtype=np.uint8)


class Script:
    """A device that delivers frames at given times with given stamps, in ms."""

    def __init__(self, *frames: tuple[float, float, Image | None]) -> None:
        self.now = 0.0
        self._frames = list(frames)
        self._stamp, self._image = 0.0, None

    def grab(self) -> bool:
        if not self._frames:
            return False
        self.now, self._stamp, self._image = self._frames.pop(0)
        return True

    def get(self, code: int) -> float:
        return self._stamp

    def retrieve(self) -> tuple[bool, Image | None]:
        return self._image is not None, self._image


def frames_of(script: Script, local: bool = False, use_stamps: bool = True, **options: Any) -> list[Frame]:
    """All that a reader makes of a script."""
    found: list[Frame] = []

    class Recorder(FrameReader):
        def _keep(self, frame: Frame) -> None:
            found.append(frame)
            super()._keep(frame)

    reader = Recorder(script, use_stamps, local, clock=lambda: script.now, **options)
    reader.want(True)
    reader.run()
    assert reader.fault is not None
    if reader.fault[0] != "removed":
        raise AssertionError(reader.fault)
    return found


def test_late_frames_are_dated_back_by_a_clock_that_is_not_ours() -> None:
    script = Script(
        *(
            (t, 1e3 * s, NOISE[0])
            for t, s in ((10.3, 1.1), (10.4, 1.3), (10.5, 1.4), (12.0, 1.5), (12.01, 2.9))
        )
    )
    taken = [frame.taken for frame in frames_of(script)]
    # the second is the promptest so far: 9.1 s behind; the fourth comes 1.4 s later than that
    assert taken == pytest.approx([10.3, 10.4, 10.5, 10.6, 12.0], abs=1e-3)


def test_a_slow_clock_of_a_device_does_not_make_frames_late_for_ever() -> None:
    lateness, drift = Lateness(), 1e-4
    late = [lateness.of(t, 5.0 + (1.0 - drift) * t, False) for t in np.arange(0.0, 7200.0, 0.5).tolist()]
    assert max(value for value in late if value is not None) < 1e-3


def test_stamps_of_the_hosts_own_clock_are_absolute() -> None:
    script = Script((100.5, 100.2e3, NOISE[0]), (100.6, 100.59e3, NOISE[1]))
    assert [frame.taken for frame in frames_of(script, local=True)] == pytest.approx([100.2, 100.59])
    script = Script((100.5, 20.2e3, NOISE[0]), (100.6, 20.3e3, NOISE[1]))  # since the device was opened
    assert [frame.taken for frame in frames_of(script, local=True)] == pytest.approx([100.5, 100.6])


def test_without_stamps_a_frame_is_dated_by_its_arrival() -> None:
    for stamps, used in (((0.0, 0.0), True), ((9.0, 9.0), False)):
        script = Script(
            (1.0, stamps[0], NOISE[0]), (1.1, stamps[1], NOISE[1])
        )  # as late as the first at most
        found = [(frame.received, frame.taken) for frame in frames_of(script, use_stamps=used)]
        assert found == [(1.0, 1.0), (1.1, pytest.approx(1.0))]


@pytest.mark.parametrize("second", [40.0, 39.0, 0.0])
def test_stamps_must_increase(second: float) -> None:
    script = Script((1.0, 40.0, NOISE[0]), (2.0, second, NOISE[1]), (3.0, 80.0, NOISE[2]))
    reader = FrameReader(script, True, False, clock=lambda: script.now)
    reader.run()
    assert reader.fault is not None
    assert reader.fault[0] == "stale"
    assert "is not after the one before (0.040 s)" in reader.fault[1]
    assert reader.next(0, 9.0) is None


def test_repeats_and_damage_are_seen() -> None:
    nearly = NOISE[0].copy()
    nearly[-1, -1] ^= 1
    images = (NOISE[0], NOISE[0], None, NOISE[0], nearly, NOISE[0])
    frames = frames_of(Script(*((float(k), 0.0, image) for k, image in enumerate(images))), first=NOISE[0])
    assert [frame.repeats for frame in frames] == [True, True, False, True, False, False]
    assert [frame.damaged for frame in frames] == [False, False, True, False, False, False]


def test_a_frame_that_nobody_wants_is_not_decoded() -> None:
    script = Script((1.0, 0.0, NOISE[0]))
    reader = FrameReader(script, True, False, clock=lambda: script.now)
    reader._read(0)
    frame = reader.next(0, 9.0)
    assert frame is not None
    assert (frame.number, frame.image, frame.damaged) == (1, None, False)
    assert reader.next(1, script.now) is None  # none newer


def test_colour_is_made_grey_and_other_forms_are_refused() -> None:
    assert np.unique(grey(np.full((4, 4, 3), (0, 0, 200), dtype=np.uint8))).tolist() == [60]  # 0.299 of red
    assert np.array_equal(grey(NOISE[0][..., None]), NOISE[0])
    assert np.array_equal(grey(NOISE[0]), NOISE[0])
    for wrong in (NOISE[0].astype(np.uint16), np.zeros((4, 4, 2), dtype=np.uint8)):
        with pytest.raises(ValueError, match="must be 8-bit grey or BGR"):
            grey(wrong)
        reader = FrameReader(Script((1.0, 0.0, wrong)), True, False)
        reader.want(True)
        reader.run()
        assert reader.fault is not None
        assert reader.fault[0] == "driver"


def test_what_may_have_been_held_back_during_a_pause_is_late_for_as_long_again() -> None:
    steady = [0.1 * n for n in range(10)]
    burst = [2.0 + 0.01 * n for n in range(10)]  # after a pause of 1.1 s
    pauses = Pauses(None)
    late = [pauses.of(t) for t in [*steady, *burst, 3.0, 3.15, 3.2]]
    assert max(late[:10]) < 0.25
    assert late[10:20] == pytest.approx([1.1] + [1.11] * 9, abs=0.02)
    assert late[20] > 1.1
    assert late[21] == pytest.approx(0.15 + 0.91)  # the pause of 0.91 s has ended less than that ago
    assert pauses.of(4.2) == pytest.approx(1.0)


@pytest.mark.parametrize("use_stamps", [True, False])
def test_what_waited_while_the_source_was_opened_is_late(use_stamps: bool) -> None:
    queued = ((2.0, 1000.0, NOISE[0]), (2.01, 1100.0, NOISE[1]), (2.02, 1200.0, NOISE[2]))
    script = Script(*queued, *((2.0 + 0.1 * n, 1900.0 + 100.0 * n, NOISE[n % 2]) for n in range(1, 40)))
    found = frames_of(script, use_stamps=use_stamps, opened=1.0)
    assert all(frame.taken <= 1.03 for frame in found[:3])
    assert all(frame.received - frame.taken < 0.25 for frame in found[-15:])


class Coded:
    """A stream that hands out one JPEG image as it was sent."""

    def __init__(self, data: bytes, fourcc: str = "MJPG") -> None:
        self.data, self.fourcc, self.made = data, fourcc, {}

    def get(self, code: int) -> float:
        return float(cv2.VideoWriter.fourcc(*self.fourcc)) if code == cv2.CAP_PROP_FOURCC else -1.0

    def set(self, code: int, value: float) -> bool:
        self.made[code] = value
        return True

    def retrieve(self) -> tuple[bool, Image]:
        return True, np.frombuffer(self.data, dtype=np.uint8)[None]


def test_jpeg_images_are_decoded_by_us_and_cut_ones_are_damaged() -> None:
    encoded, image = cv2.imencode(".jpg", np.kron(NOISE[0], np.ones((16, 16), np.uint8)))
    assert encoded
    stream, data = Coded(image.tobytes()), image.tobytes()
    assert keep_coded(stream)
    assert stream.made == {cv2.CAP_PROP_FORMAT: -1.0}
    np.testing.assert_array_equal(retrieve(stream, coded=True), cv2.imdecode(image, cv2.IMREAD_GRAYSCALE))
    assert retrieve(Coded(data[: len(data) * 2 // 3]), coded=True) is None
    assert retrieve(Coded(b"no image" + data[-2:]), coded=True) is None
    other = Coded(b"", "H264")
    assert not keep_coded(other)
    assert not other.made
