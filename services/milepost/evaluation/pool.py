"""Many seeds of many scenarios on all cores; the results do not depend on the number of cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, MutableSequence, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.managers import SyncManager
from pathlib import Path
from typing import Any, TextIO

from milepost.offline.memory_bus import Tap
from milepost.offline.message_log import write_line

from .plan import make_plan
from .scenario_run import ProgressCallback, Traces, later, run_plan

LOOK_EVERY_S = 0.2
# enough for a picture; figures are computed from every epoch
EPOCHS_OF_A_PICTURE = 3000


@dataclass(frozen=True)
class Task:
    """A scenario on one seed. `keep`: return traces. `record`: write every message of the scenario's own train to this file."""

    path: Path
    seed: int
    work_s: float
    keep: bool = False
    record: Path | None = None


@dataclass(frozen=True)
class Outcome:
    """The result of a task: the figures and, if they were kept, the thinned traces of each case."""

    task: Task
    result: dict[str, Any]
    traces: dict[str, Traces] | None


class Cancelled(Exception):
    """The evaluation was interrupted."""


def run_tasks(tasks: Sequence[Task], jobs: int, progress: ProgressCallback) -> list[Outcome]:
    """The outcomes, in the order of the tasks; `progress` is called with the seconds of scenario time done in all."""
    if min(jobs, len(tasks)) <= 1:
        out, done = [], 0.0
        for task in tasks:
            out.append(run_task(task, later(progress, done)))
            done += task.work_s
        return out
    return _in_processes(tasks, min(jobs, len(tasks)), progress)


def run_task(task: Task, progress: ProgressCallback) -> Outcome:
    """Run one task in this process."""
    plan = make_plan(task.path, task.seed)
    with _writer(task.record) as also:
        run = run_plan(plan, also, progress)
    return Outcome(task, run.result, {case: _thinned(traces) for case, traces in run.traces.items()} if task.keep else None)


def _thinned(traces: Traces) -> Traces:
    return {name: trace.within(slice(None, None, -(-len(trace.t_s) // EPOCHS_OF_A_PICTURE))) for name, trace in traces.items()}


@contextmanager
def _writer(path: Path | None) -> Iterator[Tap | None]:
    if path is None:
        yield None
        return
    with path.open("w", encoding="utf-8") as file:
        yield _to(file)


def _to(file: TextIO) -> Tap:
    return lambda output, now_ns: write_line(file, output.message.train, output, now_ns)


def _in_processes(tasks: Sequence[Task], jobs: int, progress: ProgressCallback) -> list[Outcome]:
    spawn = multiprocessing.get_context("spawn")
    with _interrupt_held_back():
        manager = SyncManager(ctx=spawn)
        manager.start(_end_with_parent)
    with manager, ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_end_with_parent) as pool:
        done_s, stop = manager.list([0.0] * len(tasks)), manager.Event()
        try:
            # an interrupt that was held back comes at the end of this block: the tasks must be cancelled then too
            with _interrupt_held_back():
                futures = [pool.submit(_work, place, task, done_s, stop) for place, task in enumerate(tasks)]
            _watch(futures, lambda: progress(sum(done_s)))
        except BaseException:
            # a worker checks this once per second of scenario time
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
            raise
        return [future.result() for future in futures]


def _watch(futures: Sequence[Future[Outcome]], look: Callable[[], None]) -> None:
    left = set(futures)
    while left:
        finished, left = wait(left, LOOK_EVERY_S, FIRST_COMPLETED)
        for future in finished:
            future.result()
        look()


@contextmanager
def _interrupt_held_back() -> Iterator[None]:
    """Processes started inside never receive Ctrl-C: the main process receives it and stops them."""
    # the tracker resets the signal mask when it starts, so it must run before the mask is set
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End this process when its parent ends, even if the parent was killed."""
    parent = multiprocessing.parent_process()

    def wait_for_it() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()


def _work(place: int, task: Task, done_s: MutableSequence[float], stop: threading.Event) -> Outcome:
    def progress(t_s: float) -> None:
        if stop.is_set():
            raise Cancelled
        done_s[place] = t_s

    return run_task(task, progress)
