"""The command `milepost up` and its options; it imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from .options import DEFAULT_TRAIN, RecordOption, StateDirOption, TrainOption


def up(
    train: TrainOption = DEFAULT_TRAIN,
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
        list[str], typer.Option("--listen", help="Endpoint on which the router listens. Repeat it for a second router.")
    ] = [DEFAULT_ENDPOINT],  # noqa: B006
    state_dir: StateDirOption = None,
    feed: Annotated[
        int | None,
        typer.Option(
            "--feed", min=1, max=65535, help="Serve metrics, vehicle positions and GeoJSON on this port of this machine."
        ),
    ] = None,
    secure: Annotated[
        bool,
        typer.Option(
            "--secure",
            help="Only processes and tools with a certificate, each for its own keys. Made in the state folder if needed.",
        ),
    ] = False,
    record: RecordOption = None,
) -> None:
    """Start a train and show it: a router, and one process for each sensor, each filter, the fuser and the balise service."""
    from .up import UpOptions, run_up

    found = find_file(train, "trains")
    options = UpOptions(found, duration, speed, report, headless, listen, state_dir, secure, record, feed)
    raise typer.Exit(run_up(options))
