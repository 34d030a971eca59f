"""Recordings of a NAO: each mistake in the file is named."""

import copy
import json
import re
from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError
from calib.nao.recording import read_nao_recording
from recorded.nao import as_json, nao_recording
from recorded.nao_scenes import PAPER

PAGE = (Path(__file__).resolve().parents[3] / "docs/nao.md").read_text()


def read(tmp_path, value):
    path = tmp_path / "nao.json"
    path.write_text(json.dumps(value))
    return read_nao_recording(path)


def test_a_recording_is_read_as_it_was_written(tmp_path):
    recording, _ = nao_recording(6, PAPER, 2)
    value = as_json(recording)
    value["images"][1]["vertices_px"][3] = [None, None]
    back = read(tmp_path, value)
    assert back.leg == pytest.approx(recording.leg, abs=1e-12)
    assert back.head == pytest.approx(recording.head, abs=1e-12)
    assert back.side.tolist() == recording.side.tolist()
    assert np.isnan(back.pixels[1, 3]).all()
    assert np.isfinite(back.pixels).sum() == back.pixels.size - 2


def example():
    """The recording in docs/nao.md."""
    return json.loads(re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)[1])


def test_the_example_of_the_page_shows_what_the_page_says(tmp_path):
    """A robot without errors sees the vertices there: frames, signs, units and orders are those of the model."""
    recording = read(tmp_path, example())
    unseen = 0
    for s in recording.sightings(PAPER):
        T = s.evaluate(np.zeros(len(PAPER.names)), np.zeros_like(s.readings)).T
        x, y, z = np.moveaxis(np.einsum("nij,mj->nmi", T[:, :3, :3], s.points) + T[:, None, :3, 3], -1, 0)
        expected = np.stack([324.0 + 562.5 * x / z, 189.0 + 562.5 * y / z], axis=-1)
        seen = np.isfinite(s.pixels)
        unseen += np.count_nonzero(~seen.all(axis=-1))
        assert np.abs(s.pixels - expected)[seen].max() < 0.006
    assert unseen == 1
    assert recording.camera.size == (640, 480)


KEYS = re.findall(r"^\| `([\w.\[\]]+)` \|", PAGE, re.MULTILINE)


@pytest.mark.parametrize("key", KEYS)
def test_every_key_of_the_page_is_needed(tmp_path, key):
    value = example()
    *parents, last = key.replace("[]", ".1").split(".")
    of = value
    for name in parents:
        of = of[int(name)] if name.isdigit() else of[name]
    del of[last]
    with pytest.raises(FileInputError) as caught:
        read(tmp_path, value)
    assert caught.value.data["key"] == key.replace("[]", "[1]")
    assert caught.value.data["rule"] == "is missing"


def test_no_other_key_is_needed():
    def keys(value, at=""):
        if isinstance(value, dict):
            for name, inner in value.items():
                yield from keys(inner, f"{at}.{name}".lstrip("."))
        elif isinstance(value, list) and isinstance(value[0], dict):
            yield at
            yield from keys(value[0], f"{at}[]")
        else:
            yield at

    assert sorted(keys(example())) == sorted(KEYS)


def test_an_image_that_is_there_twice_is_refused(tmp_path):
    value = example()
    again = copy.deepcopy(value["images"][1]) | {"stance": 7}
    value["images"] += [copy.deepcopy(value["images"][0]) | {"vertices_px": again["vertices_px"]}, again]
    with pytest.raises(FileInputError, match=r"nao\.json: images\[3\]: repeats images\[1\]") as caught:
        read(tmp_path, value)
    assert (caught.value.data["key"], caught.value.exit_code) == ("images[3]", 2)
    for change in ({"side": "L"}, {"head_encoder_deg": [-19.0, -6.1]}, {"leg_encoder_deg": [1] * 6}):
        value["images"][3] = again | change
        assert len(read(tmp_path, value).pixels) == 4
    value["images"][3] = again
    again["vertices_px"][2][0] += 0.01
    assert len(read(tmp_path, value).pixels) == 4


def test_vertices_may_lie_outside_the_image(tmp_path):
    value = example()
    value["images"][0]["vertices_px"][0] = [-60.0, 900.0]
    assert read(tmp_path, value).pixels[0, 0].tolist() == [-60.0, 900.0]


