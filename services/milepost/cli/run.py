"""`milepost run`: one process."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from milepost.config.errors import ConfigError
from milepost.runtime.launch import end_with_parent
from milepost.runtime.logs.records import set_up_log
from milepost.runtime.zenoh_config import Connection

if TYPE_CHECKING:
    from milepost.config.train import Train
    from milepost.runtime.process import ProcessOptions

RECORDER, TOGETHER = "recorder", "together"


@dataclass(frozen=True)
class RunOptions:
    """The command line of `milepost run`.

    `change`: of one of several trains, what is different from its file, as JSON. `rotation`: size in MiB, time in minutes, and
    the least room on the disk in MiB.
    """

    role: str
    unit: str
    train_file: Path
    connection: Connection
    listen: list[str]
    link: list[str]
    config: Path | None
    speed: float
    duration: float | None
    parent: int | None
    state_dir: Path | None
    change: str | None
    awaits: tuple[str, ...]
    record: Path | None
    rotation: tuple[float, float, float]
    external: tuple[str, ...] = ()

    def train(self) -> Train:
        """The train, with what is different from its file. Raises ConfigError."""
        from milepost.config.train import load_train

        return load_train(self.train_file, None if self.change is None else json.loads(self.change))


def run_role(options: RunOptions) -> None:
    """Run the router, the recorder, one process of a train or all of them in one. Raises ConfigError."""
    if options.parent is not None:
        end_with_parent(options.parent)
    if options.role == "router":
        _run_router(options)
    elif options.role == RECORDER:
        _run_recorder(options)
    elif options.role == TOGETHER:
        _run_together(options)
    else:
        _run_process(options)


def _run_router(options: RunOptions) -> None:
    if options.config is not None and options.link:
        raise ConfigError("run", "--link", f"not with --config: {options.config} says itself, in `connect`, with whom it links")
    from milepost.security.router import run_named_router

    name = options.unit or "router"
    set_up_log(name)
    run_named_router(options.listen, options.config, options.parent, options.link, name)


def _run_recorder(options: RunOptions) -> None:
    from milepost.recorder.library import need_mcap

    set_up_log(RECORDER)
    if options.record is None:
        raise ConfigError("run recorder", "--record", "required: the folder for the recording")
    need_mcap("run recorder")
    from milepost.recorder.limits import Limits
    from milepost.runtime.recording.process import RecorderOptions, run_recorder

    limits = Limits.of(*options.rotation)
    recorder = RecorderOptions(options.record, options.connection, limits, options.parent, options.change is not None)
    run_recorder(options.train(), recorder)


def _run_together(options: RunOptions) -> None:
    from milepost.config.fleet_file import check_external
    from milepost.runtime.together.aboard import Boarding
    from milepost.runtime.together.process import run_together
    from milepost.runtime.train_jobs import checked_world

    set_up_log(TOGETHER)
    train = options.train()
    check_external(train, options.external, "run together", "--external")
    world = checked_world(train, options.duration, options.external)
    run_together([Boarding(train, world, options.duration, options.external, options.awaits)], _process_options(options))


def _run_process(options: RunOptions) -> None:
    from milepost.config.mistakes import one_of
    from milepost.config.roles import ROLES, process_name
    from milepost.runtime.process import run_process

    role, unit = options.role, options.unit
    set_up_log(process_name(role, unit or role) if role in ROLES else "run")
    if role not in ROLES:
        raise ConfigError("run", "ROLE", one_of(["router", RECORDER, TOGETHER, *ROLES], role))
    train = options.train()
    units = ROLES[role].instances(train)
    if not ROLES[role].per_unit:
        unit = unit or role
    if unit not in units:
        raise ConfigError("run", "UNIT", one_of(units, unit) if units else f"{options.train_file} has none with a {role}")
    run_process(train, role, unit, _process_options(options))


def _process_options(options: RunOptions) -> ProcessOptions:
    from milepost.runtime.process import ProcessOptions

    return ProcessOptions(
        connection=options.connection,
        speed=options.speed,
        duration_s=options.duration,
        parent=options.parent,
        state_dir=options.state_dir,
        awaits=options.awaits,
        change=options.change,
    )
