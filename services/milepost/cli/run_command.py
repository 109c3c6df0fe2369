"""The command `milepost run` and its options; it imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file
from milepost.runtime.logs.records import LogFormat, LogLevel, choose
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from .options import (
    DEFAULT_TRAIN,
    ConnectOption,
    LogFormatOption,
    LogLevelOption,
    RecordOption,
    StateDirOption,
    TrainOption,
    ZenohConfigOption,
    links,
)


def run(
    role: Annotated[
        str,
        typer.Argument(help="One of router, world, sensor, filter, balise, fuser, voter, etcs, recorder, together."),
    ],
    unit: Annotated[str, typer.Argument(help="The unit, for a sensor or a filter; `router-2` for a second router.")] = "",
    train: TrainOption = DEFAULT_TRAIN,
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
    listen: Annotated[list[str], typer.Option("--listen", help="Router only: endpoints to listen on.")] = [DEFAULT_ENDPOINT],  # noqa: B006
    link: Annotated[
        list[str], typer.Option("--link", callback=links, help="Router only: endpoint of another router to link with.")
    ] = [],  # noqa: B006
    config: Annotated[Path | None, typer.Option("--config", help="Router only: Zenoh configuration file to use.")] = None,
    speed: Annotated[
        float, typer.Option("--speed", min=0.01, max=1000.0, help="World only: scenario seconds per second of real time.")
    ] = 1.0,
    duration: Annotated[
        float | None, typer.Option("--duration", min=0.1, help="Stop after this many seconds of scenario time.")
    ] = None,
    parent: Annotated[int | None, typer.Option("--parent", hidden=True)] = None,
    state_dir: StateDirOption = None,
    change: Annotated[str | None, typer.Option("--change", hidden=True)] = None,
    awaits: Annotated[list[str], typer.Option("--await", hidden=True)] = [],  # noqa: B006
    external: Annotated[
        list[str], typer.Option("--external", help="Together only: unit whose sensor is a program of your own. Repeatable.")
    ] = [],  # noqa: B006
    record: RecordOption = None,
    rotate_mib: Annotated[
        float, typer.Option("--rotate-mib", min=1.0, help="Recorder only: begin a new file at this size.")
    ] = 256.0,
    rotate_min: Annotated[
        float, typer.Option("--rotate-min", min=0.1, help="Recorder only: begin a new file after so many minutes.")
    ] = 60.0,
    least_free_mib: Annotated[
        float,
        typer.Option(
            "--least-free-mib", min=0.0, help="Recorder only: stop where the disk has less room, go on where it has more."
        ),
    ] = 1024.0,
    log_level: LogLevelOption = LogLevel.info,
    log_format: LogFormatOption = LogFormat.text,
) -> None:
    """Run one process of a train, as compose.yaml does, or (`together`) all of them in one."""
    from .run import RunOptions, run_role

    choose(log_level, log_format)
    rotation = (rotate_mib, rotate_min, least_free_mib)
    options = RunOptions(
        role,
        unit,
        find_file(train, "trains"),
        zenoh_config or connect,
        listen,
        link,
        config,
        speed,
        duration,
        parent,
        state_dir,
        change,
        tuple(awaits),
        record,
        rotation,
        tuple(external),
    )
    run_role(options)
