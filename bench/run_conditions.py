"""What a benchmark prints first: its date, commit, versions and processors."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import date

import cv2
import numpy as np


def run_conditions() -> str:
    """Return one line; the commit is that of the current folder."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    ).stdout.strip()
    return (
        f"{date.today()}, commit {commit}, numpy {np.__version__}, OpenCV {cv2.__version__}, Python "
        f"{platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    )
