"""The bridge from FollowJointTrajectory: what is not proved does not move; a cancel or a lost client stops the arm."""

from __future__ import annotations

import json
import queue
import re
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ExecutionStopped
from arm.io.storage import data_file
from cell.files.task import read_task
from driver.emulator import Emulator, EmulatorOptions
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from emulated.near_marks import near_marks

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
JOINTS = [f"J{k}" for k in range(1, 7)]
SCALE = 40.0  # controller seconds per second, so that a client can act while the arm moves
HOME = np.radians([0, 0, -45, 0, -45, 0])
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


class Client:
    """A client with what it has heard."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.socket = socket.create_connection(address, 20.0)
        self.lines = self.socket.makefile("r")

    def say(self, message: Any) -> None:
        self.socket.sendall((json.dumps(message) + "\n").encode())

    def next(self) -> Any:
        return json.loads(self.lines.readline())

    def until(self, key: str) -> tuple[Any, list[Any]]:
        before = []
        while key not in (message := self.next()):
            before.append(message)
        return message, before

    def result(self, goal: Any) -> tuple[int, int, str, list[Any]]:
        self.say({"goal": goal})
        assert self.next() == {"goal_response": {"accepted": True}}
        last, before = self.until("result")
        return last["status"], last["result"]["error_code"], last["result"]["error_string"], before

    def close(self) -> None:
        self.lines.close()
        self.socket.close()


def goal(start: Any, by: dict[int, float], lasts: int = 8, **more: Any) -> dict[str, Any]:
    """A motion of single joints from rest to rest, as ROS has its message, with every field."""
    end = np.array(start, dtype=float)
    for joint, angle in by.items():
        end[joint] += angle
    points = [
        {
            "positions": q.tolist(),
            "velocities": [0.0] * 6,
            "accelerations": [],
            "effort": [],
            "time_from_start": {"sec": sec, "nanosec": 0},
        }
        for q, sec in ((np.array(start, dtype=float), 0), (end, lasts))
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {
        "trajectory": {"header": header, "joint_names": JOINTS, "points": points},
        "multi_dof_trajectory": {"header": header, "joint_names": [], "points": []},
        "path_tolerance": [],
        "component_path_tolerance": [],
        "goal_tolerance": [],
        "component_goal_tolerance": [],
        "goal_time_tolerance": {"sec": 0, "nanosec": 0},
        **more,
    }


@pytest.fixture(scope="module")
def example() -> Iterator[Any]:
    sys.path.insert(0, str(EXAMPLES))
    yield import_module("12_follow_joint_trajectory")
    sys.path.remove(str(EXAMPLES))


class Served:
    """A bridge to an emulated unit that a thread drives, for one test after the other."""

    def __init__(self, example: Any) -> None:
        self.place = data_file("scenes/cell.toml")
        self.cell = read_task(data_file("scenes/task2.toml")).cell
        self.ready: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.example = example
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()
        self.bridge, self.emulator, self.mars = self.ready.get(timeout=60.0)

    def run(self) -> None:
        unit, clock = self.cell.unit, SteppedClock(SCALE)
        options = EmulatorOptions(power_up_deg=near_marks(unit))
        with (
            Emulator(unit, clock, options=options) as emulator,
            Mars(emulator.open_line(), unit, clock) as mars,
        ):
            mars.identify()
            mars.initialise()
            mars.set_registers(self.cell.speed_registers, self.cell.acceleration_registers)
            bridge = self.example.Bridge(mars, JOINTS, self.place, 1.0)
            self.ready.put((bridge, emulator, mars))
            bridge.serve()

    @property
    def q(self) -> Any:
        return self.cell.unit.positions(self.emulator.counts())

    def close(self) -> None:
        self.bridge.ended = True
        self.thread.join(10.0)
        self.bridge.close()


@pytest.fixture(scope="module")
def served(example: Any) -> Iterator[Served]:
    served = Served(example)
    yield served
    served.close()


@pytest.fixture
def client(served: Served) -> Iterator[Client]:
    client = Client(served.bridge.address)
    yield client
    client.close()


def here(client: Client) -> Any:
    client.say({"joint_state": {}})
    told = client.next()["joint_state"]
    assert told["name"] == JOINTS
    return np.array(told["position"])


def test_a_goal_that_is_proved_is_executed_with_feedback_of_where_the_arm_is(
    served: Served, client: Client
) -> None:
    start = here(client)
    status, code, why, before = client.result(goal(start, {4: 0.3, 0: 0.2}))
    assert (status, code, why) == (SUCCEEDED, 0, "")
    end = start + [0.2, 0, 0, 0, 0.3, 0]
    assert np.abs(served.q - end).max() < 1e-3
    unit = served.cell.unit
    assert np.array_equal(here(client), unit.positions(unit.counts(end)))
    feedback = [message["feedback"] for message in before]
    assert len(feedback) > 10
    actual, desired, error = (
        np.array([f[name]["positions"] for f in feedback]) for name in ("actual", "desired", "error")
    )
    assert np.allclose(desired - actual, error)
    assert np.abs(error).max() < 0.02
    assert (np.diff(actual[:, 4]) >= -1e-4).all()
    assert np.ptp(actual[:, 4]) > 0.25
    times = [f["desired"]["time_from_start"] for f in feedback]
    seconds = [t["sec"] + 1e-9 * t["nanosec"] for t in times]
    assert seconds == sorted(seconds)
    assert seconds[-1] <= 8.0


def refused(**change: Any) -> Callable[[Any], Any]:
    return lambda start: goal(start, {4: 0.1}, **change)


def named(names: list[str]) -> Callable[[Any], Any]:
    def made(start: Any) -> Any:
        made = goal(start, {4: 0.1})
        made["trajectory"]["joint_names"] = names
        return made

    return made


def stamped(sec: Any) -> Callable[[Any], Any]:
    def made(start: Any) -> Any:
        made = goal(start, {4: 0.1})
        made["trajectory"]["header"] = {"stamp": {"sec": sec, "nanosec": 0}, "frame_id": ""}
        return made

    return made


def late(start: Any) -> Any:
    made = goal(start, {4: 0.1})
    made["trajectory"]["points"][0]["time_from_start"]["sec"] = 1
    return made


def without_velocities(start: Any) -> Any:
    made = goal(start, {4: 0.1})
    for point in made["trajectory"]["points"]:
        del point["velocities"]
    return made


TOLERANCE = {"name": "J1", "position": 0.1, "velocity": 0.0, "acceleration": 0.0}
TWO_MORE = {"joint_names": ["x"], "points": [{"transforms": []}]}


@pytest.mark.parametrize(
    ("made", "code", "why"),
    [
        (lambda start: goal(start, {4: -1.785 - start[4]}), -1, "refuted: .* gripper .* forearm"),
        (lambda start: goal(start, {0: 0.4}, lasts=1), -1, "J1 needs .* % of its velocity limit"),
        (lambda start: goal(start, {4: 3.0}, lasts=60), -1, "J5 is beyond its position limits"),
        (lambda start: goal(start + 0.01, {4: 0.1}), -1, "the arm is not at the start"),
        (lambda start: {"trajectory": {"joint_names": JOINTS, "points": []}}, -1, "has 0 points"),
        (lambda start: {"trajectory": {"joint_names": JOINTS, "points": 7}}, -1, "points"),
        (named([*JOINTS[:5], "wrist"]), -2, "'wrist' is no joint of the arm"),
        (named(JOINTS[:5]), -2, "lacks J6"),
        (stamped(1), -3, "header.stamp must be 0"),
        (stamped(2**31), -1, "header.stamp must be 0"),
        (stamped("soon"), -1, "is no time"),
        (late, -1, "time_from_start 0"),
        (refused(path_tolerance=[TOLERANCE]), -1, "path_tolerance must be empty"),
        (refused(component_goal_tolerance=[TOLERANCE]), -1, "component_goal_tolerance must be empty"),
        (refused(multi_dof_trajectory=TWO_MORE), -1, "multi_dof_trajectory must be empty"),
        (refused(goal_time_tolerance="long"), -1, "is no time"),
        (refused(speed=0.5), -1, "speed is no field of a goal; must be of trajectory, "),
        (without_velocities, -1, "^it needs points with velocities, which the goal lacks: "),
    ],
)
def test_what_is_not_proved_or_not_kept_does_not_move_and_the_result_says_why(
    served: Served, client: Client, made: Callable[[Any], Any], code: int, why: str
) -> None:
    before, heard = here(client), served.emulator.counts()
    status, found, told, feedback = client.result(made(before))
    assert (status, found, feedback) == (ABORTED, code, [])
    assert re.search(why, told), told
    assert "goal.json" not in told
    assert served.emulator.counts() == heard


@pytest.mark.parametrize("message", ["hello", [1], {}, {"gaol": {}}, {"goal": {}, "cancel": {}}])
def test_what_is_no_message_is_told_and_ends_the_connection(client: Client, message: Any) -> None:
    client.say(message)
    assert 'a message is {"goal": ..}, {"cancel": {}} or {"joint_state": {}}' in client.next()["error"]
    assert client.lines.readline() == ""


def test_a_goal_that_is_none_is_not_accepted_and_told_why(client: Client) -> None:
    client.say({"goal": {"points": []}})
    answer = client.next()["goal_response"]
    assert not answer["accepted"]
    assert answer["error_string"] == "a goal is {trajectory: {joint_names: .., points: ..}}"


def moves(client: Client, served: Served, by: float) -> Any:
    """Begin a motion of J1 of 20 s, and wait until it is under way; return where it begins."""
    start = here(client)
    client.say({"goal": goal(start, {0: by}, lasts=20)})
    assert client.next() == {"goal_response": {"accepted": True}}
    while abs(client.next()["feedback"]["actual"]["positions"][0] - start[0]) < 0.05:
        pass
    return start


def test_a_cancel_stops_the_arm_on_its_path_and_it_goes_on_from_there(served: Served, client: Client) -> None:
    start = moves(client, served, 0.8)
    began = time.monotonic()
    client.say({"cancel": {}})
    last, _ = client.until("result")
    assert time.monotonic() - began < 2.0
    assert (last["status"], last["result"]["error_code"]) == (CANCELED, 0)
    assert "aborted on request; the arm has stopped" in last["result"]["error_string"]
    stood = here(client)
    assert 0.05 < stood[0] - start[0] < 0.75
    assert np.abs(served.q - stood).max() < 1e-3
    status, code, why, _ = client.result(goal(stood, {0: -0.1}))
    assert (status, code, why) == (SUCCEEDED, 0, "")


def test_a_second_goal_is_not_accepted_while_one_is_executed(served: Served, client: Client) -> None:
    start = moves(client, served, -0.5)
    client.say({"goal": goal(start, {0: 0.1})})
    answer, _ = client.until("goal_response")
    assert answer == {"goal_response": {"accepted": False, "error_string": "another goal is executed"}}
    client.say({"cancel": {}})
    last, _ = client.until("result")
    assert last["status"] == CANCELED  # that of the first


@pytest.mark.parametrize("says", ["nothing", "no JSON"])
def test_a_client_that_is_gone_or_talks_nonsense_stops_the_arm(
    served: Served, client: Client, says: str
) -> None:
    start = moves(client, served, 0.5)
    if says == "nothing":
        client.close()
    else:
        client.socket.sendall(b"what?\n")
    deadline = time.monotonic() + 5.0
    while served.bridge.control is not None and time.monotonic() < deadline:
        time.sleep(0.01)
    stood = served.q
    assert 0.05 < stood[0] - start[0] < 0.45
    again = Client(served.bridge.address)
    assert np.abs(here(again) - stood).max() < 1e-3
    again.close()


def test_a_goal_that_is_later_than_it_allows_has_violated_its_tolerance(client: Client) -> None:
    within = {"sec": 0, "nanosec": 1000}
    status, code, why, _ = client.result(goal(here(client), {4: 0.05}, goal_time_tolerance=within))
    assert (status, code) == (ABORTED, -5)
    assert "later than planned" in why


@pytest.mark.parametrize(
    ("reason", "code"), [("following", -4), ("fault", -4), ("link", -4), ("position", -5), ("settle", -5)]
)
def test_a_motion_that_ends_by_itself_tells_how(
    example: Any, client: Client, monkeypatch: pytest.MonkeyPatch, reason: str, code: int
) -> None:
    def stops(*_: Any) -> None:
        raise ExecutionStopped(f"of {reason}", reason=reason, state={"counts": None})

    start = here(client)
    monkeypatch.setattr(example, "execute", stops)
    assert client.result(goal(start, {4: 0.05}))[:3] == (ABORTED, code, f"of {reason}")
    assert np.array_equal(here(client), start)
