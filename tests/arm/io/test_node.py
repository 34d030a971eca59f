"""Values of a JSON file, read from the outside in: file, key and rule are in every error."""

import json

import numpy as np
import pytest

from arm.errors import FileInputError, InputError
from arm.io.node import Node
from arm.io.rules import integer, line, number, numbers


@pytest.fixture
def root(tmp_path):
    path = tmp_path / "some.json"
    content = {
        "a": {"b": [1, 2.5, None]},
        "rows": [[1, 2], [3, 4]],
        "ragged": [[1, 2], [3]],
        "empty": [],
        "flag": True,
        "count": 3,
        "part": 3.0,
        "huge": [1e400],
        "name": "L",
        "items": [{"x": 1}, {"y": 2}],
        "long": [[1, 2], [3, -(10**400)]],
        "long_count": 10**400,
        "long_text": "x" * 1000,
        "far": [1.0, 1.001e9],
        "near": [1e9, -1e9, 0.0],
        "deep": json.loads("[" * 80 + "1" + "]" * 80),
        "half": "a\ud800",
        "line": "ab\nc",
        "ruled": "a\u2028b",
        "written": "Žižkov 🦾, 5 mm",
    }
    path.write_text(json.dumps(content).replace("Infinity", "1e400"))
    return Node.of_json(path)


def refusal(call):
    with pytest.raises(FileInputError) as caught:
        call()
    return str(caught.value)


def test_values_are_read(root):
    assert root["rows"].read(numbers((2, 2))).tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert root["rows"].read(numbers((None, 2))).shape == (2, 2)
    assert not root["rows"].read(numbers((None, 2))).flags.writeable
    assert float(root["part"].read(number())) == 3.0
    assert root["count"].read(integer(0, 3)) == 3
    assert root["name"].read(line("L", "R")) == "L"
    assert [node.key for node in root["items"].items()] == ["items[0]", "items[1]"]
    assert root["near"].read(numbers(3)).tolist() == [1e9, -1e9, 0.0]
    assert root["written"].read(line()) == "Žižkov 🦾, 5 mm"
    assert "a" in root
    assert "z" not in root
    assert "z" not in root["count"]


def test_null_is_a_number_only_where_gaps_are_allowed(root):
    gaps = root["a"]["b"].read(numbers(3, gaps=True))
    assert np.isnan(gaps[2])
    assert "a.b = [1, 2.5, None]: must be 3 finite numbers" in refusal(
        lambda: root["a"]["b"].read(numbers(3))
    )


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda r: r["z"], "z: is missing"),
        (lambda r: r["items"].items()[1]["x"], "items[1].x: is missing"),
        (lambda r: r["count"]["x"], "count = 3: must be a table"),
        (lambda r: r["a"].items(), "a = {'b': [1, 2.5, None]}: must be a list"),
        (
            lambda r: r["rows"].read(numbers((2, 3))),
            "rows = [[1, 2], [3, 4]]: must be 2 rows of 3 finite numbers",
        ),
        (lambda r: r["rows"].read(numbers(None)), "rows = [[1, 2], [3, 4]]: must be finite numbers"),
        (
            lambda r: r["ragged"].read(numbers((None, 2))),
            "ragged = [[1, 2], [3]]: must be rows of 2 finite numbers",
        ),
        (lambda r: r["empty"].read(numbers(None)), "empty = []: must be finite numbers"),
        (lambda r: r["huge"].read(numbers(1, gaps=True)), "huge = [inf]: must be 1 finite numbers, or null"),
        (lambda r: r["name"].read(number()), "must be a finite number"),
        (lambda r: r["flag"].read(integer(0, 5)), "must be a whole number from 0 to 5"),
        (lambda r: r["part"].read(integer(0, 5)), "must be a whole number from 0 to 5"),
        (lambda r: r["count"].read(integer(0, 2)), "count = 3: must be a whole number from 0 to 2"),
        (lambda r: r["name"].read(line("R", "S")), "must be one of R, S"),
        (lambda r: r["count"].read(line()), "must be a string"),
        (lambda r: r["long"].read(numbers((2, 2))), "long[1][1]: must be from -1e+09 to 1e+09"),
        (lambda r: r["long_count"].read(number()), "long_count: must be from -1e+09 to 1e+09"),
        (lambda r: r["far"].read(numbers(None)), "far[1] = 1001000000.0: must be from -1e+09 to 1e+09"),
        (lambda r: r["long_count"].read(integer(0, 5)), "long_count: must be a whole number from 0 to 5"),
        (lambda r: r["long_text"].read(line("L")), " characters left out .. xxx"),
        (lambda r: r["deep"].read(numbers(None)), "must be finite numbers"),
        (lambda r: r["items"].read(numbers(2)), "must be 2 finite numbers"),
        (
            lambda r: r["half"].read(line()),
            r"half = 'a\ud800': must be a string of one line; character 1 is half a surr",
        ),
        (
            lambda r: r["line"].read(line()),
            r"line = 'ab\nc': must be a string of one line; character 2 is a control",
        ),
        (lambda r: r["ruled"].read(line()), "character 1 is a line end"),
        (lambda r: r["a\nb\ud800"], r"a\nb\ud800: is missing"),
    ],
)
def test_what_breaks_a_rule_is_named_with_file_and_key(root, read, said):
    message = refusal(lambda: read(root))
    assert said in message
    assert "some.json" in message
    assert len(message.splitlines()) == 1
    assert len(message) < 320
    assert message.encode()


def test_files_that_are_not_json_are_refused(tmp_path):
    (tmp_path / "bad.json").write_text("{")
    (tmp_path / "long.json").write_text('{"a": ' + "9" * 5000 + "}")  # more digits than Python reads
    for name in ("bad.json", "none.json", "long.json"):
        with pytest.raises(InputError, match=name):
            Node.of_json(tmp_path / name)
