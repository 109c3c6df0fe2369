"""Tasks in several processes: results in order, each one told as soon as it is there."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator

import psutil
import pytest

from milepost.offline.process_pool import run_in_processes


def squared(task: float, progress: Callable[[float], None]) -> tuple[float, int]:
    progress(task / 2.0)
    if task < 0.0:
        raise ValueError("negative")
    progress(task)
    return task * task, os.getpid()


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_tasks(jobs: int) -> None:
    results = run_in_processes(squared, [3.0, 1.0, 2.0], jobs, lambda done: None)
    assert [result for result, _ in results] == [9.0, 1.0, 4.0]
    assert (os.getpid() in {process for _, process in results}) == (jobs == 1)


@pytest.mark.parametrize("jobs", [1, 2])
def test_each_result_is_told_once_with_its_place(jobs: int) -> None:
    told: dict[int, float] = {}
    run_in_processes(squared, [3.0, 1.0, 2.0], jobs, lambda done: None, lambda place, result: told.update({place: result[0]}))
    assert told == {0: 9.0, 1: 1.0, 2: 4.0}


@pytest.mark.parametrize("jobs", [1, 2])
def test_progress_is_the_sum_over_all_tasks(jobs: int) -> None:
    told: list[float] = []
    run_in_processes(squared, [3.0, 1.0, 2.0], jobs, told.append)
    assert told == sorted(told)
    assert told[-1] == 6.0


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_task_that_fails_fails_the_whole(jobs: int) -> None:
    with pytest.raises(ValueError, match="negative"):
        run_in_processes(squared, [1.0, -1.0], jobs, lambda done: None)


@pytest.mark.parametrize("jobs", [1, 2])
def test_without_tasks_there_are_no_results(jobs: int) -> None:
    assert run_in_processes(squared, [], jobs, lambda done: None) == []


def waits(task: float, progress: Callable[[float], None]) -> float:
    while True:
        progress(task)
        time.sleep(0.01)


@pytest.fixture
def interruptible() -> Iterator[None]:
    """As the command line sees to it: what a shell has started in the background ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("where", ["spawning", "watching"])
def test_an_interrupt_ends_all_wherever_it_comes(where: str) -> None:
    """GIVEN workers that never end, WHEN Ctrl-C comes while they are spawned or watched, THEN all end, and nobody hangs."""
    before = set(psutil.Process().children(recursive=True))

    def look(done: float) -> None:
        if where == "watching":
            os.kill(os.getpid(), signal.SIGINT)

    if where == "spawning":
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        run_in_processes(waits, [1.0, 2.0, 3.0], 2, look)
    left = [
        p for p in set(psutil.Process().children(recursive=True)) - before if "resource_tracker" not in " ".join(p.cmdline())
    ]
    assert psutil.wait_procs(left, timeout=10.0)[1] == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