def test_a_recording_of_an_arm_is_sent_to_its_own_command(tmp_path):
    for value in ({"poses": [], "dh": {}}, {"poses": 3, "camera": example()["camera"]}):
        with pytest.raises(
            FileInputError, match=r"nao\.json: is a recording of an arm.*a465 calibrate hand-eye"
        ):
            read(tmp_path, value)


@pytest.mark.parametrize(
    ("break_it", "said"),
    [
        (lambda v: v["camera"].pop("focal_px"), "camera.focal_px: is missing"),
        (lambda v: v["camera"].update(focal_px=-3), "camera.focal_px = -3: must be above 0 px"),
        (
            lambda v: v["camera"].update(focal_px=3.6),
            "camera.focal_px = 3.6: must have a focal length of 160 px",
        ),
        (
            lambda v: v["camera"].update(centre_px=[700, 240]),
            "camera.centre_px = [700, 240]: must have its principal",
        ),
        (
            lambda v: v["camera"].update(size_px=[0, 480]),
            "camera.size_px = [0, 480]: must be width and height in px",
        ),
        (
            lambda v: v["board"].update(
                vertices_sole_m=[[1e3 * x for x in vertex] for vertex in v["board"]["vertices_sole_m"]]
            ),
            "board.vertices_sole_m: must be within 10 m (are these mm?)",
        ),
        (lambda v: v["board"].update(vertices_sole_m=[[0, 0, 0]] * 3), "must have at least 4 vertices"),
        (
            lambda v: v.update(gravity_m_s2=[-9.81e3, 0, 0]),
            "gravity_m_s2 = [-9810.0, 0, 0]: must have a magnitude of 9.81",
        ),
        (
            lambda v: v["board"].update(vertices_sole_m=[[0.01 * k, 0, 0] for k in range(24)]),
            "board.vertices_sole_m: must have vertices that do not all lie on one line",
        ),
        (lambda v: v.pop("gravity_m_s2"), "gravity_m_s2: is missing"),
        (lambda v: v.update(images=[]), "images = []: must have at least one image"),
        (lambda v: v["images"][2].update(side="left"), "images[2].side = 'left': must be one of L, R"),
        (lambda v: v["images"][2].update(stance=1.5), "images[2].stance = 1.5: must be a whole number"),
        (
            lambda v: v["images"][2].update(leg_encoder_deg=[1, 2]),
            "images[2].leg_encoder_deg = [1, 2]: must be 6",
        ),
        (
            lambda v: [
                i.update(leg_encoder_deg=np.radians(i["leg_encoder_deg"]).tolist()) for i in v["images"]
            ],
            "deg in all 6 images (are these rad?)",
        ),
        (
            lambda v: v["images"][2].update(head_encoder_deg=[-10.0, 55.0]),
            "images[2].head_encoder_deg = [-10.0, 55.0]: must be HeadYaw and HeadPitch, which is within +-40 deg (are",
        ),
        (lambda v: v["images"][2]["vertices_px"].pop(), "images[2].vertices_px: must be 24 rows of 2"),
        (
            lambda v: v["images"][2].update(vertices_px=[[1, 2]] * 3 + [[None, None]] * 21),
            "images[2].vertices_px: must have at least 4 vertices",
        ),
    ],
)
def test_what_breaks_the_format_is_named(tmp_path, break_it, said):
    value = as_json(nao_recording(6, PAPER, 1)[0])
    break_it(value)
    with pytest.raises(FileInputError) as caught:
        read(tmp_path, value)
    assert said in str(caught.value)
    assert "nao.json" in str(caught.value)


def test_truth_and_noise_are_never_read(tmp_path):
    value = as_json(nao_recording(7, PAPER, 2)[0])
    whole = read(tmp_path, value)
    value.pop("truth")
    value["noise"] = None
    bare = read(tmp_path, value)
    for name in ("board", "gravity", "side", "stance", "leg", "head", "pixels"):
        assert getattr(bare, name).tobytes() == getattr(whole, name).tobytes()
    assert bare.camera.digest == whole.camera.digest
