"""The study file: what varies, what is asked of each point, and how many points there are."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.errors import FileInputError
from arm.io.keys import Keys, key
from arm.io.node import Node
from arm.io.rules import integer, is_number, line, number, path, rule_of, same, tables, text
from arm.io.slips.names import no_file
from arm.io.storage import canonical_json

STAGES = ("reach", "look", "plan", "run")
FILES = ("world", "task", "cell", "camera")
MOST_POINTS, MOST_CHUNKS = 100_000_000, 1_000_000
# Points of a chunk by its last stage: half a second of work or more.
CHUNK = {"reach": 50, "look": 4, "plan": 4, "run": 1}
CHUNK_OF_POSES = 1000  # of reach, if nothing but poses of boards varies
BOARD_POSE = re.compile(r"boards\[(\d+)\]\.(?:(centre_mm)\[([012])\]|(yaw_deg|tilt_deg|lean_azimuth_deg))")
"""Key of a number of a board's pose in a world file: board, and list with item or name."""

# of its table besides what varies
RESULTS = (
    "stage",
    "ok",
    "reason",
    "margin_deg",
    "hole_std_mm",
    "clearance_mm",
    "motion_s",
    "insertion",
    "detail",
)
COLUMNS = ("point", *RESULTS)


def _may_vary(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_may_vary, value))
    return isinstance(value, int | str) or (isinstance(value, float) and math.isfinite(value))


_VALUES = rule_of(
    "a list of two or more different numbers or strings, or of lists of these",
    lambda v: (
        isinstance(v, list)
        and len(v) > 1
        and _may_vary(v)
        and len({canonical_json(one) for one in v}) == len(v)
    ),
    same,
)
_STAGES = rule_of(
    f"a list of {', '.join(STAGES)}, in this order",
    lambda v: isinstance(v, list) and bool(v) and v == [stage for stage in STAGES if stage in v],
    tuple,
)


class VaryKeys(Keys):
    """Keys of what varies."""

    file: str = key("file", text(*FILES), "world")
    where: str = key("key", line())
    name: str | None = key("name", line(), None)
    low: float | None = key("from", number(), None)
    high: float | None = key("to", number(), None)
    steps: int | None = key("steps", integer(2, 100_000), None)
    values: list[Any] | None = key("values", _VALUES, None)


class StudyKeys(Keys, file="a study file"):
    """Keys of a study file."""

    task: Path = key("task", path(exists=False))
    world: Path | None = key("world", path(exists=False), None)
    stages: tuple[str, ...] = key("stages", _STAGES, ["reach"])
    points: int | None = key("points", integer(1, MOST_POINTS), None)
    seed: int = key("seed", integer(0, 2**31 - 1), 0)
    chunk: int | None = key("chunk", integer(1, 1_000_000), None)
    vary: tuple[VaryKeys, ...] = key("vary", tables(lambda node: VaryKeys.read(node), VaryKeys))


@dataclass(frozen=True)
class Varied:
    """One value that varies.

    Attributes:
        file: world, task, cell or camera: the file that has it.
        key: such as ``boards[1].centre_mm[0]``.
        name: of its column.
        low, high: of a range; None where values are listed.
        grid: values of a range with steps, or those that are listed; empty for a range that is sampled.
    """

    file: str
    key: str
    name: str
    low: float | None
    high: float | None
    grid: tuple[Any, ...]


@dataclass(frozen=True)
class Study:
    """A study.

    Attributes:
        file: study file.
        task, world: task file, and the truth of the simulated cell.
        stages: what is asked of each point, each of those that passed the one before.
        vary: what varies; the last grid varies fastest; each point of the grids has the same samples of the ranges.
        samples: number of Sobol points at each point of the grids.
        seed: of the Sobol points.
        chunk: number of points that are computed at a time.
    """

    file: Path
    task: Path
    world: Path
    stages: tuple[str, ...]
    vary: tuple[Varied, ...]
    samples: int
    seed: int
    chunk: int

    @property
    def count(self) -> int:
        """Number of points."""
        return self.samples * math.prod(len(one.grid) for one in self.vary if one.grid)

    def to_json(self) -> dict[str, Any]:
        """Return what the results of a point depend on, but for the files, as JSON types.

        Without a grid, samples that are added leave the others as they are.
        """
        vary = [[one.file, one.key, one.low, one.high, list(one.grid)] for one in self.vary]
        samples = self.samples if any(one.grid for one in self.vary) else None
        return {"stages": list(self.stages), "vary": vary, "samples": samples, "seed": self.seed}


