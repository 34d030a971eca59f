"""Network cameras on this machine: how old are the frames that a look is given?

python bench/streams.py --runs 10

Servers of motion JPEG, by HTTP and by RTSP, send 25 frames/s of 128 x 80 px that carry the time at which they were
taken. "alone": age of the frame that cv2.VideoCapture gives after an idle time. "here": when the first frame of a look
of VideoCamera (latency_s 0.05) was taken after the look's request, the least of all runs; below 0 it would be stale.
"held": the network holds frames back from 0.3 s before the request until 0.4 s after it, and then hands all over.
"""

from __future__ import annotations

import argparse
import platform
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from video.http_camera import http_camera
from video.rtsp_camera import rtsp_camera
from video.timed_frames import TimedCamera, time_of
from vision.camera.video.camera import VideoCamera
from vision.camera.video.settings import VideoSettings

PERIOD_S, LATENCY_S, BEFORE_S, AFTER_S = 0.04, 0.05, 0.3, 0.4


def age_alone(url: str, idle_s: float) -> float:
    """Age of the first frame that OpenCV's capture gives after an idle time, s."""
    device = cv2.VideoCapture(url, cv2.CAP_FFMPEG)
    device.grab()
    time.sleep(idle_s)
    device.grab()
    now, (_, image) = time.monotonic(), device.retrieve()
    device.release()
    return now - time_of(np.asarray(image[..., 0], dtype=np.uint8))


def taken_after(camera: VideoCamera) -> float:
    """When the first frame of a look was taken after its request, s."""
    asked = time.monotonic()
    return time_of(camera.grab(1)[0]) - asked


def held(camera: VideoCamera, sender: TimedCamera) -> float:
    """The same while the network holds frames back."""
    sender.held = True
    time.sleep(BEFORE_S)
    threading.Timer(AFTER_S, setattr, (sender, "held", False)).start()
    return taken_after(camera)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--idle-s", type=float, default=2.0)
    args = parser.parse_args()
    print(
        f"Python {platform.python_version()}, OpenCV {cv2.__version__}; {args.runs} runs, idle {args.idle_s:g} s\n"
    )
    print(
        "| stream | alone, idle: age, s | here, opened in, s | here, idle: after the request by, s | here, held, s |"
    )
    print("|---|---|---|---|---|")
    for name, serve in (("HTTP", http_camera), ("RTSP", rtsp_camera)):
        with serve(TimedCamera(PERIOD_S)) as selector:
            alone = age_alone(selector.removeprefix("video:"), args.idle_s)
        sender, idle, late = TimedCamera(PERIOD_S), [], []
        began = time.monotonic()
        with serve(sender) as selector, VideoCamera(selector, VideoSettings(latency=LATENCY_S)) as camera:
            opened_s = time.monotonic() - began
            for _ in range(args.runs):
                time.sleep(args.idle_s)
                idle.append(taken_after(camera))
                late.append(held(camera, sender))
        print(f"| {name} | {alone:.2f} | {opened_s:.2f} | {min(idle):.2f} | {min(late):.2f} |", flush=True)


if __name__ == "__main__":
    main()
