"""A session or a plan as an MCAP file: JSON messages with JSON schemas, times in ns since the log was opened."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from io import BytesIO
from typing import Any

from arm.errors import InputError
from cell.export.ros import (
    JOINT_STATE_SCHEMA,
    JOINT_TRAJECTORY_SCHEMA,
    Message,
    joint_state,
    joint_trajectory,
    message_schema,
    nanoseconds,
)
from cell.export.series import Executed, Planned
from driver.log.read import Session

_LIST = {"type": "array", "items": {"type": "object"}}
TOPICS = {
    "/joint_states": JOINT_STATE_SCHEMA,
    "/planned": JOINT_TRAJECTORY_SCHEMA,
    "/jaws": message_schema("a465/Jaws", fraction_closed={"type": "number"}),
    "/events": message_schema("a465/Event", kind={"type": "string"}, data={"type": "object"}),
    "/robot_description": message_schema("std_msgs/msg/String", data={"type": "string"}),
    # by these names Foxglove knows its own schemas
    "/tf": message_schema("foxglove.FrameTransforms", transforms=_LIST),
    "/scene": message_schema("foxglove.SceneUpdate", deletions=_LIST, entities=_LIST),
    "/images": message_schema(
        "foxglove.CompressedImage",
        timestamp={"type": "object"},
        frame_id={"type": "string"},
        format={"type": "string"},
        data={"type": "string", "contentEncoding": "base64"},
    ),
}


def mcap_of(messages: Sequence[Message]) -> tuple[bytes, dict[str, int]]:
    """Return a file of messages, and their number per topic. The same messages give the same bytes.

    Raises:
        InputError: the library `mcap` is not installed.
    """
    try:
        from mcap.writer import CompressionType, Writer
    except ImportError as error:
        raise InputError(
            "--format mcap: needs the library mcap, which is not installed; run `make mcap` in the checkout, or "
            "install mcap beside a465",
            format="mcap",
        ) from error
    buffer = BytesIO()
    writer = Writer(buffer, compression=CompressionType.NONE)
    writer.start(profile="", library="a465")
    channels, there = {}, {topic for _, topic, _ in messages}
    for topic, schema in TOPICS.items():
        if topic not in there:
            continue
        schema_id = writer.register_schema(schema["title"], "jsonschema", _json(schema))
        channels[topic] = writer.register_channel(topic, "json", schema_id)
    counted = dict.fromkeys(channels, 0)
    for time_ns, topic, message in sorted(messages, key=lambda m: m[0]):
        writer.add_message(channels[topic], time_ns, _json(message), time_ns, counted[topic])
        counted[topic] += 1
    writer.finish()  # type: ignore[no-untyped-call]
    return buffer.getvalue(), counted


def messages_of(session: Session, samples: Executed, sent: Sequence[Planned]) -> list[Message]:
    """Return the messages of a log, unordered."""
    found: list[Message] = []

    def add(time_s: float, topic: str, message: dict[str, Any]) -> None:
        found.append((max(nanoseconds(time_s), 0), topic, message))

    for i, time in enumerate(samples.time_s):
        time_s = float(time)
        add(time_s, "/joint_states", joint_state(time_s, samples.q[i], samples.velocity[i]))
        if math.isfinite(samples.jaws[i]):
            add(time_s, "/jaws", {"fraction_closed": round(float(samples.jaws[i]), 6)})
    for motion in sent:
        start_s = float(motion.time_s[0])
        trajectory = joint_trajectory(motion.time_s, motion.q, motion.velocity, start_s)
        add(motion.sent_s, "/planned", trajectory)
    for note in session.notes:
        add(note.time_s, "/events", {"kind": note.kind, "data": note.data})
    for status in session.faults:
        add(status.time_s, "/events", {"kind": "fault", "data": {"faults": list(status.status.faults())}})
    for time_s in session.stops:
        add(time_s, "/events", {"kind": "sent", "data": {"line": "STOP:"}})
    for time_s in session.failures:
        add(time_s, "/events", {"kind": "received", "data": {"line": "FAIL!"}})
    return found


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()
