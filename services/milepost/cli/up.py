"""`milepost up`: whole trains on this machine.

What is imported here is light, so that something is shown at once. The rest is imported, and the trains loaded, before the
first process is forked from this one.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from milepost.config.errors import ConfigError
from milepost.runtime.launch import ONE_THREAD, Job, share_what_is_loaded
from milepost.runtime.stop_signals import StopSignals
from milepost.runtime.supervisor import Child, Supervisor

from .endpoint import port_is_free
from .joining import may_join
from .machines.web_servers import WebPorts
from .proc import age_s, proportional_mib
from .run import RECORDER
from .say import say
from .up_output import completed, scratch, telling

if TYPE_CHECKING:
    from milepost.config.fleet_file import Member
    from milepost.runtime.process import ProcessOptions
    from milepost.runtime.zenoh_config import Connection

    from .showing.display import Mode

LOOK_EVERY_S = 0.2
MEASURE_MEMORY_EVERY_S = 2.0
# the configuration file of a process's session, by its name
Files = Callable[[str], Path]
MEASURING = ("sentinel", "observer")
NO_SERVERS = WebPorts()


@dataclass(frozen=True)
class UpOptions:
    """The command line of `milepost up`. `connect`: the routers to join, instead of those on `listen`."""

    train_files: list[Path]
    fleet_file: Path | None
    duration_s: float | None
    speed: float
    report: Path | None
    headless: bool
    listen: list[str]
    connect: list[str]
    state_dir: Path | None
    secure: bool = False
    record: Path | None = None
    external: Sequence[str] = ()
    web: WebPorts = NO_SERVERS

    @property
    def mode(self) -> Mode:
        """How the trains are shown."""
        if self.headless:
            return "start"
        return "table" if sys.stdout.isatty() else "lines"

    @property
    def endpoints(self) -> list[str]:
        """Where the routers are."""
        return self.connect or self.listen


@dataclass(frozen=True)
class Crew:
    """The processes of one train, and when they are started, in seconds after the first ones.

    `awaited`: the labels of all that are to come, those included that somebody else starts.
    """

    train: str
    line: Path
    jobs: list[Job]
    start_after_s: float
    awaited: list[str]


def run_up(options: UpOptions) -> int:
    """Start everything, show it, end it. Raises ConfigError before anything starts."""
    began_ns = time.time_ns() - round(age_s() * 1e9)
    say(f"reading {', '.join(map(str, [*options.train_files, *([options.fleet_file] if options.fleet_file else [])]))}")
    with _nothing_to_end():
        options = _check(options)
        crews, files = _load(options)
        trains = [crew.train for crew in crews]
        if options.connect and (code := may_join(options.connect, trains)):
            return code
    jobs = [job for crew in crews for job in crew.jobs]
    say(f"starting {len(jobs) + len(options.listen)} processes of {', '.join(trains)}")
    if files is not None:
        say(f"tools connect with --zenoh-config {files('dispatch')}")
    for sentence in options.web.sentences():
        say(sentence)
    from .up_jobs import display_job, measuring_jobs, router_jobs

    share_what_is_loaded()
    # the table and what processes write cannot share a terminal
    to_table = options.mode == "table" and sys.stderr.isatty()
    supervisor = Supervisor(keep_output=to_table)
    with StopSignals() as stop, scratch(options.report) as folder, telling(to_table) as (tell, heard):
        names = [*(["router"] if options.listen else []), *(label for crew in crews for label in crew.awaited)]

        def connection(name: str) -> Connection:
            return options.endpoints if files is None else files(name)

        shown = display_job(options.mode, connection("display"), trains, names, began_ns, heard)
        try:
            for router in router_jobs(options.listen, files):
                supervisor.start(router)
            supervisor.start(shown, shown=True)
            for job in (
                *measuring_jobs(connection("observer"), trains, options.report, folder / "stalls.jsonl"),
                *options.web.jobs(connection, [crew.line for crew in crews]),
            ):
                supervisor.start(job)
            memory_mib = _watch(supervisor, crews, stop, tell, options.report is not None)
        finally:
            for sentence in supervisor.stop():
                say(sentence)
    for name, lines in supervisor.failures().items():
        say("\n".join([f"{name} failed; its last lines:", *lines]))
    return 0 if options.report is None or completed(options.report, began_ns, memory_mib) else 1


def _crew(member: Member, shared: ProcessOptions, files: Files | None, record: Path | None, start_after_s: float) -> Crew:
    from milepost.runtime.train_jobs import checked_world, train_jobs

    from .recording.job import recorder_jobs

    train, external = member.train, member.external
    # it comes first, and scenario time waits for it: what is sent at the beginning is recorded too
    recorder = list(recorder_jobs(train, record, shared, files))
    shared = replace(shared, awaits=tuple(job.name for job in recorder))
    jobs = [*recorder, *train_jobs(train, checked_world(train, shared.duration_s, external), shared, files, external)]
    several = f"{train.name} " if shared.change is not None else ""
    awaited = [*(job.label for job in jobs), *(f"{several}sensor-{unit}" for unit in external)]
    return Crew(train.name, train.file.line, jobs, start_after_s, awaited)


@contextlib.contextmanager
def _nothing_to_end() -> Iterator[None]:
    """As long as nothing has been started, Ctrl-C just ends this process, without a traceback."""
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    except BaseException:
        signal.signal(signal.SIGINT, before)
        raise


def _check(options: UpOptions) -> UpOptions:
    """The options, with endpoints that are secure where all is. Raises ConfigError for what is wrong with the command line."""
    if options.secure:
        options = replace(
            options, listen=["tls/" + endpoint.removeprefix("tcp/").removeprefix("tls/") for endpoint in options.listen]
        )
    if options.report is not None and not options.report.parent.is_dir():
        raise ConfigError(options.report, "", "its folder does not exist")
    if options.report is not None and options.report.is_dir():
        raise ConfigError(options.report, "", "is a folder; the report is a file")
    for i, endpoint in enumerate(options.listen):
        try:
            free = port_is_free(endpoint)
        except ValueError as error:
            raise ConfigError("up", "--listen", str(error)) from error
        if not free:
            text = f"{endpoint} is in use; is another `milepost up` running? `--connect {endpoint}` joins its router"
            raise ConfigError("up", "--listen", text)
        if endpoint in options.listen[:i]:
            raise ConfigError("up", "--listen", f"{endpoint} is there twice")
    options.web.check()
    return options


def _load(options: UpOptions) -> tuple[list[Crew], Files | None]:
    """The processes of each train, in the order of their start, and the session files of a secure one, by name.

    Everything that they need is imported here, once. Raises ConfigError.
    """
    os.environ.update(ONE_THREAD)
    from milepost.config.fleet_file import load_fleet, load_together
    from milepost.runtime.process import ProcessOptions

    members = (
        load_together(options.train_files, options.external) if options.fleet_file is None else load_fleet(options.fleet_file)
    )
    files = None
    if options.secure:
        from milepost.security.bundle import certified

        files = certified(members[0].train, options.state_dir, options.listen)
    first_s = min(member.start_after_s for member in members)
    process = ProcessOptions(options.endpoints, options.speed, options.duration_s, os.getpid(), options.state_dir)
    crews = []
    for member in sorted(members, key=lambda member: member.start_after_s):
        # one train alone, as its file says, needs no name beside those of its processes
        shared = replace(process, change=json.dumps(member.change)) if len(members) > 1 or member.change else process
        crews.append(_crew(member, shared, files, options.record, (member.start_after_s - first_s) / options.speed))
    return crews, files


def _watch(
    supervisor: Supervisor, crews: Sequence[Crew], stop: StopSignals, tell: Callable[[str], None], measure: bool
) -> float:
    """Start each crew in its time, until asked to stop, or all trains' processes have ended by themselves.

    Returns the largest memory seen, in MiB.
    """
    later, crew = deque(crews), list[Child]()
    begun = time.monotonic()
    largest_mib, measure_at = 0.0, begun + MEASURE_MEMORY_EVERY_S
    while True:
        while later and time.monotonic() >= begun + later[0].start_after_s:
            if later[0].start_after_s:
                tell(f"starting {later[0].train}")
            started = [supervisor.start(job) for job in later.popleft().jobs]
            # a recorder records until the end, which it does not delay
            crew += [child for child in started if child.name != RECORDER]
        if stop.wait(LOOK_EVERY_S):
            break
        for sentence in supervisor.watch():
            tell(sentence)
        if not later and not any(child.running or child.again_at is not None for child in crew):
            break
        if measure and time.monotonic() >= measure_at:
            measure_at += MEASURE_MEMORY_EVERY_S
            pids = [child.pid for child in supervisor.children if child.running and child.name not in MEASURING]
            largest_mib = max(largest_mib, proportional_mib([os.getpid(), *pids]))
    return largest_mib
