"""The processes of a train as jobs: what each does in a fork, and the command that does the same."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from milepost.config.roles import ROLES, Process, Setting, processes
from milepost.config.train import Train
from milepost.sensors.base import World

from . import zenoh_config
from .launch import ASKED_TO_END, Job
from .process import ProcessOptions, run_process, run_router

# who notices that others are gone
TELLING = ("fuser", "voter")
MOST_NAMED = 4


def router_jobs(
    endpoints: Sequence[str], files: Callable[[str], Path] | None = None, run: Callable[..., None] = run_router
) -> Iterator[Job]:
    """A router on each endpoint, linked with those before it: `router`, `router-2`. `files`: the configuration of each."""
    parent = os.getpid()
    for i, endpoint in enumerate(endpoints):
        second = (f"router-{i + 1}",) if i else ()
        name, link = "".join(second) or "router", endpoints[:i]
        file = files(name) if files is not None else None
        options = ["--parent", str(parent)]
        if file is not None:
            options += ["--config", str(file)]
        else:
            options += ["--listen", endpoint, *(word for other in link for word in ("--link", other))]
        yield Job(name, ("run", "router", *second), tuple(options), partial(run, [endpoint], file, parent, link, name=name))


def checked_world(train: Train, duration_s: float | None, external: Sequence[str] = ()) -> World | None:
    """The train's world, after every process has been built with it once. Raises ConfigError for what a recording spoils.

    `external`: the units whose sensors are programs of somebody else's.
    """
    setting = Setting.of(train, "check", duration_s)
    for process in _own(processes(train), external):
        ROLES[process.role].build(train, process.unit, setting)
    return setting.world


def train_jobs(
    train: Train,
    world: World | None,
    shared: ProcessOptions,
    files: Callable[[str], Path] | None = None,
    external: Sequence[str] = (),
) -> Iterator[Job]:
    """All processes of a train besides the router, listeners before speakers. `world` is shared by the forks.

    `files`: the session configuration of each, where they do not all connect in the same way.
    """
    for process in _own(processes(train, live=True), external):
        role = ROLES[process.role]
        options = shared if files is None else replace(shared, connection=files(process.name))
        unit = () if process.unit == process.role else (process.unit,)
        yield Job(
            process.name,
            ("run", process.role, *unit),
            command_options(train, [process.role], options),
            partial(_exit_code, train, process.role, process.unit, options, world if role.uses_world else None),
            tells=process.role in TELLING,
            train="" if shared.change is None else train.name,
        )


def _exit_code(*process: Any) -> int:
    """Run a process; its exit code says whether it was asked to end or its work is done."""
    return ASKED_TO_END if run_process(*process) else 0


def in_short(trains: Sequence[str]) -> str:
    """What trains are called for people: `metro-1, metro-2`, or `metro-1 and 99 others`."""
    return ", ".join(trains) if len(trains) <= MOST_NAMED else f"{trains[0]} and {len(trains) - 1} others"


def _own(processes: Sequence[Process], external: Sequence[str]) -> list[Process]:
    return [process for process in processes if process.role != "sensor" or process.unit not in external]


def command_options(train: Train, roles: Collection[str], options: ProcessOptions) -> tuple[str, ...]:
    """The options of a command that runs a train's processes of these roles."""
    out = ["--train", str(train.path), *zenoh_config.as_options(options.connection)]
    if options.parent is not None:
        out += ["--parent", str(options.parent)]
    if "world" in roles:
        out += ["--speed", str(options.speed), *(word for name in options.awaits for word in ("--await", name))]
    if options.duration_s is not None and any(ROLES[role].uses_world for role in roles):
        out += ["--duration", str(options.duration_s)]
    if options.state_dir is not None and "filter" in roles:
        out += ["--state-dir", str(options.state_dir)]
    if options.change is not None:
        out += ["--change", options.change]
    return tuple(out)
