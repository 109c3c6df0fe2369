"""Many tasks on all cores: progress while they run, each result as soon as it is there, and Ctrl-C ends all of them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, MutableSequence, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.managers import SyncManager
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")
Progress = Callable[[float], None]
Work = Callable[[T, Progress], R]
Finished = Callable[[int, R], None]

LOOK_EVERY_S = 0.2


class Cancelled(Exception):
    """The work was interrupted."""


def run_in_processes(
    work: Work[T, R], tasks: Sequence[T], jobs: int, progress: Progress, finished: Finished[R] | None = None
) -> list[R]:
    """`work` of every task, in `jobs` processes; the results in the order of the tasks.

    `work` is a module's function. It is called with a task and with a function to which it says how much of the task is done,
    at least once a second: there it learns that it was interrupted. `progress` is called with the sum over all tasks,
    `finished` with the place of a task and its result as soon as there is one; both in this process.
    """
    jobs = min(jobs, len(tasks))
    return _here(work, tasks, progress, finished) if jobs <= 1 else _elsewhere(work, tasks, jobs, progress, finished)


def _here(work: Work[T, R], tasks: Sequence[T], progress: Progress, finished: Finished[R] | None) -> list[R]:
    out: list[R] = []
    done = last = 0.0

    def note(more: float) -> None:
        nonlocal last
        last = more
        progress(done + more)

    for place, task in enumerate(tasks):
        out.append(work(task, note))
        done, last = done + last, 0.0
        if finished is not None:
            finished(place, out[-1])
    return out


def _elsewhere(work: Work[T, R], tasks: Sequence[T], jobs: int, progress: Progress, finished: Finished[R] | None) -> list[R]:
    spawn = multiprocessing.get_context("spawn")
    with _Interrupt() as interrupt:
        with _deaf_children():
            manager = SyncManager(ctx=spawn)
            manager.start(_end_with_parent)
        with manager, ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_end_with_parent) as pool:
            done, stop = manager.list([0.0] * len(tasks)), manager.Event()
            try:
                with _deaf_children():
                    futures = [pool.submit(_work, work, place, task, done, stop) for place, task in enumerate(tasks)]
                # the whole list at once: each entry by itself would be a message
                _watch(futures, lambda: progress(sum(done[:])), finished, interrupt)
            except BaseException:
                # a worker checks this whenever it tells its progress
                stop.set()
                pool.shutdown(wait=True, cancel_futures=True)
                raise
            return [future.result() for future in futures]


def _watch(futures: Sequence[Future[R]], look: Callable[[], None], finished: Finished[R] | None, interrupt: _Interrupt) -> None:
    places = {future: place for place, future in enumerate(futures)}
    left = set(futures)
    while left:
        interrupt.raise_if_asked()
        ready, left = wait(left, LOOK_EVERY_S, FIRST_COMPLETED)
        for future in sorted(ready, key=places.__getitem__):
            result = future.result()
            if finished is not None:
                finished(places[future], result)
        look()


class _Interrupt:
    """Inside this context Ctrl-C is noted, and becomes KeyboardInterrupt only where it is asked for.

    Anywhere else it could leave a lock of the pool taken for ever.
    """

    def __init__(self) -> None:
        self._asked = False
        self._before: Any = None
        self._main = threading.current_thread() is threading.main_thread()

    def __enter__(self) -> _Interrupt:
        """Install the handler."""
        if self._main:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Restore the handler before."""
        if self._main:
            signal.signal(signal.SIGINT, self._before)
        if kind is None:
            self.raise_if_asked()

    def _note(self, *_: object) -> None:
        self._asked = True

    def raise_if_asked(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C came."""
        if self._asked:
            raise KeyboardInterrupt


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Processes started inside never receive Ctrl-C, from their first instruction on: the main process receives it."""
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


def _work(work: Work[T, R], place: int, task: T, done: MutableSequence[float], stop: threading.Event) -> R:
    def progress(more: float) -> None:
        if stop.is_set():
            raise Cancelled
        done[place] = more

    return work(task, progress)