def read_study(file: Path, task: Path | None = None, world: Path | None = None) -> Study:
    """Read a study file.

    Args:
        file: the file.
        task, world: instead of those that it names.

    Raises:
        FileInputError: a value is wrong; names file, key, value and rule.
    """
    root = Node.of_toml(file, "study")
    keys = StudyKeys.read(root)
    task = keys.task if task is None else task
    if not task.is_file():
        raise root.error_at("task", *no_file(task, file))
    Node.of_toml(task, "task")
    if world is None:
        world = task.with_suffix(".world.toml") if keys.world is None else keys.world
    if not world.is_file():
        default = f"is missing, and it is not beside the task file: {world}", ""
        raise root.error_at("world", *(no_file(world, file) if keys.world else default))
    if not keys.vary:
        raise root.error_at("vary", "must have one or more tables: what varies")
    nodes = root["vary"].items()
    vary = tuple(_varied(one, node) for one, node in zip(keys.vary, nodes, strict=True))
    names = [one.name for one in vary]
    for one, node in zip(vary, nodes, strict=True):
        if names.count(one.name) > 1 or one.name in COLUMNS:
            why = "in every table" if one.name in COLUMNS else "there twice"
            raise node.error_at("name", f"must differ from other columns; {one.name!r} is {why}")
    ranged = any(not one.grid for one in vary)
    if ranged and keys.points is None:
        why = "is missing: the number of samples of the ranges that have no steps"
        raise root.error_at("points", why, "best a power of 2")
    if not ranged and keys.points is not None:
        why = "must be left out: every varied value is a grid, and grids say how many points there are"
        raise root.error_at("points", why)
    chunk = keys.chunk or CHUNK[keys.stages[-1]]
    if keys.chunk is None and keys.stages == ("reach",) and all(map(_is_pose, vary)):
        chunk = CHUNK_OF_POSES
    study = Study(file, task, world, keys.stages, vary, keys.points or 1, keys.seed, chunk)
    if study.count > MOST_POINTS:
        raise root.error_at("vary", f"must not make more than {MOST_POINTS} points; these make {study.count}")
    if study.count > MOST_CHUNKS * study.chunk:
        why = f"must make at most {MOST_CHUNKS} chunks of {study.count} points"
        raise root.error_at("chunk", why, f"{math.ceil(study.count / MOST_CHUNKS)} or more")
    return study


def _varied(keys: VaryKeys, node: Node) -> Varied:
    name = keys.name or keys.where
    if keys.values is not None:
        for other in ("from", "to", "steps"):
            if other in node:
                raise node.error_at(other, "must be left out where values are given")
        numbers = [one for one in keys.values if is_number(one)]
        if len(numbers) == len(keys.values) and numbers != sorted(numbers):
            raise node.error_at("values", "must increase if they are numbers")
        return Varied(keys.file, keys.where, name, None, None, tuple(keys.values))
    if keys.low is None or keys.high is None:
        raise _missing(node, "from" if keys.low is None else "to")
    if not keys.low < keys.high:
        raise node.error_at("to", f"must be more than from, which is {keys.low:g}")
    if keys.steps is None:
        return Varied(keys.file, keys.where, name, keys.low, keys.high, ())
    return Varied(keys.file, keys.where, name, keys.low, keys.high, _grid(keys.low, keys.high, keys.steps))


def _grid(low: float, high: float, steps: int) -> tuple[float, ...]:
    """The values of a range with steps: integers if all are whole, as a seed has to be."""
    width = (high - low) / (steps - 1)
    if low.is_integer() and width.is_integer():
        return tuple(round(low + k * width) for k in range(steps))
    digits = max(9, 6 - math.floor(math.log10(width)))
    return (*(round(low + k * width, digits) for k in range(steps - 1)), high)


def _is_pose(one: Varied) -> bool:
    return one.file == "world" and BOARD_POSE.fullmatch(one.key) is not None


def _missing(node: Node, name: str) -> FileInputError:
    return node.error_at(name, "is missing; every vary table needs from and to, or values")
