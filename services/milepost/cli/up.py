"""`milepost up`: a whole train on this machine.

What is imported here is light, so that something is shown at once. The rest is imported, and the train loaded, before the first
process is forked from this one.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from milepost.config.errors import ConfigError
from milepost.runtime.launch import ONE_THREAD, Job, is_router, share_what_is_loaded
from milepost.runtime.stop_signals import StopSignals
from milepost.runtime.supervisor import Supervisor

from .endpoint import port_is_free
from .proc import age_s, proportional_mib

if TYPE_CHECKING:
    from .display import Mode

LOOK_EVERY_S = 0.2
MEASURE_MEMORY_EVERY_S = 2.0
# the configuration file of a process's session, by its name
Files = Callable[[str], Path]
MEASURING = ("sentinel", "observer")
# what a run does not wait for
BESIDE = ("display", "feed", "recorder", *MEASURING)


@dataclass(frozen=True)
class UpOptions:
    """The command line of `milepost up`."""

    train_file: Path
    duration_s: float | None
    speed: float
    report: Path | None
    headless: bool
    listen: list[str]
    state_dir: Path | None
    secure: bool = False
    record: Path | None = None
    feed_port: int | None = None

    @property
    def mode(self) -> Mode:
        """How the train is shown."""
        if self.headless:
            return "start"
        return "table" if sys.stdout.isatty() else "lines"


def run_up(options: UpOptions) -> int:
    """Start everything, show it, end it. Raises ConfigError before anything starts."""
    began_ns = time.time_ns() - round(age_s() * 1e9)
    _say(f"reading {options.train_file}")
    with _nothing_to_end():
        options = _check(options)
        train, jobs, files, line = _load(options)
    _say(f"starting {len(jobs) + len(options.listen)} processes of {train}")
    if files is not None:
        _say(f"tools connect with --zenoh-config {files('dispatch')}")
    if options.feed_port is not None:
        _say(f"http://127.0.0.1:{options.feed_port} lists what machines can read")
    from .up_jobs import display_job, feed_jobs, measuring_jobs, router_jobs

    share_what_is_loaded()
    # the table and what processes write cannot share a terminal
    to_table = options.mode == "table" and sys.stderr.isatty()
    supervisor = Supervisor(keep_output=to_table)
    with StopSignals() as stop, _scratch(options.report) as scratch, _telling(to_table) as (tell, heard):
        names = [job.name for job in jobs]
        display, observer, feed = (options.listen if files is None else files(name) for name in ("display", "observer", "feed"))
        shown = display_job(options.mode, display, train, names, began_ns, heard)
        try:
            for router in router_jobs(options.listen, files):
                supervisor.start(router)
            supervisor.start(shown, shown=True)
            beside = (
                *measuring_jobs(observer, options.report, scratch / "stalls.jsonl"),
                *feed_jobs(feed, options.feed_port, line),
            )
            for job in (*beside, *jobs):
                supervisor.start(job)
            memory_mib = _watch(supervisor, stop, tell, options.report is not None)
        finally:
            for sentence in supervisor.stop():
                _say(sentence)
    for name, lines in supervisor.failures().items():
        _say("\n".join([f"{name} failed; its last lines:", *lines]))
    return 0 if options.report is None or _completed(options.report, began_ns, memory_mib) else 1


def _say(sentence: str) -> None:
    print(f"milepost: {sentence}", file=sys.stderr, flush=True)


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
            raise ConfigError("up", "--listen", f"{endpoint} is in use; is another `milepost up` running?")
        if endpoint in options.listen[:i]:
            raise ConfigError("up", "--listen", f"{endpoint} is there twice")
    if options.feed_port is not None:
        from .machines.feed import HERE, check_feed

        check_feed(HERE, options.feed_port, "up", "--feed")
    return options


def _load(options: UpOptions) -> tuple[str, list[Job], Files | None, Path]:
    """The train's name, its processes, the session files of a secure one, by name, and the file of its line.

    Everything that they need is imported here, once. Raises ConfigError.
    """
    os.environ.update(ONE_THREAD)
    from milepost.config.train import load_train
    from milepost.runtime.process import ProcessOptions
    from milepost.runtime.train_jobs import checked_world, train_jobs

    from .recording.job import recorder_jobs

    train = load_train(options.train_file)
    files = None
    if options.secure:
        from milepost.security.bundle import certified

        files = certified(train, options.state_dir, options.listen)
    # it comes first, and scenario time waits for it: what is sent at the beginning is recorded too
    recorder = list(recorder_jobs(train, options.record, options.listen, files))
    awaits = tuple(job.name for job in recorder)
    process = ProcessOptions(options.listen, options.speed, options.duration_s, os.getpid(), options.state_dir, awaits)
    jobs = [*recorder, *train_jobs(train, checked_world(train, options.duration_s), process, files)]
    return train.name, jobs, files, train.file.line


@contextlib.contextmanager
def _scratch(report: Path | None) -> Iterator[Path]:
    """A folder for what only a report needs."""
    if report is None:
        yield Path()
        return
    report.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="milepost-") as folder:
        yield Path(folder)


@contextlib.contextmanager
def _telling(to_table: bool) -> Iterator[tuple[Callable[[str], None], int | None]]:
    """A function that shows a sentence; where the table does it, also the end of the pipe where it hears them."""
    if not to_table:
        yield _say, None
        return
    heard, tells = os.pipe()
    os.set_blocking(tells, False)

    def tell(sentence: str) -> None:
        with contextlib.suppress(BlockingIOError):  # the table hangs; nothing here may
            os.write(tells, f"{sentence}\n".encode())

    try:
        yield tell, heard
    finally:
        os.close(heard)
        os.close(tells)


def _watch(supervisor: Supervisor, stop: StopSignals, tell: Callable[[str], None], measure: bool) -> float:
    """Until asked to stop, or the train's processes have ended by themselves. Returns the largest memory seen, in MiB."""
    train = [child for child in supervisor.children if not is_router(child.name) and child.name not in BESIDE]
    largest_mib, measure_at = 0.0, time.monotonic() + MEASURE_MEMORY_EVERY_S
    while not stop.wait(LOOK_EVERY_S):
        for sentence in supervisor.watch():
            tell(sentence)
        if not any(child.running or child.again_at is not None for child in train):
            break
        if measure and time.monotonic() >= measure_at:
            measure_at += MEASURE_MEMORY_EVERY_S
            pids = [child.pid for child in supervisor.children if child.running and child.name not in MEASURING]
            largest_mib = max(largest_mib, proportional_mib([os.getpid(), *pids]))
    return largest_mib


def _completed(report: Path, began_ns: int, memory_mib: float) -> bool:
    """Add to the observer's report what only this process knows; False if there is none."""
    if not report.is_file():
        return False
    found = json.loads(report.read_text(encoding="utf-8"))
    first_ns = found.get("first_at_ns")
    found["first_state_s"] = None if first_ns is None else (first_ns - began_ns) * 1e-9
    found["memory_pss_mib"] = memory_mib or None
    report.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return True
