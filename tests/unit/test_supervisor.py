"""The supervisor, with real child processes that end at once or never."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from milepost.runtime.launch import ASKED_TO_END, Job
from milepost.runtime.supervisor import HEALTHY_S, Child, Supervisor, wait_before_restart_s

# says that it is ready, then waits for ever; on SIGTERM it writes the time into the file that it is named
OBEDIENT = """
import signal, sys, time
def end(*_):
    open(sys.argv[1], "w").write(str(time.monotonic_ns())); sys.exit(0)
signal.signal(signal.SIGTERM, end)
open(sys.argv[1] + ".ready", "w").close()
while True: time.sleep(10)
"""
STUBBORN = """
import signal, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
open(sys.argv[1] + ".ready", "w").close()
while True: time.sleep(10)
"""


def python(job: Job, output: int | None) -> int:
    """Launches a job whose options are a Python program and its arguments."""
    process = subprocess.Popen([sys.executable, "-c", *job.options], stdout=output, stderr=output)
    process.returncode = 0  # it is the supervisor that waits for it
    return process.pid


def job(name: str, program: str, *arguments: str, restart: bool = True, tells: bool = False) -> Job:
    return Job(name, ("run", name), (program, *arguments), lambda: None, restart, tells=tells)


class Clock:
    """A clock that the test sets."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def supervisor(clock: Clock) -> Iterator[Supervisor]:
    supervisor = Supervisor(launch=python, clock=clock)
    yield supervisor
    supervisor.stop()


def ended(child: Child) -> Child:
    """Wait until a child has ended by itself."""
    deadline = time.monotonic() + 20.0
    while child.running:
        assert time.monotonic() < deadline, f"{child.name} does not end"
        time.sleep(0.005)
    return child


def ready(path: Path) -> None:
    deadline = time.monotonic() + 20.0
    while not Path(f"{path}.ready").exists():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def restarted(supervisor: Supervisor, child: Child, clock: Clock) -> float:
    """Let a child that fails at once be restarted; returns how long that took on the clock."""
    ended(child)
    (sentence,) = supervisor.watch()
    assert sentence == f"{child.name} ended with exit code 3"
    assert supervisor.watch() == []
    begun, before = clock.now, child.pid
    assert child.again_at is not None
    clock.now = child.again_at
    assert supervisor.watch() == [f"{child.name} restarted"]
    assert child.pid != before
    return clock.now - begun


def test_a_process_that_fails_is_restarted_after_half_a_second(supervisor: Supervisor, clock: Clock) -> None:
    child = supervisor.start(job("loop", "raise SystemExit(3)"))
    assert restarted(supervisor, child, clock) == pytest.approx(0.5)


def test_the_wait_doubles_with_each_restart_up_to_eight_seconds(supervisor: Supervisor, clock: Clock) -> None:
    child = supervisor.start(job("loop", "raise SystemExit(3)"))
    waits = [restarted(supervisor, child, clock) for _ in range(6)]
    assert waits == pytest.approx([0.5, 1.0, 2.0, 4.0, 8.0, 8.0])


def test_the_wait_has_a_limit_after_any_number_of_restarts() -> None:
    assert {wait_before_restart_s(n) for n in (5, 1024, 1025, 10**6)} == {8.0}


def test_a_process_is_restarted_after_thousands_of_restarts(supervisor: Supervisor, clock: Clock) -> None:
    child = supervisor.start(job("loop", "raise SystemExit(3)"))
    child.restarts = 5000
    assert restarted(supervisor, child, clock) == pytest.approx(8.0)
    assert child.restarts == 5001


def test_restarts_are_forgotten_after_a_healthy_while(supervisor: Supervisor, clock: Clock) -> None:
    child = supervisor.start(job("loop", "raise SystemExit(3)"))
    for _ in range(4):
        restarted(supervisor, child, clock)
    clock.now += HEALTHY_S
    assert restarted(supervisor, child, clock) == pytest.approx(0.5)
    assert restarted(supervisor, child, clock) == pytest.approx(1.0)


def test_a_process_that_somebody_kills_every_five_seconds_is_back_as_soon_each_time(
    supervisor: Supervisor, clock: Clock
) -> None:
    child = supervisor.start(job("loop", "raise SystemExit(3)"))
    waits = []
    for _ in range(4):
        clock.now += 4.5
        waits.append(restarted(supervisor, child, clock))
    assert waits == pytest.approx([0.5] * 4)


def test_restarts_are_not_forgotten_before(supervisor: Supervisor, clock: Clock) -> None:
    child = supervisor.start(job("loop", "raise SystemExit(3)"))
    for _ in range(4):
        restarted(supervisor, child, clock)
    clock.now += HEALTHY_S - 0.1
    assert restarted(supervisor, child, clock) == pytest.approx(8.0)


def test_a_killed_process_is_reported_by_its_signal(supervisor: Supervisor) -> None:
    child = supervisor.start(job("loop", "import time; time.sleep(60)"))
    os.kill(child.pid, signal.SIGKILL)
    ended(child)
    assert supervisor.watch() == ["loop ended with signal SIGKILL"]


def test_a_mistake_in_the_configuration_is_not_tried_again(supervisor: Supervisor, clock: Clock) -> None:
    child = ended(supervisor.start(job("loop", "raise SystemExit(2)")))
    assert supervisor.watch() == ["loop cannot run"]
    clock.now += 100.0
    assert supervisor.watch() == []
    assert child.restarts == 0


def test_a_process_that_has_done_its_work_stays_ended(supervisor: Supervisor, clock: Clock) -> None:
    ended(supervisor.start(job("loop", "")))
    clock.now += 100.0
    assert supervisor.watch() == []


