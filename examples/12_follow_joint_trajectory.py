"""A bridge from FollowJointTrajectory, the action of ROS 2's control_msgs, to certified execution on an emulated unit.

It speaks the action's messages as JSON, one a line, over a socket of this computer, without ROS. A client sends
`{"goal": goal}`, `{"cancel": {}}` or `{"joint_state": {}}`. It gets `{"goal_response": {"accepted": ..}}`, `feedback`
as the arm moves, and at the end `{"status": .., "result": {"error_code": .., "error_string": ..}}`.

A goal is certified among the bodies of a cell file, as by `a465 certify`, and moves only if all of it is proved, in the
counts that are sent; else the result says why. A cancel sends STOP, and so does a client that is gone.
"""

import json
import queue
import re
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from a465 import Mars
from arm.controller.segments import CountPath
from arm.errors import A465Error, ExecutionStopped
from arm.plan_file import Move, read_plan
from cell.console import Console
from cell.foreign.certify import certify_step
from cell.program.program_file import task_of_file
from driver.emulator import Emulator
from driver.execution.control import Control
from driver.execution.controller import Controller
from driver.execution.execute import execute
from driver.execution.progress import Progress
from driver.line.stepped_clock import SteppedClock

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # of action_msgs/GoalStatus
# of FollowJointTrajectory.Result
SUCCESSFUL, INVALID_GOAL, INVALID_JOINTS, OLD_HEADER_TIMESTAMP = 0, -1, -2, -3
PATH_TOLERANCE_VIOLATED, GOAL_TOLERANCE_VIOLATED = -4, -5
TOLERANCES = ["path_tolerance", "component_path_tolerance", "goal_tolerance", "component_goal_tolerance"]
FIELDS = ["trajectory", "multi_dof_trajectory", "goal_time_tolerance"]  # beside them
MESSAGES = 'a message is {"goal": ..}, {"cancel": {}} or {"joint_state": {}}, on one line'
AT_ITS_END = ("position", "settle", "time")  # reasons of a stop after all of the path
CELL = Path(__file__).resolve().parents[1] / "scenes" / "cell.toml"

Messages = queue.SimpleQueue[dict[str, Any] | None]


class Refused(A465Error):
    """A goal that asks for what it would not get; `code` is its error code."""


def seconds(value: Any) -> float:
    """Return a time or duration of ROS in s; 0 if there is none."""
    try:
        return float(value["sec"] + 1e-9 * value["nanosec"] if isinstance(value, dict) else value or 0.0)
    except (TypeError, KeyError, ValueError):
        raise Refused(f"{value!r} is no time: must be sec and nanosec", code=INVALID_GOAL) from None


def refuse_what_is_not_kept(goal: dict[str, Any]) -> None:
    """Refuse what a goal may ask for beside its trajectory, so that nothing is ignored without a word."""
    header = goal["trajectory"].get("header") or {}
    if (stamp := seconds(header.get("stamp") if isinstance(header, dict) else header)) != 0.0:
        code = OLD_HEADER_TIMESTAMP if stamp < time.time() else INVALID_GOAL
        raise Refused("header.stamp must be 0: a trajectory begins at once", code=code)
    if seconds(goal["trajectory"]["points"][0]["time_from_start"]) != 0.0:
        raise Refused("the first point must be where the arm is, with time_from_start 0", code=INVALID_GOAL)
    more = goal.get("multi_dof_trajectory")
    given = {**goal, "multi_dof_trajectory": more.get("points") if isinstance(more, dict) else more}
    if strange := [name for name in goal if name not in (*TOLERANCES, *FIELDS)]:
        fields = ", ".join((*FIELDS, *TOLERANCES))
        raise Refused(f"{strange[0]} is no field of a goal; must be of {fields}", code=INVALID_GOAL)
    if asked := [name for name in (*TOLERANCES, "multi_dof_trajectory") if given.get(name)]:
        why = f"{asked[0]} must be empty: tolerances are those of unit and driver, and all joints are in trajectory"
        raise Refused(why, code=INVALID_GOAL)


