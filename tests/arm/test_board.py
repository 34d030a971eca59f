"""Board files exactly as users have them, and every way in which one can be wrong."""

from pathlib import Path

import numpy as np
import pytest

from arm.board import read_board_csv
from arm.errors import FileInputError
from arm.io.storage import data_file


@pytest.mark.parametrize(
    "text", ["1,2\r\n0,80\r\n80,60\r\n100,140\r\n140,0", "1,2\n0,80\n80,60\n100,140\n140,0\n\n"]
)
def test_line_ends_do_not_matter(tmp_path: Path, text: str) -> None:
    path = tmp_path / "b.csv"
    path.write_bytes(text.encode())
    board = read_board_csv(path, 0.036)
    assert (board.name, board.marker_ids) == ("01-02", (1, 2))
    assert board.holes.tolist() == [[0, 0.08, 0], [0.08, 0.06, 0], [0.1, 0.14, 0], [0.14, 0, 0]]


def test_the_known_boards() -> None:
    folder = data_file("scenes/boards")
    boards = [read_board_csv(p, 0.036) for p in sorted(folder.glob("*.csv"))]
    assert [b.marker_ids for b in boards] == [(1, 2), (3, 4), (5, 6), (7, 8), (9, 10), (11, 12)]
    gaps = [np.linalg.norm(b.holes[i] - b.holes[j]) for b in boards for i in range(4) for j in range(i)]
    assert min(gaps) > 0.080  # the nearest pair is 82 mm apart, centre to centre


def test_marker_corners() -> None:
    corners = read_board_csv(data_file("scenes/boards/positions_plate_01-02.csv"), 0.036).marker_corners()
    assert corners[0].tolist() == [
        [-0.018, 0.018, 0],
        [0.018, 0.018, 0],
        [0.018, -0.018, 0],
        [-0.018, -0.018, 0],
    ]
    assert corners[1].mean(axis=0) == pytest.approx([0.18, 0.14, 0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n0,80\n80,60\n100,140", "4 lines"),
        ("id,id\n0,80\n80,60\n100,140\n140,0", r"line 1 = 'id,id': must be two marker ids"),
        ("1,1\n0,80\n80,60\n100,140\n140,0", "two different"),
        ("1,2.5\n0,80\n80,60\n100,140\n140,0", "marker ids from 0 to 999"),
        ("1,2\n0,80\nab,60\n100,140\n140,0", r"line 3 = 'ab,60': must be x,y of a hole in mm"),
        ("1,2\n0,80\n80;60\n100,140\n140,0", "line 3"),
        ("1,2\n0,80,5\n80,60\n100,140\n140,0", "line 2"),
        ("1,2\n0,800\n80,60\n100,140\n140,0", "partly off the plate"),
        ("1,2\n0,nan\n80,60\n100,140\n140,0", "finite"),
    ],
)
def test_every_mistake_is_reported_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "b.csv"
    path.write_text(text)
    with pytest.raises(FileInputError, match=message) as error:
        read_board_csv(path, 0.036)
    assert str(path) in str(error.value)


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "b.csv"
    path.write_bytes(b"\xff\xfe1\x00,\x00")
    with pytest.raises(FileInputError, match="is UTF-16 text"):
        read_board_csv(path, 0.036)


LAB = sorted(data_file("scenes/boards").glob("*.csv"))


@pytest.mark.parametrize(
    ("scale", "swap", "meant"),
    [
        (1e-3, False, "these are metres: multiply them by 1000"),
        (0.1, False, "these are centimetres: multiply them by 10"),
        (1.0, True, "x and y are swapped: x runs along the plate's long side"),
        (1e-3, True, "these are metres, and x and y are swapped"),
    ],
)
@pytest.mark.parametrize("lab", LAB, ids=[p.stem[-5:] for p in LAB])
def test_other_units_and_swapped_axes_are_named(
    tmp_path: Path, lab: Path, scale: float, swap: bool, meant: str
) -> None:
    """On every board of the lab: four holes within 0.14 mm of each other are no board."""
    ids, *holes = lab.read_text().split()
    pairs = [[scale * float(v) for v in hole.split(",")][:: -1 if swap else 1] for hole in holes]
    path = tmp_path / "b.csv"
    path.write_text("\n".join([ids, *(f"{x:.10g},{y:.10g}" for x, y in pairs)]))
    with pytest.raises(FileInputError, match=meant):
        read_board_csv(path, 0.036)


