"""How `milepost up` starts, is interrupted and is killed: what has been said decides when, not the time."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from conftest import free_port, title_of
from conftest import running as running_train

pytestmark = pytest.mark.long

MAGLEV = "deploy/trains/maglev.yaml"
NAMES = {"fuser", "filter radar", "filter loop", "balise", "sensor radar", "sensor loop", "sensor balise-reader", "world"}
MOMENTS = ("reading", "starting", "router is there", "filter-loop is there", "world is there", "first state after")


Up = Callable[..., subprocess.Popen]


def launch(*options: str, **popen: object) -> subprocess.Popen:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    return subprocess.Popen(
        [sys.executable, "-m", "milepost", "up", "--train", MAGLEV, "--listen", endpoint, *options], **popen
    )


@pytest.fixture
def up() -> Iterator[Up]:
    """Start `milepost up`; whatever a test makes of it, it is gone afterwards."""
    started = []

    def start(*options: str, **popen: object) -> subprocess.Popen:
        started.append(launch(*options, **popen))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait(5.0)


@pytest.fixture
def headless(up: Up) -> subprocess.Popen:
    return up("--headless", stderr=subprocess.PIPE, text=True)


def read_until(process: subprocess.Popen, words: str) -> list[str]:
    """The lines on standard error up to the one with these words."""
    lines = []
    for line in process.stderr:
        lines.append(line)
        if words in line:
            return lines
    pytest.fail(f"ended before it said {words!r}: {''.join(lines)}")


def wait_until(what: Callable[[], object], timeout_s: float, why: str) -> None:
    deadline = time.monotonic() + timeout_s
    while not what():
        assert time.monotonic() < deadline, why
        time.sleep(0.02)


def ended(pids: list[int]) -> Callable[[], bool]:
    return lambda: not [p for p in pids if psutil.pid_exists(p) and psutil.Process(p).status() != psutil.STATUS_ZOMBIE]


def children_of(pid: int) -> list[int]:
    return [child.pid for child in psutil.Process(pid).children(recursive=True)]


@pytest.mark.parametrize("moment", MOMENTS)
def test_an_interrupt_at_any_moment_is_clean(headless: subprocess.Popen, moment: str) -> None:
    said = read_until(headless, moment)
    headless.send_signal(signal.SIGINT)
    # a child that were left would hold the pipe open
    said += headless.communicate(timeout=15.0)[1].splitlines()
    assert headless.returncode in (0, 130, -signal.SIGINT)
    assert not [line for line in said if "Traceback" in line or "Error" in line], "".join(said)


def test_the_end_of_a_train_that_runs_is_quiet() -> None:
    """WHEN a train that has run for two seconds is stopped, THEN no process tells that others are gone."""
    state = "milepost/v1/maglev-1/state"
    with running_train(MAGLEV, state) as (stack, outside):
        first = outside.newest(state)["epoch"]
        outside.wait_for(lambda: outside.newest(state)["epoch"] >= first + 100, 10.0, "two seconds of states")
        said = len(stack.errors)
    assert stack.errors[said:] == []


def test_the_first_words_come_before_anything_heavy_is_imported() -> None:
    """Each module's import is noted on standard error; what comes after the first words had not been loaded before them."""
    command = [sys.executable, "-X", "importtime", "-m", "milepost", "up", "--train", "no.yaml"]
    said = subprocess.run(command, capture_output=True, text=True, timeout=60).stderr.splitlines()
    first = next(number for number, line in enumerate(said) if line.startswith("milepost: reading"))
    before = {line.rpartition("|")[2].strip() for line in said[:first]}
    assert not before & {"numpy", "zenoh", "pyproj", "yaml", "milepost_schemas", "milepost.config.train"}


@pytest.mark.parametrize("moment", ["filter-loop is there", "first state after"])
def test_no_process_outlives_a_killed_up(headless: subprocess.Popen, moment: str) -> None:
    read_until(headless, moment)
    children = children_of(headless.pid)
    assert len(children) >= 3
    headless.kill()
    # every one of them holds the other end of standard error, those that have been forked since as well
    headless.communicate(timeout=1.0)
    wait_until(ended(children), 1.0, "a process outlives the one that started it")


