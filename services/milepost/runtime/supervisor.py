"""Starts a train's processes on this machine, restarts those that fail, ends them all together."""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import IO

from .launch import ASKED_TO_END, CONFIGURATION_ERROR, Job, Launch, is_router, launch
from .logs.records import message_of

RESTART_AFTER_S = 0.5
LONGEST_WAIT_S = 8.0
# a process that ran this long before it failed is restarted as if it had never failed before
HEALTHY_S = 3.0
KILL_AFTER_S = 3.0
TAIL_BYTES = 4096
TAIL_LINES = 20


@dataclass
class Child:
    """A job and the process that does it. `code` is None while it runs; `output` is what it wrote, where that is kept."""

    job: Job
    pid: int
    started_s: float
    output: IO[bytes] | None
    code: int | None = None
    restart: bool = True
    restarts: int = 0
    again_at: float | None = None
    failed: bool = False

    @property
    def name(self) -> str:
        """The job's name."""
        return self.job.name

    @property
    def label(self) -> str:
        """The job's name for people."""
        return self.job.label

    @property
    def running(self) -> bool:
        """Whether it has not ended; where it has, its exit code (or minus its signal) is noted."""
        if self.code is None:
            try:
                pid, status = os.waitpid(self.pid, os.WNOHANG)
            except ChildProcessError:  # somebody else has asked for its code
                pid, status = self.pid, 0
            if pid:
                self.code = os.waitstatus_to_exitcode(status)
        return self.code is None

    def tail(self) -> list[str]:
        """The last lines that it wrote."""
        if self.output is None:
            return []
        size = os.fstat(self.output.fileno()).st_size
        text = os.pread(self.output.fileno(), TAIL_BYTES, max(0, size - TAIL_BYTES)).decode(errors="replace")
        return text.splitlines()[-TAIL_LINES:]


def wait_before_restart_s(restarts: int) -> float:
    """0.5 s · 2ⁿ after n restarts, at most 8 s."""
    # the exponent is limited first: 2.0**1024 is an overflow
    return min(RESTART_AFTER_S * 2.0 ** min(restarts, 16), LONGEST_WAIT_S)


class Supervisor:
    """The processes of `milepost up`, each in a session of its own, so that Ctrl-C reaches them through this one, in order.

    `keep_output`: what they write goes to unnamed files, which vanish with this process, for `Child.tail`.
    """

    def __init__(self, keep_output: bool = False, launch: Launch = launch, clock: Callable[[], float] = time.monotonic) -> None:
        self.children: list[Child] = []
        self._keep_output = keep_output
        self._launch = launch
        self._clock = clock

    def start(self, job: Job, shown: bool = False) -> Child:
        """Start a job. `shown`: it writes to the terminal even where output is kept. Raises OSError."""
        output = tempfile.TemporaryFile() if self._keep_output and not shown else None  # noqa: SIM115
        child = Child(job, self._launched(job, output), self._clock(), output, restart=job.restart)
        self.children.append(child)
        return child

    def _launched(self, job: Job, output: IO[bytes] | None) -> int:
        return self._launch(job, None if output is None else output.fileno())

    def watch(self) -> list[str]:
        """Restart what has failed, a moment after. Returns sentences about what happened."""
        # after its scenario's end a train's restarted process would wait for ever; a world that was asked to end is replaced
        over = {child.job.train for child in self.children if child.name == "world" and not child.running and child.code == 0}
        for child in self.children:
            if child.job.train in over:  # nobody is to wait for its restart
                child.again_at = None
        left = (child for child in self.children if not child.running and child.restart and child.job.train not in over)
        return [sentence for child in left for sentence in self._after(child)]

    def _after(self, child: Child) -> Sequence[str]:
        """What to do about a process that has ended."""
        now = self._clock()
        if child.code in (0, ASKED_TO_END):
            return ()
        child.failed = True
        if child.code == CONFIGURATION_ERROR:  # it would end the same way again
            child.restart = False
            return (f"{child.label} cannot run{_last_words(child)}",)
        if child.again_at is None:
            if now - child.started_s >= HEALTHY_S:
                child.restarts = 0
            child.again_at = now + wait_before_restart_s(child.restarts)
            return (f"{child.label} ended with {_why(child.code or 0)}{_last_words(child)}",)
        if now < child.again_at:
            return ()
        child.restarts += 1
        try:
            child.pid = self._launched(child.job, child.output)
        except OSError as error:  # no memory, too many processes: try again
            child.again_at = now + wait_before_restart_s(child.restarts)
            return (f"{child.label} cannot be restarted: {error.strerror}",)
        child.code, child.again_at, child.started_s = None, None, now
        return (f"{child.label} restarted",)

    def stop(self) -> list[str]:
        """SIGTERM to those that would tell that others go, then to all but the routers, which go last.

        SIGKILL to what is still there after three seconds. Returns sentences about those that had to be killed.
        """
        said = []
        routers = [child for child in self.children if is_router(child.name)]
        telling = [child for child in self.children if child.job.tells]
        others = [child for child in self.children if child not in routers and child not in telling]
        for group in (telling, others, routers):
            for child in group:
                _send(child, signal.SIGTERM)
            deadline = time.monotonic() + KILL_AFTER_S
            for child in group:
                while child.running and time.monotonic() < deadline:
                    time.sleep(0.005)
                if child.running:
                    said.append(f"{child.label} did not end within {KILL_AFTER_S:g} s and was killed")
                    _send(child, signal.SIGKILL)
                    while child.running:
                        time.sleep(0.005)
        return said

    def failures(self) -> dict[str, list[str]]:
        """The last lines of every process that has failed and whose output was kept."""
        return {child.label: child.tail() for child in self.children if child.failed and child.output is not None}


def _send(child: Child, number: signal.Signals) -> None:
    # a process that has not been waited for keeps its number: this cannot reach another
    if child.running:
        os.kill(child.pid, number)


def _last_words(child: Child) -> str:
    """What a process that ended by itself wrote last; a killed one has said nothing about it."""
    tail = child.tail() if (child.code or 0) > 0 else []
    return f": {message_of(tail[-1])}" if tail else ""


def _why(code: int) -> str:
    if code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"