@pytest.mark.parametrize(
    ("holes", "message"),
    [
        (
            "0,80\n80,60\n100,140\n140,-9",
            r"line 5 = '140,-9': puts its mouth of 44 mm partly off the plate.* y from -8 to 148 mm",
        ),
        ("0,45\n80,60\n100,140\n140,0", r"line 2 = '0,45': lies on the marker at 0, 0 mm .* at least 46 mm"),
        ("0,80\n80,60\n100,140\n135,100", r"line 5 = '135,100': lies on the marker at 180, 140 mm"),
        ("0,80\n80,60\n100,140\n43,95", r"line 5 = '43,95': is 43 mm from hole 1"),
    ],
)
def test_holes_that_no_plate_can_have(tmp_path: Path, holes: str, message: str) -> None:
    path = tmp_path / "b.csv"
    path.write_text(f"1,2\n{holes}")
    with pytest.raises(
        FileInputError, match=f"{message}.*millimetres from the centre of the lower-ID marker"
    ):
        read_board_csv(path, 0.036)


def test_a_separator_that_is_no_comma_is_told(tmp_path: Path) -> None:
    file = tmp_path / "board.csv"
    for line, told in (
        ("0;80", r"line 2 = '0;80': must be x,y of a hole in mm \(a comma stands between them\)$"),
        ("0,x", r"must be x,y of a hole in mm$"),
    ):
        file.write_text(f"1,2\n{line}\n80,60\n100,140\n140,0\n")
        with pytest.raises(FileInputError, match=told):
            read_board_csv(file, 0.036)


ROWS = "0,80\n80,60\n100,140\n140,0"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"id1,id2\n1,2\n{ROWS}", "(line 1 is 'id1,id2': a board file has no header and no words)"),
        (f"# mine\n1,2\n{ROWS}", "(line 1 is a comment, and a board file has none)"),
        (f"1,2\n\n{ROWS}", "(line 2 is empty)"),
        (f'"1","2"\n{ROWS}', "(numbers stand without quotation marks)"),
        (f"1,2,,\n{ROWS}", "(the commas at its end are those of empty cells: remove them)"),
        ("1,2\n0,80,0\n80,60\n100,140\n140,0", "(it has 3 values)"),
        ("1,2\n0 mm,80 mm\n80,60\n100,140\n140,0", "(numbers stand without their unit)"),
        ("1,2\n0,0;80,0\n80,60\n100,140\n140,0", "a comma stands between the two)"),
        ("1,2\n0,3.15\n3.15,2.362\n3.937,5.512\n5.512,0", "these are inches: multiply them by 25.4)"),
        ("1,2\n0,-80\n80,-60\n100,-140\n140,0", "y points down: it points up in the picture of the marker"),
        ("1,2\n-90,10\n-10,-10\n10,70\n50,-70", "these are from the plate's centre: add 90 and 70)"),
        ("1,2\n30,110\n110,90\n130,170\n170,30", "these are from the plate's corner: subtract 30 and 30)"),
        ("1,2\n-180,-60\n-100,-80\n-80,0\n-40,-140", "these are from the marker with the higher id: add 180 and 140)"),
    ],
)  # fmt: skip
def test_what_a_spreadsheet_or_another_origin_makes_of_it_is_told(
    tmp_path: Path, text: str, told: str
) -> None:
    path = tmp_path / "board.csv"
    path.write_text(text)
    with pytest.raises(FileInputError) as refused:
        read_board_csv(path, 0.036)
    assert told in str(refused.value)
