"""`milepost up`: whole trains on this machine.

What is imported here is light, so that something is shown at once. The rest is imported, and the trains loaded, before the
first process is forked from this one.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from milepost.config.errors import ConfigError
from milepost.runtime.launch import share_what_is_loaded
from milepost.runtime.logs.records import say, set_up_log
from milepost.runtime.stop_signals import StopSignals
from milepost.runtime.supervisor import Child, Supervisor

from .crews.crew import Crew, load_crews
from .crews.options import UpOptions
from .endpoint import port_is_free
from .joining import may_join
from .proc import age_s, proportional_mib
from .run import RECORDER
from .up_output import completed, scratch, telling

if TYPE_CHECKING:
    from milepost.runtime.zenoh_config import Connection

LOOK_EVERY_S = 0.2
MEASURE_MEMORY_EVERY_S = 2.0
MEASURING = ("sentinel", "observer")


def run_up(options: UpOptions) -> int:
    """Start everything, show it, end it. Raises ConfigError before anything starts."""
    began_ns = time.time_ns() - round(age_s() * 1e9)
    set_up_log("up")
    say(f"reading {', '.join(map(str, [*options.train_files, *([options.fleet_file] if options.fleet_file else [])]))}")
    with _nothing_to_end():
        options = _check(options)
        crews, files = load_crews(options)
        trains = [train for crew in crews for train in crew.trains]
        if options.connect and (code := may_join(options.connect, trains)):
            return code
    from milepost.runtime.train_jobs import in_short

    jobs = [job for crew in crews for job in crew.jobs]
    say(f"starting {len(jobs) + len(options.listen)} processes of {in_short(trains)}")
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
                *options.web.jobs(connection, [line for crew in crews for line in crew.lines]),
            ):
                supervisor.start(job)
            memory_mib = _watch(supervisor, crews, stop, tell, options.report is not None)
        finally:
            for sentence in supervisor.stop():
                say(sentence)
    for name, lines in supervisor.failures().items():
        say("\n".join([f"{name} failed; its last lines:", *lines]))
    return 0 if options.report is None or completed(options.report, began_ns, memory_mib) else 1


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
                tell(f"starting {later[0].called}")
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
