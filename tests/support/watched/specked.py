"""A simulated cell whose table shows specks and scratches, so that its camera can be watched."""

from __future__ import annotations

from pathlib import Path

TABLE = """
[table]
grain_grey = 1.5
specks_per_m2 = 600
scratches_per_m2 = 60
"""


def specked_world(
    scenes: Path, turned_deg: tuple[float, float, float] | None = None, name: str = "world.toml"
) -> Path:
    """The world of task 2 with specks; the camera has turned since its calibration."""
    turned = "" if turned_deg is None else f"\n[image]\nturned_deg = {list(turned_deg)}\n"
    file = scenes / name
    file.write_text((scenes / "task2.world.toml").read_text() + TABLE + turned)
    return file
