"""State of a live view: the run as last reported. Versions number its changes, so that a page asks only for new ones.

A `LiveState` is not thread-safe. Times are those of the plan's preview, so that the page can compare both.
"""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import takewhile
from typing import Any, TypeVar

from arm.controller.unit import Unit
from arm.plan_file import Motion, Plan, Step
from cell.export.timeline import timed_steps
from cell.preview.executed import OnPath
from driver.execution.control import Control
from driver.execution.progress import Progress

MOST_SAMPLES = 12_000  # kept for a page that is opened later: 20 min at 10 per second
MOST_LINES = 200


_T = TypeVar("_T")


class LiveState:
    """The present state.

    Attributes:
        page: of the plan being executed; None before the first.
        version: number of the last change.
    """

    def __init__(self) -> None:
        self.page: bytes | None = None
        self.version = 0
        self._run = secrets.token_hex(4)  # a page left open reloads when another run answers at its port
        self._control = Control()
        self._plan: dict[str, Any] | None = None
        self._unit: Unit | None = None
        self._places: dict[int, int] = {}  # id of a step -> index
        self._motions: dict[int, tuple[Motion, int]] = {}  # index of a step -> its motion, place in it
        self._steps: tuple[Step, ...] = ()  # kept so that their ids stay unique
        self._starts: list[float] = []
        self._index: int | None = None
        self._on_path: tuple[Motion, OnPath] | None = None
        self._samples: deque[tuple[int, dict[str, Any]]] = deque(maxlen=MOST_SAMPLES)  # with their versions
        self._lines: deque[tuple[int, str]] = deque(maxlen=MOST_LINES)
        self._step: dict[str, Any] | None = None
        self._ended: str | None = None
        self._shown: dict[str, str] = {}

    def begin(self, control: Control) -> None:
        """The run has begun; `control` reports whether it is paused."""
        self.version += 1
        self._control = control

    def follow(self, mark: str, name: str, plan: Plan, unit: Unit, page: bytes | None) -> None:
        """The execution of a plan begins.

        Args:
            mark: identifies the page.
            name: name of the plan file.
            plan: the plan.
            unit: controller that executes it.
            page: page of the plan; None: the waiting page is shown, which has no mark.
        """
        self.version += 1
        self.page, self._unit, self._steps = page, unit, plan.steps
        self._starts = [timed.start_s for timed in timed_steps(plan)]
        self._places = {id(s): i for i, s in enumerate(plan.steps)}
        self._motions = {m.first + k: (m, k) for m in plan.motions for k in range(len(m.moves))}
        self._index, self._step, self._on_path = None, None, None
        self._samples.clear()
        self._plan = {"mark": None if page is None else mark, "name": name, "sha256": plan.sha256}

    def enter(self, step: Step) -> None:
        """A step begins."""
        self.version += 1
        self._index = self._places.get(id(step))
        start = None if self._index is None else round(self._starts[self._index], 6)
        self._step = {"index": self._index, "name": step.name, "t": start}

    def sample(self, progress: Progress) -> None:
        """A sample of the present motion."""
        self.version += 1
        first, t = self._place(progress)
        sample = {
            "motion": first,
            "t": t,
            "ms": progress.position.time_ms,
            "counts": list(progress.position.counts),
            "done": progress.done,
            "total": progress.total,
            "override": round(progress.override, 4),
            "jaws": None if progress.jaws is None else round(progress.jaws, 4),
        }
        self._samples.append((self.version, sample))

    def rest(self, counts: Sequence[int] | None, facts: str) -> None:
        """Where an arm is that follows no plan here, counts or None if that is not known; and what is said of it."""
        self.version += 1
        sample: dict[str, Any] = {"motion": None, "t": None, "ms": 0, "done": 0, "total": 0, "override": 1.0}
        sample |= {"counts": None if counts is None else list(counts), "jaws": None, "facts": facts}
        self._samples.append((self.version, sample))

    def say(self, text: str) -> None:
        """A line of text for the operator."""
        self.version += 1
        self._lines.append((self.version, text))

    def end(self, text: str) -> None:
        """The run has ended: ``done``, or the reason."""
        self.version += 1
        self._ended = text

    def refresh(self) -> None:
        """Start a new version if the run began to run, to pause, or to rest since the last call."""
        state = self._state()
        if state != self._shown:
            self._shown = state
            self.version += 1

    def since(self, version: int) -> dict[str, Any]:
        """Return the state as JSON types, with the lines and samples that came after a version (0: all kept)."""
        return {
            "run": self._run,
            "version": self.version,
            "plan": self._plan,
            "step": self._step,
            "lines": _after(version, self._lines),
            "samples": _after(version, self._samples),
            **self._state(),
        }

    def _state(self) -> dict[str, str]:
        if self._ended is not None:
            return {"state": "ended", "text": self._ended}
        if self._step is None:
            return {"state": "waits"}
        if self._control.paused:
            return {"state": "stands" if self._control.standing else "pauses"}
        return {"state": "runs"}

    def _place(self, progress: Progress) -> tuple[int | None, float | None]:
        """Return the first step of the present motion, and the sample's time in the preview, s."""
        found = None if self._index is None else self._motions.get(self._index)
        if found is None or self._unit is None:
            return None, None
        motion, k = found
        if self._on_path is None or self._on_path[0] is not motion:
            self._on_path = motion, OnPath(motion.path, self._unit)
        q = self._unit.positions(progress.position.counts)
        time_s, _ = self._on_path[1].place(q, motion.starts[k] + progress.done)
        return motion.first, round(self._starts[motion.first] + time_s, 4)


def _after(version: int, kept: deque[tuple[int, _T]]) -> list[_T]:
    """Return the values of later versions, in order."""
    newest: Iterable[tuple[int, _T]] = takewhile(lambda item: item[0] > version, reversed(kept))
    return [value for _, value in newest][::-1]
