"""What the documentation tells a reader to type, typed by someone who has no arm.

A page is followed in its order, in a folder of its own with the scenes. The real arm is an emulated unit in a process
of its own, a camera the photographs that this unit's cell gives, or pylon's emulated camera where no arm is in play.
"""

from __future__ import annotations

import ast
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pictures.boards import smaller
from pictures.cameras import SERIAL
from studies.cluster import cluster_by_commands
from tasks.small import leave_cubes, small_scenes
from typed.beside import ASKED, answered, homing
from typed.command_line import a465, replace_in, set_value, value_of
from typed.doc_pages import ROOT, Command
from vision.camera.model import read_camera, write_camera

SUPPORT = Path(__file__).resolve().parents[1]
TIME_SCALE = 2.0  # of emulated units, which render images meanwhile, and of their clients' clocks
FASTER = 20.0  # of the simulated cell
POSES = 8  # of a target in the hand
VIEWS = 20  # of a target, enough for a lens
SPEED = 1.0  # in place of any --speed
LINK = "dev-mars"  # in place of /dev/mars
WAIT_S = 300.0  # wall time
IN_PLACE_OF = {"TASK": "scenes/task2.toml"}


def unknown_to(command: Any, words: tuple[str, ...]) -> list[str]:
    """Verbs and options that a command line does not have.

    Args:
        command: of typer, with all its verbs.
        words: after ``a465``.
    """
    for word in words:
        if hasattr(command, "commands") and not word.startswith("-"):
            if word not in command.commands:
                return [word]
            command = command.commands[word]
    options = {name for p in command.params for name in (*p.opts, *p.secondary_opts)}
    inner = getattr(command, "commands", {})
    options |= {name for c in inner.values() for p in c.params for name in p.opts}
    used = (word.partition("=")[0] for word in words if word.startswith("-") and not word[1:2].isdigit())
    return [word for word in used if word not in options]


def options_of(script: Path) -> set[str]:
    """Names of the options that a script's parser knows."""
    calls = (node for node in ast.walk(ast.parse(script.read_text())) if isinstance(node, ast.Call))
    return {
        argument.value
        for call in calls
        if isinstance(call.func, ast.Attribute) and call.func.attr == "add_argument"
        for argument in call.args
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str)
    }


def require_script(words: tuple[str, ...]) -> None:
    """A script is there and its parser knows the options; it is not run."""
    script = ROOT / words[1]
    assert script.is_file(), f"there is no {words[1]}"
    unknown = {word.partition("=")[0] for word in words[2:] if word.startswith("-")} - options_of(script)
    assert not unknown, f"{words[1]} has no {', '.join(sorted(unknown))}"


def require_target(name: str) -> None:
    """The Makefile has a target of this name."""
    assert re.search(rf"^{re.escape(name)}:", (ROOT / "Makefile").read_text(), re.M), f"no target {name}"


