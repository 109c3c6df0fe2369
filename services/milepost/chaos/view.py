"""What can be asked of a running train: its processes, what an outsider has heard of it, whether all is well."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from milepost.recordings.options import nearest
from milepost.runtime.instances import Token
from milepost.runtime.launch import Job, is_router
from milepost_schemas import Event, FusedState

from .news import NotInTime
from .running import RunningTrain
from .witness import Witness

FRESH_S = 0.5
MUTE_NS = 3_000_000_000
# routers that did not listen are looked at again after so long
LOOK_AGAIN_S = 0.25


def begins_traceback(line: str) -> bool:
    """Whether a line of a process's output begins the traceback of an exception, in Python or in Zenoh."""
    return "Traceback" in line or "panicked" in line


class View:
    """A running train as seen from outside; `jobs` are all its processes, routers first."""

    name: str
    jobs: dict[str, Job]
    endpoints: list[str]
    train: RunningTrain
    folder: Path
    witness: Witness

    def __init__(self) -> None:
        # processes that `up` did not start
        self._started: dict[str, int] = {}
        # what must have gone, and until when a sensor lies, before the train can be said to have recovered
        self._gone: set[int | Token] = set()
        self._lying_until = 0.0
        self._look_again = 0.0

    @property
    def processes(self) -> list[str]:
        """The names of all processes, routers first."""
        return list(self.jobs)

    @property
    def there(self) -> set[str]:
        """The names of the processes whose tokens are there."""
        return {token.unit for token in self.witness.alive if token.train == self.name}

    @property
    def states(self) -> list[FusedState]:
        """All states that the outside subscriber has received."""
        return [state for _, state in self.witness.received]

    @property
    def events(self) -> list[Event]:
        """All events that it has received."""
        return self.witness.events

    @property
    def state(self) -> FusedState | None:
        """The newest state."""
        return self.witness.received[-1][1] if self.witness.received else None

    @property
    def leader(self) -> str:
        """The process that spoke last on `state`."""
        return self.witness.received[-1][1].unit

    @property
    def standby(self) -> str:
        """A fuser that does not lead."""
        return next(name for name in self.jobs if name.startswith("fuser") and name != self.leader)

    @property
    def router(self) -> str:
        """The router through which the outside subscriber hears."""
        ports = {c.raddr.port for c in psutil.Process().net_connections("tcp") if c.raddr and c.status == "ESTABLISHED"}
        for name, endpoint in zip((n for n in self.jobs if is_router(n)), self.endpoints, strict=True):
            if int(endpoint.rpartition(":")[2]) in ports:
                return name
        raise NotInTime("no router is connected")

    @property
    def other_router(self) -> str:
        """A router through which it does not hear."""
        return next(name for name in self.jobs if is_router(name) and name != self.router)

    @property
    def lines(self) -> dict[str, list[str]]:
        """What was written so far, by `up` and by each process that it did not start."""
        logs = {path.stem: path.read_text("utf-8", "replace").splitlines() for path in sorted(self.folder.glob("*.log"))}
        return {"up": self.train.errors.copy(), **logs}

    @property
    def tracebacks(self) -> list[str]:
        """Lines of the processes' output that begin a traceback."""
        return [line for lines in self.lines.values() for line in lines if begins_traceback(line)]

    @property
    def mute(self) -> list[str]:
        """The processes that are there, and whose health was not heard for three seconds."""
        since_ns = time.time_ns() - MUTE_NS
        heard = {health.unit for health in list(self.witness.health.values()) if health.published_at_ns > since_ns}
        return [name for name in self.jobs if name in self.there and name not in heard]

    def pid(self, process: str) -> int:
        """The process id of a process. Raises LookupError."""
        if process not in self.jobs:
            raise LookupError(
                f"{self.name} has no process {process!r}{nearest(process, self.jobs)}; it has {', '.join(self.jobs)}"
            )
        return self._started[process] if process in self._started else self.train.pid_of(*self.jobs[process].words[1:])

    def refused(self) -> int:
        """How many messages all processes have refused, those that ended too, as their newest health says."""
        return sum(sum(health.refused.values()) for health in list(self.witness.health.values()))

    def wait_for(self, what: Callable[[], Any], timeout_s: float, why: str = "what was waited for") -> Any:
        """Wait until `what()` is true, looked at whenever something is heard; returns it. Raises NotInTime."""
        return self.witness.news.wait_for(what, timeout_s, why)

    def healthy(self) -> bool:
        """All processes are there, the newest state is fresh and `normal`, and no unit is excluded."""
        if not self.witness.received or time.monotonic() < self._lying_until or not self._gone.isdisjoint(self.witness.alive):
            return False
        at_ns, state = self.witness.received[-1]
        wanted = {name for name in self.jobs if not is_router(name)}
        fresh = (time.time_ns() - at_ns) * 1e-9 < FRESH_S
        well = fresh and state.status == "normal" and not state.excluded and wanted <= self.there
        return well and self._routers_listen()

    def _well(self) -> bool:
        return self.healthy()

    def _routers_listen(self) -> bool:
        """Whether all routers listen; where one does not, no for a moment without another look.

        All processes and their sockets are looked through: for each message that would take a fifth of a processor.
        """
        if time.monotonic() < self._look_again:
            return False
        if deaf := self._deaf_routers():
            self._look_again = time.monotonic() + LOOK_AGAIN_S
        return not deaf

    def _deaf_routers(self) -> dict[str, str]:
        """The routers that do not listen where they should, and what is seen instead."""
        routers = [name for name in self.jobs if is_router(name)]
        found = {name: self._deaf(name, endpoint) for name, endpoint in zip(routers, self.endpoints, strict=True)}
        return {name: why for name, why in found.items() if why}

    def _deaf(self, router: str, endpoint: str) -> str:
        port = int(endpoint.rpartition(":")[2])
        try:
            pid = self.pid(router)
            sockets = psutil.Process(pid).net_connections("tcp")
        except (LookupError, psutil.Error) as error:
            return repr(error)
        if pid in self._gone:
            return f"process {pid} has ended"
        ports = {each.laddr.port for each in sockets if each.status == psutil.CONN_LISTEN}
        return "" if port in ports else f"process {pid} listens on {sorted(ports)}, not on {port}"

    def recovered(self, timeout_s: float = 30.0) -> None:
        """Wait until all is well again. Raises NotInTime, with what is not."""
        try:
            self.wait_for(self._well, timeout_s, "the train recovered")
        except NotInTime as late:
            absent = [name for name in self.jobs if not is_router(name) and name not in self.there]
            said = f"{self.state.status}, excluded {[e.unit for e in self.state.excluded]}" if self.state else "no state"
            lingering = [f"{token.unit}/{token.instance}" for token in self.witness.alive if token in self._gone]
            rest = f"mute {self.mute}, tokens of ended instances {lingering}, routers that do not listen {self._deaf_routers()}"
            raise NotInTime(f"{late} ({said}, absent {absent}, {rest})") from late
