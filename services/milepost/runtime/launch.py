"""Starts child processes: forks of this process, which has imported everything and loaded the train.

A fork copies one thread and shares memory until it is written. It is safe only while this process has one thread and no Zenoh
session. Elsewhere than on Linux, where system libraries may have threads of their own, the same job is spawned as a command.
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass

import setproctitle

from milepost.config.errors import ConfigError
from milepost.estimation.kinds import KindError

from .logs.records import failed, say
from .stop_signals import STOPPING, forget_signals

PR_SET_PDEATHSIG = 1
CONFIGURATION_ERROR = 2
# a forked child that SIGTERM or SIGINT has ended, as shells write it
ASKED_TO_END = 128 + signal.SIGTERM
# numpy on matrices this small only loses time with threads; and a process with threads must not fork
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Job:
    """What a child process does: `run` in a fork, which may return an exit code, or `milepost WORDS OPTIONS` as a command.

    `words` are also its title in process lists. `restart`: whether it is started again when it fails. `stdin` is a file
    descriptor or None for nothing to read. `tells`: it tells of the others, and ends before they do. `train`: of several, whose
    it is.
    """

    name: str
    words: tuple[str, ...]
    options: tuple[str, ...]
    run: Callable[[], int | None]
    restart: bool = True
    stdin: int | None = None
    tells: bool = False
    train: str = ""

    @property
    def title(self) -> str:
        """`milepost run fuser`, of several trains `milepost run fuser (metro-1)`."""
        return " ".join(("milepost", *self.words, *((f"({self.train})",) if self.train else ())))

    @property
    def label(self) -> str:
        """The name for people: `fuser`, of several trains `metro-1 fuser`."""
        return f"{self.train} {self.name}" if self.train else self.name


Launch = Callable[[Job, int | None], int]


def is_router(name: str) -> bool:
    """Whether a job of this name is a router: `router`, `router-2`."""
    return name.split("-")[0] == "router"


def end_with_parent(parent: int) -> None:
    """Have the kernel kill this process when `parent`, which started it, dies. It cannot be missed or ignored."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before the line above
            os.kill(os.getpid(), signal.SIGKILL)


def exit_code(run: Callable[[], int | None]) -> int:
    """Run to the end; a mistake in a configuration (2), a failing or a full system (1) and, in a log, a bug (1) is one line."""
    try:
        return run() or 0
    except (ConfigError, KindError) as error:
        say(str(error), logging.ERROR)
        return CONFIGURATION_ERROR
    except OSError as error:  # a file, a port, no router
        say(str(error), logging.ERROR)
        return 1
    except MemoryError:
        say("out of memory", logging.ERROR)
        return 1
    except Exception as error:
        failed(error)
        return 1


def share_what_is_loaded() -> None:
    """Before the first fork: keep a child's garbage collector from writing to what it shares, for writing is copying."""
    # it looks for the place of the title, once for all
    setproctitle.getproctitle()
    gc.collect()
    gc.freeze()


def forked(job: Job, output: int | None) -> int:
    """Fork and do the job in the child; returns its process id. `output`: where it writes, None for where this one does."""
    parent = os.getpid()
    # a signal between the fork and the child's own handlers would run this process's handler in the child, and be lost
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        pid = os.fork()
        if pid == 0:
            _be_child(job, output, parent, before)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return pid


def _be_child(job: Job, output: int | None, parent: int, mask: set[int]) -> None:
    """The whole life of a forked child: never returns."""
    code = 1
    try:
        forget_signals()
        end_with_parent(parent)
        # Ctrl-C reaches it only through the parent, which ends all in order
        os.setsid()
        _redirect(job.stdin, output)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        setproctitle.setproctitle(job.title)
        code = exit_code(job.run)
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _redirect(stdin: int | None, output: int | None) -> None:
    source = os.open(os.devnull, os.O_RDONLY) if stdin is None else stdin
    os.dup2(source, 0)
    if output is not None:
        os.dup2(output, 1)
        os.dup2(output, 2)


def spawned(job: Job, output: int | None) -> int:
    """Start the job as a command; returns its process id."""
    process = subprocess.Popen(
        [sys.executable, "-m", "milepost", *job.words, *job.options],
        start_new_session=True,
        stdin=subprocess.DEVNULL if job.stdin is None else job.stdin,
        stdout=output,
        stderr=output,
        env={**os.environ, **ONE_THREAD},
    )
    # the supervisor waits for it by its number
    process.returncode = 0
    return process.pid


# whether a job is a fork, which does what no command could say
FORKS = sys.platform == "linux"
launch: Launch = forked if FORKS else spawned
