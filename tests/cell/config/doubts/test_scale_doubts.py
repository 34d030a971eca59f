"""Values of a cell that are rather in another unit, or measured from another place: told, and never refused."""

from pathlib import Path

import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.gripper import HAND, LINKS
from cell.config.cell_file import read_cell
from cell.config.doubts.scale_doubts import scale_doubts
from typed.command_line import a465, replace_in

REGISTERS = "approach_mm_s = 80\nspeed_registers = [180, 180, 180, 171, 173, 171]"


@pytest.mark.parametrize(
    "cell", ["cell.toml", "realistic/cell.toml", "uncalibrated/cell.toml", "hoop/cell.toml", "pen/cell.toml"]
)
def test_nothing_is_doubtful_about_the_shipped_cells(cell: str) -> None:
    assert [*scale_doubts(read_cell(data_file(f"scenes/{cell}")))] == []


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("grip_height_mm = 15", "grip_height_mm = 0.015", "tool.grip_height_mm = 0.015: is it in metres? Then"),
        ("top_z_mm = 0", "top_z_mm = -0.02", "table.top_z_mm = -0.02: is it in metres? Then it must be -20 in mm"),
        ("moved_deg = 1.0", "moved_deg = 0.0175", "look.moved_deg = 0.0175: is it in rad? Then it must be 1 in deg"),
        ("approach_mm_s = 80", REGISTERS, "motion.speed_registers: J1 has 180, 2.3 % of the usual"),
        ("zone_size_mm = [440, 540, 216]", "zone_size_mm = [44, 54, 216]", "no board fits in it: is it in cm?"),
        ("zone_centre_mm = [470, -10, 110]", "zone_centre_mm = [47, -1, 110]", "the arm's base is in the zone"),
        ("top_z_mm = 0", "top_z_mm = -800", "the zone for boards begins 802 mm above the table's top"),
        ("[930, 0, 600]", "[930, 0, -600]", "would stand on it with centre_mm[2] = 600"),
    ],
)  # fmt: skip
def test_what_is_doubtful_is_told(scenes: Path, old: str, new: str, told: str) -> None:
    replace_in(scenes / "cell.toml", old, new)
    (found,) = scale_doubts(read_cell(scenes / "cell.toml"))
    assert told in found


def test_check_tells_the_doubts_of_a_cell(scenes: Path) -> None:
    """It is the cheapest command, and the first one after a file was edited."""
    at = ["check", str(scenes / "cell.toml"), "--q=-60,-40,-80,0,-60,0"]
    assert "NOTE" not in "".join(a465(*at))
    replace_in(scenes / "cell.toml", "[930, 0, 600]", "[930, 0, -600]")
    told = " ".join("".join(a465(*at)).split())
    assert told.count("NOTE: cell.toml: walls[0] (camera post): it is below") == 1


def test_a_wall_with_the_name_of_a_body_of_the_arm_is_told_in_its_file(scenes: Path) -> None:
    assert {*LINKS, *HAND} == {body.name for body in read_cell(scenes / "cell.toml").nominal_robot().bodies}
    replace_in(scenes / "cell.toml", '"camera post"', '"palm"')
    with pytest.raises(InputError, match=r"walls\[0\].name = 'palm': is that of a body of the arm"):
        read_cell(scenes / "cell.toml")
