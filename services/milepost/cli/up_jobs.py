"""The processes of `milepost up` besides the train's own: the router, the display, and what measures for a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from milepost.runtime import train_jobs
from milepost.runtime.launch import Job
from milepost.runtime.zenoh_config import Connection, as_options

from .showing.display import Mode, run_display


def router_jobs(endpoints: Sequence[str], files: Callable[[str], Path] | None) -> Iterator[Job]:
    """The routers; where they have files, they also say whom they refuse."""
    if files is None:
        yield from train_jobs.router_jobs(endpoints)
        return
    from milepost.security.router import run_named_router

    yield from train_jobs.router_jobs(endpoints, files, run_named_router)


def display_job(
    mode: Mode, connection: Connection, trains: Sequence[str], expected: Sequence[str], began_ns: int, heard: int | None
) -> Job:
    """What shows the trains; `heard`: where it hears sentences to be shown."""
    options = ["--mode", mode, "--began-ns", str(began_ns), *as_options(connection), *_each("--name", trains)]
    options += _each("--expect", expected)
    body = partial(run_display, connection, trains, expected, mode, began_ns)
    return Job("display", ("display",), tuple(options), body, stdin=heard, tells=True)


def _each(option: str, values: Sequence[str]) -> list[str]:
    return [word for value in values for word in (option, value)]


def measuring_jobs(connection: Connection, trains: Sequence[str], report: Path | None, stalls: Path) -> Iterator[Job]:
    """The outside observer of the trains, and the sentinel that notes when the machine stalls."""
    if report is None:
        return
    from milepost.checks.observer import run_observe
    from milepost.checks.stalls import run_sentinel

    place = ("--stalls", str(stalls))
    yield Job("sentinel", ("sentinel",), place, partial(run_sentinel, stalls), restart=False)
    options = (*place, "--report", str(report), *as_options(connection), *_each("--name", trains))
    yield Job("observer", ("observe",), options, partial(run_observe, connection, trains, report, stalls), restart=False)
