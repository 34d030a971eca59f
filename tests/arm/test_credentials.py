"""No user, password or key of a URL is printed or stored."""

from __future__ import annotations

import pytest

from arm.credentials import hide_credentials
from arm.errors import A465Error, FileInputError


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("rtsp://me:secret@host:554/a:b", "rtsp://***@host:554/a:b"),
        ("rtsp://secret@host/1", "rtsp://***@host/1"),
        ("rtsp://me:sec@ret@host/1", "rtsp://***@host/1"),
        ("rtsp://me:sec/r?e=t@host/1", "rtsp://***@host/1"),
        ("http://host/cgi?user=me&pwd=secret", "http://host/cgi?***"),
        ("rtsp://host/user=me_password=secret_channel=1", "rtsp://host/user=***"),
        ("http://host/?mail=a@b&pwd=secret", "http://***@b&pwd=***"),
        ("camera video:http://host/x?k=secret: no (a@b)", "camera video:http://host/x?***: no (a@b)"),
        ("--camera 'video:rtsp://me:sec ret@host/1', --images x", "--camera 'video:rtsp://***@host/1', --images x"),
        ("rtsp://me:secret@a/1 and http://b/2?secret", "rtsp://***@a/1 and http://b/2?***"),
        ("udp://@239.0.0.1:1234, socket://127.0.0.1:7", "udp://@239.0.0.1:1234, socket://127.0.0.1:7"),
        ("video:u:secret@10.0.0.1/x: u:secret@10.0.0.1/x: no", "video:***@10.0.0.1/x: ***@10.0.0.1/x: no"),
        ("--camera=video:http:/me:sec@ret@h/x", "--camera=video:***@h/x"),
        ("video:rtsp//me:secret@h/x: rtsp/secret@h/x", "video:***@h/x: ***@h/x"),
        ("'video:rtsp:\\\\me:secret@h/x'", "'video:***@h/x'"),
        ("video:concat:http://u:secret@h:9/a: concat:http:/u:secret@h:9/a", "video:concat:http://***@h:9/a: ***@h:9/a"),
        ("video:me:sec ret@h/x, video:secret@[::1]/x", "video:***@[::1]/x"),
        ("video:secret@10.0.0.1, secret@camera:554", "video:***@10.0.0.1, ***@camera:554"),
        *((text, text) for text in (
            "camera video:0@1280x720: not found",
            "camera video:clip@2.mp4: clip@2.mp4: no such video file",
            "C:\\clips\\clip@2.mp4, http/clip@2.mp4, name:front@left",
            "video:/dev/v4l/by-id/a b@640x480",
            "/opt/python@3.11/lib/run@lab/cell.toml: key = 3: must be 4",
        )),
    ],
)  # fmt: skip
def test_credentials_are_hidden_and_the_rest_stays(text: str, shown: str) -> None:
    assert hide_credentials(text) == shown
    assert hide_credentials(shown) == shown


def test_no_error_has_credentials_in_its_message_or_data() -> None:
    url = f"video:rtsp://me:{'secret' * 60}@host/{'x' * 300}"  # shortening could cut off the @
    for error in (
        A465Error(f"{url}: no", camera=url, count=2),
        FileInputError("cell.toml", "device", url, "no"),
    ):
        assert "secret" not in f"{error} {error.data}"
        assert "video:rtsp://***@host/xxx" in str(error)
