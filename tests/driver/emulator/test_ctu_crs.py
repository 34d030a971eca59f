"""The public client of these arms, ctu_crs 1.0.6 as it is published, drives the emulated unit.

It waits without deadlines, so it runs in a process of its own that is ended if it takes too long. The 10 ms that it
reads for an answer are widened to what it takes, its one change: a busy host does not wake anybody so soon, and an
answer that comes in two readings, or two in one, ends the client. That the unit answers in time is asked for in
test_emulator_requirements.py.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import load_unit
from driver.emulator import Emulator, EmulatorOptions
from driver.line.clock import Clock

TIME_SCALE = 20.0
LONGEST_S = 300.0

SESSION = """
import json, sys, time
import numpy as np
import serial
plain, read, write = serial.Serial.__init__, serial.Serial.read, serial.Serial.write
def patient(self, *arguments, **options):
    self.asked = 0
    plain(self, *arguments, **{**options, "timeout": 0.1})
def ask(self, data):
    self.asked += data.count(b"?")
    return write(self, data)
def hear(self, size=1):
    got, over = read(self, size), time.monotonic() + 30.0
    while time.monotonic() < over and (got.count(b"=") < self.asked or not (got or b"\\n").endswith(b"\\n")):
        got += read(self, size)
    self.asked = 0
    return got
serial.Serial.__init__, serial.Serial.read, serial.Serial.write = patient, hear, ask
from ctu_crs import CRS93, CRS97
robot = {"crs93": CRS93, "crs97": CRS97}[sys.argv[1]](tty_dev=sys.argv[2])
robot.initialize(home=sys.argv[3] == "home")
counts = lambda: [int(c) for c in robot._mars.get_current_q_irc()]
wanted = lambda q: [int(round(c)) for c in robot._joint_values_to_irc(np.asarray(q))]
seen = {"started": counts(), "home": wanted(robot.q_home), "moves": [], "jaws": []}
for q_deg in json.loads(sys.argv[4]):
    q = np.deg2rad(q_deg)
    robot.move_to_q(q)
    robot.wait_for_motion_stop()
    seen["moves"].append([wanted(q), counts(), bool(robot.in_motion())])
for fraction in (1.0, 0.0, 0.5):
    robot.gripper.control_position_relative(fraction)
    ready = robot.gripper.wait_for_motion_stop()
    seen["jaws"].append([fraction, ready, int(robot._mars.query("AP" + robot.gripper._axis))])
robot.release()
robot.close()
print("SEEN " + json.dumps(seen))
"""

MOVES_DEG = [
    [10.0, 5.0, -60.0, 20.0, -50.0, 30.0],
    [-25.0, 12.0, -80.0, -35.0, 40.0, -90.0],
    [0.0, 0.0, -45.0, 0.0, -45.0, 0.0],
]


class Client:
    """Runs sessions of the client on one emulated unit."""

    def __init__(self, name: str, emulator: Emulator, port: str) -> None:
        self.name, self.emulator, self.port = name, emulator, port

    def session(self, home: bool, moves: list[list[float]]) -> dict[str, object]:
        arguments = [self.name, self.port, "home" if home else "no", json.dumps(moves)]
        done = subprocess.run(
            [sys.executable, "-c", SESSION, *arguments],
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        seen: dict[str, object] = json.loads(done.stdout.split("SEEN ")[1])
        return seen


@pytest.fixture(params=["crs93", "crs97"])
def client(request: pytest.FixtureRequest) -> Iterator[Client]:
    options = replace(EmulatorOptions(), power_up_deg=(-40.0, -10.0, -70.0, 5.0, -50.0, 5.0))
    unit = load_unit(request.param)
    with Emulator(unit, Clock(TIME_SCALE), options=options) as emulator:
        yield Client(request.param, emulator, emulator.open_pty())


@pytest.mark.slow
def test_it_homes_moves_grips_and_comes_back_without_homing(client: Client) -> None:
    seen = client.session(True, MOVES_DEG)
    assert np.abs(np.subtract(seen["started"], seen["home"])).max() <= 1
    for wanted, found, moving in seen["moves"]:  # type: ignore[attr-defined]
        assert np.abs(np.subtract(wanted, found)).max() <= 1
        assert not moving
    gripper = client.emulator.machine.unit.gripper
    for fraction, ready, adc in seen["jaws"]:  # type: ignore[attr-defined]
        assert ready
        assert abs(adc - gripper.adc(fraction)) <= 2
    assert client.emulator.machine.offset == (0,) * 6
    stood = client.emulator.counts()

    again = client.session(False, MOVES_DEG[:1])
    assert np.abs(np.subtract(again["started"], stood)).max() <= 1
    wanted, found, _ = again["moves"][0]  # type: ignore[index]
    assert np.abs(np.subtract(wanted, found)).max() <= 1
    assert not any("beyond" in violation.what for violation in client.emulator.violations)
    # its misspelt discontinuity goes unanswered, as on the real unit
    assert {line for _, line in client.emulator.ignored} == {"COORDISCONT:5"}
