"""A running train that can be broken: real routers, real processes, own ports, own state folder, a witness outside."""

from __future__ import annotations

import contextlib
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.runtime.injecting.commands import send_command
from milepost.runtime.launch import spawned
from milepost.runtime.process import ProcessOptions
from milepost.runtime.train_jobs import router_jobs, train_jobs

from .figures import Figures, measure
from .link import Link
from .relay import Relay
from .running import RunningTrain, free_port, has_ended
from .sentinel import sentinel
from .strain import disk_full, no_more_memory, slowed
from .view import View
from .witness import witnessing

NORMAL_S = 40.0
LONGEST_S = 3600.0
# so many states after the recovery still belong to a measured stretch
TAIL = 25


class Stack(View):
    """A train under test. It is entered like a file, and ends with all its processes.

    Processes have the names of their tokens (`fuser`, `sensor-gnss`, `filter-loop`, `balise`, `world`); the routers are
    `router` and `router-2`.
    """

    def __init__(self, train: str | Path = "full", routers: int = 2) -> None:
        super().__init__()
        self._file = find_file(Path(train), "trains")
        self._routers = routers
        self._exit = ExitStack()
        self._relays: dict[str, Relay] = {}
        self._links: dict[str, list[Link]] = {}

    def __enter__(self) -> Stack:
        with ExitStack() as entered:
            self.folder = Path(entered.enter_context(tempfile.TemporaryDirectory(prefix="milepost-chaos-")))
            self.state_dir = self.folder / "state"
            more = [word for _ in range(self._routers - 1) for word in ("--listen", f"tcp/127.0.0.1:{free_port()}")]
            self.sentinel = entered.enter_context(sentinel(self.folder))
            self.train = RunningTrain(str(self._file), "--state-dir", str(self.state_dir), *more)
            entered.callback(self._end)
            self.endpoints = self.train.endpoints
            loaded = load_train(self._file)
            self.name, self.units = loaded.name, list(loaded.sensors) if loaded.file.chaos else []
            self._options = ProcessOptions(self.endpoints, parent=os.getpid(), state_dir=self.state_dir)
            self._loaded = loaded
            jobs = (*router_jobs(self.endpoints), *train_jobs(loaded, None, self._options))
            self.jobs = {job.name: job for job in jobs}
            self.witness = entered.enter_context(witnessing(self.endpoints))
            self._exit = entered.pop_all()
        return self

    def __exit__(self, *failure: object) -> None:
        self._exit.close()

    def _end(self) -> None:
        for pid in self._started.values():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
        self.train.stop()
        for pid in self._started.values():
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)

    def kill(self, process: str) -> None:
        """SIGKILL; `up` starts it again, and the stack what it started itself."""
        pid, own = self._strike(process), process in self._started
        os.kill(pid, signal.SIGKILL)
        if own:
            self._again(process)

    def _again(self, process: str) -> None:
        self._reap(process)
        self._at_routers(process)
        self.start(process)

    def _well(self) -> bool:
        for process, pid in list(self._started.items()):
            if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):  # as `up` does with what it started
                self._strike(process)
                self._again(process)
        return super()._well()

    def terminate(self, process: str) -> None:
        """SIGTERM, and wait for its end; it stays away until `start`."""
        pid = self._strike(process)
        self._at_routers(process)
        os.kill(pid, signal.SIGTERM)
        if process in self._started:
            self._reap(process)
        else:
            self.wait_for(lambda: has_ended(pid), 10.0, f"the end of {process}")

    def back(self, process: str, timeout_s: float) -> None:
        """Wait until a process that was killed or ended is there again. Raises NotInTime."""
        self.wait_for(
            lambda: any(token.unit == process for token in self.witness.alive - self._gone), timeout_s, f"{process} is back"
        )

    def stop(self, process: str, for_s: float) -> None:
        """SIGSTOP, and SIGCONT after so long; returns then."""
        pid = self.pid(process)
        _check_s("for_s", for_s)
        os.kill(pid, signal.SIGSTOP)
        try:
            time.sleep(for_s)
        finally:
            os.kill(pid, signal.SIGCONT)

    def start(self, process: str, endpoints: list[str] | None = None) -> None:
        """Start a process that was ended, or a second instance of one, at these endpoints."""
        if endpoints is None:
            job = self.jobs[process]
        else:
            options = replace(self._options, connection=endpoints)
            job = next(job for job in train_jobs(self._loaded, None, options) if job.name == process)
        log = (self.folder / f"{process}.log").open("ab")
        with log:
            self._started[process] = spawned(job, log.fileno())

    def disk_full(self, *processes: str) -> AbstractContextManager[None]:
        """A block in which the kernel refuses every byte that these processes write to a file."""
        return disk_full([self.pid(process) for process in processes])

    def slow(self, process: str, times: float, for_s: float) -> None:
        """Let a process run for one part in `times` of the time, for so long; returns then."""
        slowed(self.pid(process), times, for_s)

    def starve(self, process: str, for_s: float) -> None:
        """Let a process have no more memory than it has, for so long; returns then."""
        no_more_memory(self.pid(process), for_s)

    def link(self, process: str) -> list[Link]:
        """The links of a process with the routers; the first time, the process is replaced by one that has such links."""
        self.pid(process)
        if process not in self._links:
            links = [Link(endpoint) for endpoint in self.endpoints]
            for each in links:
                self._exit.callback(each.close)
            self._move(process, [each.endpoint for each in links])
            self._links[process] = links
        return self._links[process]

    def cut(self, process: str, for_s: float) -> None:
        """Cut a process off from all routers for so long; returns then."""
        self._disturb(process, for_s, Link.cut)

    def delay(self, process: str, by_s: float, for_s: float) -> None:
        """Delay all that a process sends and hears, for so long; returns then."""
        _check_s("by_s", by_s)
        self._disturb(process, for_s, lambda each: each.delay(by_s))

    def _disturb(self, process: str, for_s: float, how: Callable[[Link], None]) -> None:
        _check_s("for_s", for_s)
        links = self.link(process)
        for each in links:
            how(each)
        try:
            time.sleep(for_s)
        finally:
            for each in links:
                each.heal()

    def _move(self, process: str, endpoints: list[str]) -> None:
        """Replace a process by one that knows other endpoints; wait until it is there."""
        self.terminate(process)
        self.start(process, endpoints)
        self.back(process, NORMAL_S)

    def behind(self, process: str, heard: Sequence[str]) -> Relay:
        """The relay between a process and the train; the first time, the process is replaced by one behind a relay."""
        if process not in self._relays:
            relay = self._exit.enter_context(Relay(self.endpoints, heard))
            self._move(process, [relay.endpoint])
            self._relays[process] = relay
        return self._relays[process]

    def _at_routers(self, process: str) -> None:
        """Its successor is neither behind a relay nor at links."""
        self._relays.pop(process, None)
        self._links.pop(process, None)

    def _strike(self, process: str) -> int:
        """Note the instance that is about to end; returns its process id."""
        pid = self.pid(process)
        self._gone |= {pid, *(token for token in self.witness.alive if token.unit == process)}
        return pid

    def _reap(self, process: str) -> None:
        if pid := self._started.pop(process, 0):
            os.waitpid(pid, 0)

    def inject(self, unit: str, fault: str, for_s: float | None = None, **options: float | str | bool) -> None:
        """Make a sensor lie, as `milepost inject` does; returns with its answer. Raises AssertionError where it refuses."""
        flags = {name: value for name, value in options.items() if isinstance(value, bool)}
        words = {name: value for name, value in options.items() if isinstance(value, str)}
        numbers = {name: float(value) for name, value in options.items() if name not in flags and name not in words}
        fields: dict[str, Any] = {"kind": fault, "for_s": for_s, "numbers": numbers, "words": words, "flags": flags}
        answer = send_command(self.endpoints, self.name, unit, fields)
        assert answer.code == "fault_injected", answer.text
        self._lying_until = max(self._lying_until, time.monotonic() + (for_s or 0.0))

    @contextmanager
    def measured(self) -> Iterator[Figures]:
        """Figures of the states from here to the end of the block; what stands in them is valid after the block."""
        figures = Figures()
        begin = max(0, len(self.witness.received) - 1)
        try:
            yield figures
        finally:
            recovery_s, until_ns = figures.recovery_s, time.time_ns()
            received, truths = self.witness.received[begin:], self.witness.truths.copy()
            figures.__dict__.update(measure(received, truths, self.sentinel.stalls(), until_ns).__dict__)
            figures.recovery_s = recovery_s

    def recover(self, figures: Figures, timeout_s: float = 30.0) -> None:
        """Wait for the recovery, note how long it took, and hear half a second more."""
        begun = time.monotonic()
        self.recovered(timeout_s)
        figures.recovery_s = time.monotonic() - begun
        heard = len(self.witness.received)
        self.wait_for(lambda: len(self.witness.received) >= heard + TAIL, 10.0, f"{TAIL} states more")


def _check_s(name: str, seconds: float) -> None:
    if not 0.0 <= seconds <= LONGEST_S:
        raise ValueError(f"{name}: must be between 0 and {LONGEST_S:g} s, not {seconds!r}")