class Terminal:
    """`milepost up` with a table, on a terminal of its own."""

    def __init__(self, up: Up, folder: Path) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 120, 0, 0))
        environment = {**os.environ, "TMPDIR": str(folder), "TERM": "xterm"}
        self.process = up(env=environment, stdin=slave, stdout=slave, stderr=slave, preexec_fn=lambda: os.login_tty(slave))
        os.close(slave)
        self.shown = ""

    def read_until(self, words: str) -> None:
        deadline = time.monotonic() + 30.0
        while words not in self.shown:
            left = max(0.0, deadline - time.monotonic())
            assert select.select([self._master], [], [], left)[0], f"never showed {words!r}: {self.shown[-2000:]}"
            try:
                self.shown += os.read(self._master, 65536).decode(errors="replace")
            except OSError:
                pytest.fail(f"ended before it showed {words!r}: {self.shown[-2000:]}")

    def type(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def rest(self) -> str:
        """What is shown until all have closed the terminal."""
        begin = len(self.shown)
        try:
            while chunk := os.read(self._master, 65536):
                self.shown += chunk.decode(errors="replace")
        except OSError:  # nobody has the other end any more
            pass
        return self.shown[begin:]


def test_the_table_shows_crashes_and_leaves_no_log_behind(up: Up, tmp_path: Path) -> None:
    terminal = Terminal(up, tmp_path)
    terminal.read_until("waiting for")
    terminal.read_until("position")
    (killed,) = [c for c in children_of(terminal.process.pid) if title_of(c) == "milepost run filter radar"]
    os.kill(killed, signal.SIGKILL)
    terminal.read_until("filter-radar ended with signal SIGKILL")
    terminal.read_until("filter-radar restarted")
    assert list(tmp_path.iterdir()) == []
    terminal.type(b"\x03")
    last = terminal.rest()
    assert terminal.process.wait(15.0) == 0
    assert "filter-radar failed; its last lines:" in last
    assert "Traceback" not in terminal.shown
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_on_the_terminal_while_a_table_waits_is_clean(up: Up, tmp_path: Path) -> None:
    terminal = Terminal(up, tmp_path)
    terminal.read_until("waiting for")
    terminal.type(b"\x03")
    last = terminal.rest()
    assert terminal.process.wait(15.0) == 0
    assert "Traceback" not in terminal.shown
    assert "\x1b[?25h" in last, "the cursor is shown again"
    assert list(tmp_path.iterdir()) == []


def test_a_process_without_a_router_says_how_to_start_one() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "milepost", "run", "fuser", "--train", MAGLEV, "--connect", "tcp/127.0.0.1:1"],
        stderr=subprocess.PIPE,
        text=True,
    )
    (line,) = read_until(process, "no router at tcp/127.0.0.1:1 yet")
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=5.0)
    assert "start one with `milepost up` or `milepost run router`" in line


@pytest.mark.parametrize("command", ["status", "watch"])
def test_a_tool_without_a_router_says_how_to_start_one(command: str) -> None:
    arguments = [sys.executable, "-m", "milepost", command, "--connect", "tcp/127.0.0.1:1"]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=30)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("milepost: no router at tcp/127.0.0.1:1: start one with `milepost up` or `milepost run router`")


@pytest.fixture(scope="module")
def running() -> Iterator[tuple[subprocess.Popen, str]]:
    """A train with its first state, and what was said until then; the tests from here on share it."""
    process = launch("--headless", stderr=subprocess.PIPE, text=True)
    try:
        yield process, "".join(read_until(process, "first state after"))
        process.send_signal(signal.SIGINT)
        assert process.wait(15.0) == 0
    finally:
        process.kill()
        process.communicate(timeout=15.0)


def test_every_process_is_named_as_it_comes_and_then_the_first_state(running: tuple[subprocess.Popen, str]) -> None:
    said = running[1]
    assert said.startswith(f"milepost: reading {MAGLEV}\nmilepost: starting 9 processes of maglev-1\n")
    came = re.findall(r"^milepost: (\S+) is there \((\d) of 9\)$", said, re.M)
    assert {name for name, _ in came} == {"router", *(name.replace(" ", "-") for name in NAMES)}
    assert [number for _, number in came] == list("123456789")


def test_each_process_shows_its_role_and_up_has_one_thread(running: tuple[subprocess.Popen, str]) -> None:
    process, _ = running
    roles = sorted(f"milepost run {name}" for name in {"router", *NAMES})
    # the display ends with the first state
    wait_until(lambda: sorted(map(title_of, children_of(process.pid))) == roles, 5.0, "these titles and no others")
    assert psutil.Process(process.pid).num_threads() == 1, "a process with threads must not fork"


def test_a_killed_process_is_forked_anew(running: tuple[subprocess.Popen, str]) -> None:
    process, _ = running
    (killed,) = [child for child in children_of(process.pid) if title_of(child) == "milepost run filter radar"]
    os.kill(killed, signal.SIGKILL)
    said = read_until(process, "filter-radar restarted")
    assert any("filter-radar ended with signal SIGKILL" in line for line in said)

    def successors() -> list[int]:
        return [child for child in children_of(process.pid) if title_of(child) == "milepost run filter radar"]

    wait_until(lambda: successors() not in ([], [killed]), 5.0, "a successor")