def test_a_process_that_may_not_be_restarted_is_not(supervisor: Supervisor, clock: Clock) -> None:
    ended(supervisor.start(job("world", "raise SystemExit(3)", restart=False)))
    clock.now += 100.0
    assert supervisor.watch() == []


def test_nothing_is_restarted_once_the_scenario_is_over(supervisor: Supervisor, clock: Clock) -> None:
    loop = supervisor.start(job("loop", "raise SystemExit(3)"))
    ended(supervisor.start(job("world", "", restart=False)))
    ended(loop)
    clock.now += 100.0
    assert supervisor.watch() == []


def test_nobody_waits_for_a_restart_once_the_scenario_is_over(supervisor: Supervisor, clock: Clock) -> None:
    """GIVEN a process that is to be restarted, WHEN its scenario ends before that, THEN it is no longer waited for."""
    failed = ended(supervisor.start(job("sensor", "raise SystemExit(3)")))
    supervisor.watch()
    assert failed.again_at is not None
    ended(supervisor.start(job("world", "", restart=False)))
    supervisor.watch()
    assert failed.again_at is None


def test_the_end_of_one_trains_scenario_ends_no_other_train(clock: Clock) -> None:
    supervisor = Supervisor(launch=python, clock=clock)
    ended(supervisor.start(replace(job("world", ""), train="a")))
    ended(supervisor.start(replace(job("loop", "raise SystemExit(3)"), train="a")))
    ended(supervisor.start(replace(job("loop", "raise SystemExit(3)"), train="b")))
    assert supervisor.watch() == ["b loop ended with exit code 3"]


def test_processes_are_restarted_after_somebody_has_ended_the_world(supervisor: Supervisor, clock: Clock) -> None:
    loop = supervisor.start(job("loop", "raise SystemExit(3)"))
    ended(supervisor.start(job("world", f"raise SystemExit({ASKED_TO_END})")))
    restarted(supervisor, loop, clock)


def test_a_process_that_was_asked_to_end_stays_ended(supervisor: Supervisor, clock: Clock) -> None:
    child = ended(supervisor.start(job("loop", f"raise SystemExit({ASKED_TO_END})")))
    clock.now += 100.0
    assert supervisor.watch() == []
    assert not child.failed


def test_a_restart_that_the_system_refuses_is_tried_again(clock: Clock) -> None:
    refusals = [OSError(11, "Resource temporarily unavailable")]

    def launch(job: Job, output: int | None) -> int:
        if supervisor.children and refusals:
            raise refusals.pop()
        return python(job, output)

    supervisor = Supervisor(launch=launch, clock=clock)
    child = ended(supervisor.start(job("loop", "raise SystemExit(3)")))
    assert supervisor.watch() == ["loop ended with exit code 3"]
    clock.now += 0.5
    assert supervisor.watch() == ["loop cannot be restarted: Resource temporarily unavailable"]
    clock.now += 0.5
    assert supervisor.watch() == []
    clock.now += 0.5
    assert supervisor.watch() == ["loop restarted"]
    ended(child)


def test_the_last_line_of_a_failure_is_told_and_the_last_ones_kept(clock: Clock) -> None:
    supervisor = Supervisor(keep_output=True, launch=python, clock=clock)
    ended(supervisor.start(job("loop", "print(*range(100), sep='\\n', flush=True); raise ValueError('no pulse')")))
    ended(supervisor.start(job("radar", "print('all is well')")))
    assert supervisor.watch() == ["loop ended with exit code 1: ValueError: no pulse"]
    assert list(supervisor.failures()) == ["loop"]
    lines = supervisor.failures()["loop"]
    assert lines[-1] == "ValueError: no pulse"
    assert "99" in lines
    assert "1" not in lines


def test_kept_output_has_no_name_in_the_temporary_folder(clock: Clock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    supervisor = Supervisor(keep_output=True, launch=python, clock=clock)
    child = supervisor.start(job("loop", "print('here', flush=True); import time; time.sleep(60)"))
    deadline = time.monotonic() + 20.0
    while child.tail() != ["here"] and time.monotonic() < deadline:
        time.sleep(0.005)
    assert child.tail() == ["here"]
    assert list(tmp_path.iterdir()) == []
    supervisor.stop()


def test_stopping_ends_the_router_last_and_kills_what_does_not_end(tmp_path: Path, clock: Clock) -> None:
    supervisor = Supervisor(launch=python, clock=clock)
    paths = {name: tmp_path / name for name in ("router", "fuser", "hanging")}
    supervisor.start(job("router", OBEDIENT, str(paths["router"])))
    supervisor.start(job("fuser", OBEDIENT, str(paths["fuser"])))
    hanging = supervisor.start(job("hanging", STUBBORN, str(paths["hanging"])))
    for path in paths.values():
        ready(path)
    assert supervisor.stop() == ["hanging did not end within 3 s and was killed"]
    assert [child.code for child in supervisor.children] == [0, 0, -signal.SIGKILL]
    assert not hanging.running
    assert int(paths["fuser"].read_text()) < int(paths["router"].read_text())


def test_stopping_ends_those_first_that_would_tell_that_others_are_gone(tmp_path: Path, clock: Clock) -> None:
    supervisor = Supervisor(launch=python, clock=clock)
    paths = {name: tmp_path / name for name in ("router", "sensor", "fuser")}
    for name, path in paths.items():
        supervisor.start(job(name, OBEDIENT, str(path), tells=name == "fuser"))
    for path in paths.values():
        ready(path)
    assert supervisor.stop() == []
    ended_ns = {name: int(path.read_text()) for name, path in paths.items()}
    assert sorted(ended_ns, key=ended_ns.__getitem__) == ["fuser", "sensor", "router"]
