"""What every test rests on."""

import gc
import shutil
import signal
from collections import defaultdict
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from arm.io.storage import data_file
from driver.log.read import Session, read_log
from wire.logged_session import LoggedRun, logged_run


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With `-m slow`, leave files without slow tests unread: each of six processes would import four times as many."""
    if config.option.markexpr != "slow" or collection_path.suffix != ".py":
        return None
    text = collection_path.read_text()
    return ("mark.slow" not in text and "mark.few" not in text) or None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Make modules and tests without a search for garbage, and leave them out of all later ones: they stay.

    Later searches are rare: they took 7 % of the time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 20, 50)
        gc.enable()


def pytest_make_parametrize_id(val: object) -> str | None:
    """Name a long text by its beginning: xdist sends all names to and from each process."""
    return ascii(val[:40]) if isinstance(val, str | bytes) and len(val) > 100 else None


def _leave_few_fast(items: list[pytest.Item]) -> None:
    """Mark as slow all cases of a test but some, spread over all values of its parameters by the golden ratio."""
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("few") is not None and item.get_closest_marker("slow") is None:
            cases[item.nodeid.partition("[")[0]].append(item)
    for of_one in cases.values():
        marker = of_one[0].get_closest_marker("few")
        spread = dict.fromkeys(int(k * 0.618034 % 1.0 * len(of_one)) for k in range(10 * len(of_one)))
        fast = list(spread)[: marker.args[0]] if marker is not None else []
        for k, item in enumerate(of_one):
            if k not in fast:
                item.add_marker(pytest.mark.slow)


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the tests that take minutes: at the end, one process would run them while others wait.

    Tests of a file stay in one process, unless they say otherwise: each process would make their fixtures again.
    """
    _leave_few_fast(items)
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(item.nodeid.partition("::")[0]))


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """A copy of the shipped scenes that a test may change."""
    return Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes"))


@pytest.fixture(scope="session", autouse=True)
def no_devices_of_the_host() -> Iterator[None]:
    """No test finds the port or the camera of whoever runs it."""
    with pytest.MonkeyPatch.context() as patch:
        for variable in ("A465_PORT", "A465_CAMERA"):
            patch.delenv(variable, raising=False)
        yield


@pytest.fixture(scope="session", autouse=True)
def interrupts_are_heard() -> Iterator[None]:
    """A shell that starts tests in the background makes them deaf to SIGINT; tests of interrupts need to hear it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> LoggedRun:
    """A session at the wire and its log."""
    return logged_run(tmp_path_factory.mktemp("log") / "wire.jsonl")


@pytest.fixture(scope="session")
def session(run: LoggedRun) -> Session:
    """What the log says."""
    return read_log(run.log)


@pytest.fixture(autouse=True, scope="session")
def patient() -> Iterator[None]:
    """On ports of the host a unit is silent, and its echo late, after this, not when the host is busy.

    Stepped time knows of no host.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("driver.line.clock.LEAST_WALL_S", 10.0)
        patch.setattr("driver.mars.streaming.feed.BUSY_HOST_S", 2.0)
        patch.setattr("driver.mars.absolute_move.BUSY_HOST_S", 1.0)
        yield
