"""The command `milepost up` and its options; it imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.config.errors import ConfigError
from milepost.config.shipped_files import find_file
from milepost.runtime.logs.records import LogFormat, LogLevel, choose
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from .options import (
    DEFAULT_TRAIN,
    LogFormatOption,
    LogLevelOption,
    RecordOption,
    StateDirOption,
    complete_fleet,
    complete_train,
    endpoints,
)


def up(
    train: Annotated[
        list[Path],
        typer.Option(
            "--train",
            autocompletion=complete_train,
            help="Train file, or the name of one: looked up in ./deploy/trains, then among those shipped with Milepost. "
            f"Repeat it for several trains on one router. Default: {DEFAULT_TRAIN}.",
        ),
    ] = [],  # noqa: B006
    fleet: Annotated[
        Path | None,
        typer.Option(
            "--fleet",
            autocompletion=complete_fleet,
            help="Fleet file instead of trains, or the name of one: looked up in ./deploy/fleets, then among the shipped ones.",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option("--duration", min=0.1, help="Stop after this many seconds of scenario time.")
    ] = None,
    speed: Annotated[
        float, typer.Option("--speed", min=0.01, max=1000.0, help="Scenario seconds per second of real time.")
    ] = 1.0,
    report: Annotated[
        Path | None, typer.Option("--report", help="When the run ends, write what was measured to this JSON file.")
    ] = None,
    headless: Annotated[bool, typer.Option("--headless", help="Show no live table.")] = False,
    listen: Annotated[
        list[str],
        typer.Option(
            "--listen",
            help=f"Endpoint on which the router listens. Repeat it for a second router. Default: {DEFAULT_ENDPOINT}.",
        ),
    ] = [],  # noqa: B006
    connect: Annotated[
        list[str],
        typer.Option(
            "--connect",
            callback=endpoints,
            help="Start no router: join the one at this endpoint. Repeat the option to name others for failover.",
        ),
    ] = [],  # noqa: B006
    external: Annotated[
        list[str],
        typer.Option("--external", help="Unit whose sensor is a program of your own, which is not started here. Repeatable."),
    ] = [],  # noqa: B006
    state_dir: StateDirOption = None,
    feed: Annotated[
        int | None,
        typer.Option(
            "--feed", min=1, max=65535, help="Serve metrics, vehicle positions and GeoJSON on this port of this machine."
        ),
    ] = None,
    page: Annotated[
        int | None,
        typer.Option("--page", min=1, max=65535, help="Serve the dispatch page on this port of this machine."),
    ] = None,
    secure: Annotated[
        bool,
        typer.Option(
            "--secure",
            help="Only processes and tools with a certificate, each for its own keys. Made in the state folder if needed.",
        ),
    ] = False,
    record: RecordOption = None,
    together: Annotated[
        bool,
        typer.Option(
            "--together",
            help="Run whole trains in one process on one session, several in a process for each core: for small computers "
            "and fleets.",
        ),
    ] = False,
    log_level: LogLevelOption = LogLevel.info,
    log_format: LogFormatOption = LogFormat.text,
) -> None:
    """Start trains and show them: a router, and one process for each sensor, each filter, the fuser and the balise service."""
    from .crews.options import UpOptions
    from .machines.web_servers import WebPorts
    from .up import run_up

    choose(log_level, log_format)
    if fleet is not None and train:
        raise ConfigError("up", "--fleet", "names its trains itself; leave out --train")
    if external and (fleet is not None or len(train) > 1):
        raise ConfigError("up", "--external", "is for one train; a fleet file has `external` for each")
    if connect and listen:
        raise ConfigError("up", "--connect", "joins a router that runs; leave out --listen")
    if secure and (connect or fleet is not None or len(train) > 1):
        raise ConfigError("up", "--secure", "is for one train with a router of its own: others would need its authority")
    if together and secure:
        raise ConfigError("up", "--together", "is one session for a whole train; with --secure each process has its own")
    trains = [find_file(each, "trains") for each in train or ([] if fleet is not None else [DEFAULT_TRAIN])]
    options = UpOptions(
        train_files=trains,
        fleet_file=None if fleet is None else find_file(fleet, "fleets"),
        duration_s=duration,
        speed=speed,
        report=report,
        headless=headless,
        listen=listen or ([] if connect else [DEFAULT_ENDPOINT]),
        connect=connect,
        state_dir=state_dir,
        secure=secure,
        external=external,
        record=record,
        web=WebPorts(feed, page),
        together=together,
    )
    raise typer.Exit(run_up(options))