class Bridge:
    """Serves one client at a time. The thread that calls `serve` drives the arm.

    Args:
        arm: taken into use, with the registers of the cell.
        joints: names of its joints.
        place: cell, task or arm file, among whose bodies goals are certified.
        speed: fraction of the limits that goals may use; None: that of the file.
    """

    def __init__(
        self, arm: Controller, joints: Sequence[str], place: Path, speed: float | None = None
    ) -> None:
        self.arm, self.joints, self.place, self.speed = arm, list(joints), place, speed
        self.control: Control | None = None  # of the goal that is handled
        self.ended = False  # by a signal
        self.goals: queue.SimpleQueue[tuple[dict[str, Any], Control, Messages]] = queue.SimpleQueue()
        self.counts = arm.settled_counts()  # last known
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.address: tuple[str, int] = self.socket.getsockname()
        threading.Thread(target=self._listen, daemon=True).start()

    # threads of the client: the arm never waits for them

    def _listen(self) -> None:
        with self.socket, suppress(OSError):  # closed
            while True:
                client, _ = self.socket.accept()
                out: Messages = queue.SimpleQueue()
                threading.Thread(target=self._write, args=(client, out), daemon=True).start()
                with suppress(OSError, ValueError), client.makefile() as lines:
                    for line in lines:
                        out.put(answer := self._answer(line, out))
                        if "error" in answer:  # it may have been a cancel: as if the client were gone
                            break
                out.put(None)
                if self.control is not None:
                    self.control.abort()

    def _write(self, client: socket.socket, out: Messages) -> None:
        with client, suppress(OSError):
            while (message := out.get()) is not None:
                client.sendall((json.dumps(message) + "\n").encode())

    def _answer(self, line: str, out: Messages) -> dict[str, Any]:
        try:
            message, control = json.loads(line), self.control
        except ValueError as error:
            return {"error": f"is not JSON: {error}; {MESSAGES}"}
        if not isinstance(message, dict) or len(message.keys() & {"goal", "cancel", "joint_state"}) != 1:
            return {"error": f"{line.strip()[:80]}: {MESSAGES}"}
        if "cancel" in message:
            if control is not None:
                control.abort()
            return {"cancel_response": {"goals_canceling": int(control is not None)}}
        if "goal" in message:
            goal = message["goal"]
            trajectory = goal.get("trajectory") if isinstance(goal, dict) else None
            if not isinstance(trajectory, dict) or "points" not in trajectory:
                why = "a goal is {trajectory: {joint_names: .., points: ..}}"
            elif control is not None:
                why = "another goal is executed"
            else:
                self.control = Control()
                self.goals.put((goal, self.control, out))
                return {"goal_response": {"accepted": True}}
            return {"goal_response": {"accepted": False, "error_string": why}}
        return {"joint_state": {"name": self.joints, "position": self._positions().tolist()}}

    def close(self) -> None:
        """Take no further client."""
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)

    # the thread of the arm

    def _positions(self) -> np.ndarray[Any, Any]:
        return self.arm.unit.positions(self.counts)

    def serve(self, goals: float = np.inf) -> None:
        """Handle so many goals. A signal ends it, with the arm stopped."""
        while goals > 0 and not self.ended:
            with suppress(queue.Empty):
                goal, control, out = self.goals.get(timeout=0.2)
                goals -= 1
                result = self._result(goal, control, out)
                self.control = None
                out.put(result)

    def _result(self, goal: dict[str, Any], control: Control, out: Messages) -> dict[str, Any]:
        status, code, why = SUCCEEDED, SUCCESSFUL, ""
        try:
            move = self._certified(goal)
            refuse_what_is_not_kept(goal)
            within = seconds(goal.get("goal_time_tolerance")) or np.inf
            began = self.arm.clock.now()
            execute(self.arm, [move], None, partial(self._feedback, move.path, out), None, None, control)
            self.counts = move.path.end
            if (late := self.arm.clock.now() - began - move.path.duration_s) > within:
                raise ExecutionStopped(f"at its end {late:.2f} s later than planned", reason="time")
        except ExecutionStopped as error:
            reason, state = error.data.get("reason"), error.data.get("state", {})
            self.counts = tuple(state.get("counts") or self.counts)
            code = GOAL_TOLERANCE_VIOLATED if reason in AT_ITS_END else PATH_TOLERANCE_VIOLATED
            status, code = (CANCELED, SUCCESSFUL) if reason == "aborted" else (ABORTED, code)
            why, self.ended = str(error), reason == "interrupted"
        except A465Error as error:
            joints = str(error.data.get("key")).endswith("joint_names")
            code = error.data.get("code", INVALID_JOINTS if joints else INVALID_GOAL)
            status, why = ABORTED, re.sub(r"^\S*goal\.json(, |: )", "", str(error))
            why = re.sub(r"\S*goal\.json", "the goal", why.replace("--output needs", "it needs"))
        return {"status": status, "result": {"error_code": code, "error_string": why}}

    def _certified(self, goal: dict[str, Any]) -> Move:
        with TemporaryDirectory() as folder:
            file, plan_file = Path(folder) / "goal.json", Path(folder) / "plan.json"
            file.write_text(json.dumps(goal))
            certify_step(file, self.place, None, None, self.speed, plan_file, None, Console(as_json=True))
            (move,) = read_plan(plan_file).moves
        return move

    def _feedback(self, path: CountPath, out: Messages, progress: Progress) -> None:
        """Send where the arm is, and the nearest point of what it executes: their difference is how far it is off."""
        self.counts, knots = progress.position.counts, path.knot_times()
        done = min(progress.done, len(knots) - 2)
        times = np.linspace(knots[max(done - 1, 0)], knots[done + 1], 50)
        near, actual = self.arm.unit.positions(path.at(times)), self._positions()
        k = int(np.abs(near - actual).max(axis=1).argmin())
        since = divmod(round(1e9 * float(times[k])), 10**9)
        points = {"desired": near[k], "actual": actual, "error": near[k] - actual}
        feedback = {name: {"positions": q.tolist()} for name, q in points.items()}
        feedback["desired"]["time_from_start"] = dict(zip(("sec", "nanosec"), since, strict=True))
        out.put({"feedback": {"joint_names": self.joints, **feedback}})


