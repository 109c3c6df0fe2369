"""The commands for recordings and their options; each imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from ..options import DEFAULT_TRAIN, ConnectOption, JsonOption, TrainOption, ZenohConfigOption, complete_scenario

RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING", help="MCAP file, or a folder of them.")]

SinceOption = Annotated[
    str | None,
    typer.Option(
        "--since", metavar="TIME", help="Begin there: UTC as in 2026-11-28T12:15:00, or seconds after the first message."
    ),
]
UntilOption = Annotated[str | None, typer.Option("--until", metavar="TIME", help="End before it, said in the same way.")]


def rerun(
    readings: Annotated[
        Path,
        typer.Argument(
            help="Recorded messages: an MCAP file, a folder of them, or one JSON object per line, in order of arrival."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="File for the settled states, one per line.")],
    train: TrainOption = DEFAULT_TRAIN,
    scenario: Annotated[
        Path | None,
        typer.Option(
            "--scenario", autocompletion=complete_scenario, help="Scenario that was recorded: its train, with its changes."
        ),
    ] = None,
    origin: Annotated[
        str, typer.Option("--from", help="`readings` runs filters, balise service and fuser; `estimates` the fuser alone.")
    ] = "readings",
) -> None:
    """Run recorded messages through the same nodes, faster than real time."""
    from .rerun import run_rerun

    found = None if scenario is None else find_file(scenario, "scenarios")
    raise typer.Exit(run_rerun(readings, find_file(train, "trains"), found, out, origin))


def info(recording: RecordingArgument, as_json: JsonOption = False) -> None:
    """Say what is in a recording: trains, span, streams, and what is missing in them."""
    from .describe import run_info

    raise typer.Exit(run_info(recording, as_json))


def export(
    recording: RecordingArgument,
    csv: Annotated[Path | None, typer.Option("--csv", help="Folder for CSV files, one for each stream.")] = None,
    parquet: Annotated[
        Path | None, typer.Option("--parquet", help="Folder for Parquet files, one for each stream. Needs the extra `parquet`.")
    ] = None,
    foxglove: Annotated[
        Path | None, typer.Option("--foxglove", help="MCAP file with JSON messages, and the place on a map, for Foxglove.")
    ] = None,
    since: SinceOption = None,
    until: UntilOption = None,
) -> None:
    """Write a recording in other formats."""
    from .describe import run_export

    raise typer.Exit(run_export(recording, csv, parquet, foxglove, since, until))


def replay(
    recording: RecordingArgument,
    speed: Annotated[
        float, typer.Option("--speed", min=0.01, max=1000.0, help="Recorded seconds per second of real time.")
    ] = 1.0,
    since: SinceOption = None,
    until: UntilOption = None,
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Send a recording again on its keys, byte for byte, at its pace; refused where its train is running."""
    from .replay import run_replay

    raise typer.Exit(run_replay(recording, speed, zenoh_config or connect, since, until))