@dataclass
class Reader:
    """Someone who types what a page says, one line after the other.

    Attributes:
        folder: gets the scenes, and everything that the commands write.
        export: takes the name and the value of what is exported.
    """

    folder: Path
    export: Callable[[str, str], None]
    said: str = ""
    _units: dict[str, subprocess.Popen[str]] = field(default_factory=dict)
    _shots: dict[str, str] = field(default_factory=dict)
    _codes: dict[str, str] = field(default_factory=dict)
    _typed: set[tuple[str, ...]] = field(default_factory=set)
    _on_pages_before: frozenset[tuple[str, ...]] = frozenset()
    _task: str = "scenes/task2.toml"
    _real: tuple[str, str] | None = None
    _homed: bool = False
    _scheduler: str = ""
    _cluster: ExitStack = field(default_factory=ExitStack)

    def __post_init__(self) -> None:
        scenes = small_scenes(self.folder)
        replace_in(scenes / "cell.toml", "photographs = 2", "photographs = 5")  # as a reader has it
        replace_in(scenes / "where-boards-may-stand.toml", "points = 256", "points = 32")
        self._cheapen(scenes / "uncalibrated")
        leave_cubes(scenes, 1)

    def _cheapen(self, cell_folder: Path) -> None:
        """A cell whose camera costs less."""
        write_camera(cell_folder / "camera.toml", smaller(read_camera(cell_folder / "camera.toml"), 0.5))
        replace_in(cell_folder / "cell.toml", "photographs = 5", "photographs = 2")

    def type(self, command: Command) -> None:
        """Do what a line says, unless a page before has said the same word for word.

        Raises:
            AssertionError: it ends otherwise than the page says.
        """
        if command.words in self._on_pages_before and "--port" not in command.words:
            return
        self._typed.add(command.words)
        match command.words:
            case ("a465", "emulate", *options):
                self._emulate(list(options))
            case ("a465", *words):
                self._a465(list(words), command.code)
            case ("python", *_):
                require_script(command.words)
            case (".venv/bin/pytest", test, *_):
                assert (ROOT / test).is_file(), f"there is no {test}"
            case ("make", *targets):
                for target in targets:
                    require_target(target)
            case ("cp", "-r", source, copy):
                shutil.copytree(self.folder / source, self.folder / copy)
            case ("export", setting):
                name, _, value = setting.partition("=")
                self.export(name, value)
            case (".", ".venv/bin/activate") | ("dask", "scheduler"):
                pass
            case ("dask", "worker", *_):  # with a scheduler, on this machine
                self._scheduler = self._cluster.enter_context(cluster_by_commands(self.folder, 1))
            case _:
                raise AssertionError(f"nobody knows how to type {' '.join(command.words)}")

    def turn_the_page(self) -> None:
        """The next line is of another page."""
        self._on_pages_before = frozenset(self._typed)

    def with_an_emulated_port(self, code: str) -> str:
        """Python for the port of a real arm, for that of an emulated one."""
        if '"/dev/mars"' not in code:
            return code
        if LINK not in self._units:
            self._emulate(["--link", LINK])
        # the emulated unit was just switched on, so it is homed in place of a unit that was homed before
        return code.replace("(home=False", "(soft_home=False").replace("/dev/mars", LINK)

    def close(self) -> None:
        """End the units, and see that none ended badly."""
        self._cluster.close()
        for link in list(self._units):
            self._end(link)

    def _a465(self, words: list[str], code: int) -> None:
        words = [IN_PLACE_OF.get(word, word) for word in words]
        self._task = next((word for word in words if re.search(r"task\d\.toml$", word)), self._task)
        self._with_an_emulated_arm(words)
        if "--scheduler" in words:
            set_value(words, "--scheduler", self._scheduler)
        self._shortened(words)
        self.said += "".join(a465(*words, code=code, cwd=self.folder))
        if words[0] in ("doctor", "calibrate") and LINK in self._units:
            self._end(LINK)  # nobody asks for its photographs until the next command begins with another
            self._real = None
        if words[0] == "new-cell":
            self._cheapen(self.folder / words[1])
            leave_cubes(self.folder / words[1], 1)
        if words[0] == "preview" and words[1].endswith(".json"):
            page = Path(value_of(words, "-o") or str(Path(words[1]).with_suffix(".html")))
            shown = re.search(r'"code": ?(?:"(\w{4}-\w{4})"|null)', (self.folder / page).read_text())
            assert shown, f"{page} shows no code"
            self._codes[words[1]] = shown[1] or ""  # none of an arm without a unit

    def _with_an_emulated_arm(self, words: list[str]) -> None:
        """Port, camera and code as a reader without an arm has them."""
        port, camera = value_of(words, "--port"), value_of(words, "--camera")
        if words[0] in ASKED:
            self._beside_an_emulated_arm(words)
        if port == "/dev/mars":
            port = LINK
            hand = value_of(words, "--target") or "scenes/targets/hand.toml" if "--collect" in words else ""
            self._real_unit(self._task, hand)
        if port:
            assert port in self._units, f"no emulated unit of this page is on {port}"
            set_value(words, "--port", port)
        if camera and port and words[0] != "doctor":
            words[words.index("--camera")] = "--images"
            set_value(words, "--images", self._shots[port])
        elif camera and words[:2] == ["calibrate", "camera"]:
            words[words.index("--camera")] = "--simulated"
            set_value(words, "--simulated", self._task)
            self._views_before(words)
        elif camera:
            set_value(words, "--camera", SERIAL)
            self._give_photographs()
        # the emulated unit was just switched on, and there is no terminal
        words[:] = [word for word in words if word not in ("--homed", "--ask")]
        if port and (words[0] == "run" or "--collect" in words) and "--unseen" not in words:
            words.append("--unseen")  # a terminal would ask
        if words[0] == "execute" and port:
            assert words[1] in self._codes, f"the code of {words[1]} is asked for, and no preview was written"
            if "--yes" not in words:
                words += ["--yes", ""]
            set_value(words, "--yes", self._codes[words[1]])

    def _beside_an_emulated_arm(self, words: list[str]) -> None:
        """The port is an argument, and what needs a homed arm gets one."""
        words += answered(words)
        if "/dev/mars" in words:
            self._real_unit(self._task, "")
            words[words.index("/dev/mars")] = LINK
            home = homing(words, LINK, SPEED)
            if home and not self._homed:
                a465(*home, cwd=self.folder)
            self._homed = self._homed or words[0] == "home" or bool(home)

    def _real_unit(self, task: str, hand: str) -> None:
        """What is on /dev/mars: among the boards of a task, with or without a target in its hand."""
        if self._real == (task, hand):
            return
        self._real, self._homed = (task, hand), False
        held = ["--hand", hand] if hand else []
        self._emulate(["--task", task, "--photographs", "shots", "--link", LINK, *held])

    def _give_photographs(self) -> None:
        """To pylon's emulated camera, by the cell file, as docs/cameras.md says."""
        self.export("PYLON_CAMEMU", "1")
        cell = self.folder / Path(self._task).parent / "cell.toml"
        folder = cell.parent / "seen"
        if folder.exists():
            return
        a465("render", self._task, "-o", folder, cwd=self.folder)
        camera = next(
            p for p in (cell.with_name("camera.toml"), cell.parent / "cameras/lab.toml") if p.exists()
        )
        width, height = read_camera(camera).size
        replace_in(
            cell,
            "\n[motion]",
            f'\n[look.basler]\nfeatures = {{ TestImageSelector = "Off", ImageFilename = "{folder}", '
            f'ImageFileMode = "On", Width = {width}, Height = {height} }}\n\n[motion]',
        )

    def _views_before(self, words: list[str]) -> None:
        """A session that goes on with the views of one before takes less than all of it."""
        target = value_of(words, "--target") or "charuco"
        views = ("--target", target, "--count", VIEWS, "-o", words[2])
        a465("render", self._task, *views, cwd=self.folder)

    def _shortened(self, words: list[str]) -> None:
        """The same in less time."""
        collects = "--collect" in words
        if (words[0] in ("run", "execute") or collects) and "--port" not in words:
            words += ["--time-scale", f"{FASTER:g}"]
        if "--speed" in words and words[0] == "execute":  # which only lowers the plan's
            place = words.index("--speed")
            del words[place : place + 2]
        elif "--speed" in words:
            set_value(words, "--speed", f"{SPEED:g}")
        if collects and "--poses" not in words:
            words += ["--poses", str(POSES)]
        if words[0] == "record" and "-o" in words:
            words += ["--seconds", "2"]

    def _emulate(self, options: list[str]) -> None:
        link = value_of(options, "--link") or "no link"
        if link in self._units:
            self._end(link)
        if value_of(options, "--time-scale"):
            place = options.index("--time-scale")
            del options[place : place + 2]
        program = (
            f"import sys; sys.path.insert(0, {str(SUPPORT)!r}); from typed.steady_camera import main; main()"
        )
        unit = subprocess.Popen(
            [sys.executable, "-c", program, "emulate", *options, "--time-scale", f"{TIME_SCALE:g}"],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._units[link] = unit
        assert unit.stdout is not None
        first = unit.stdout.readline()
        self.said += first
        assert " on " in first, f"the unit does not say where it is: {unit.communicate(timeout=600)}"
        shots = value_of(options, "--photographs")
        if shots:
            self._shots[link] = shots
            self._wait_for_photographs(self.folder / shots)

    def _wait_for_photographs(self, folder: Path) -> None:
        """As long as a person takes for the next line."""
        end = time.monotonic() + WAIT_S
        while not (folder.is_dir() and len(list(folder.glob("*.png"))) >= 2):
            assert time.monotonic() < end, f"no photographs came into {folder.name}"
            time.sleep(0.05)

    def _end(self, link: str) -> None:
        unit = self._units.pop(link)
        unit.send_signal(signal.SIGINT)
        said, errors = unit.communicate(timeout=600)
        self.said += said
        assert (unit.returncode, errors) == (0, ""), f"the unit on {link} ended badly: {errors}"