def ask(address: tuple[str, int], message: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Send a message as a new client; yield what comes until the result."""
    with socket.create_connection(address, 10.0) as client, client.makefile("rw") as lines:
        print(json.dumps(message), file=lines, flush=True)
        for line in lines:
            yield (found := json.loads(line))
            if "feedback" not in found and found != {"goal_response": {"accepted": True}}:
                return


def try_out(address: tuple[str, int]) -> None:
    """Be the client: move the wrist, then move it until the gripper would meet the forearm."""
    (first,) = ask(address, {"joint_state": {}})
    names, q = first["joint_state"]["name"], np.array(first["joint_state"]["position"])
    for joint, angle, lasts in ((4, 0.2, 4), (4, -1.2, 8)):
        rest = {"velocities": [0.0] * len(q)}
        points = [{"positions": to.tolist(), **rest} for to in (q, q + angle * (np.arange(len(q)) == joint))]
        for point, sec in zip(points, (0, lasts), strict=True):
            point["time_from_start"] = {"sec": sec, "nanosec": 0}
        *moving, last = ask(address, {"goal": {"trajectory": {"joint_names": names, "points": points}}})
        q = np.array(points[-1]["positions"])
        print(f"{len(moving) - 1} times feedback, then {last}")


if __name__ == "__main__":
    cell, clock = task_of_file(CELL).cell, SteppedClock()
    with Emulator(cell.nominal_unit, clock) as emulator, Mars(emulator.open_line(), cell.unit, clock) as mars:
        mars.identify()
        mars.initialise()
        mars.set_registers(cell.speed_registers, cell.acceleration_registers)
        bridge = Bridge(mars, cell.robot().joint_names, CELL, speed=1.0)
        threading.Thread(target=try_out, args=(bridge.address,)).start()
        bridge.serve(goals=2)
        bridge.close()
