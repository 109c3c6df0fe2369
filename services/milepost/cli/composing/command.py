"""The command `milepost compose` and its options; it imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.cli.options import DEFAULT_TRAIN, TrainOption, complete_train
from milepost.config.shipped_files import find_file
from milepost.runtime.logs.records import say


def compose(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="TRAIN", autocompletion=complete_train, help="The same as --train, in short."),
    ] = None,
    train: TrainOption = DEFAULT_TRAIN,
    record: Annotated[bool, typer.Option("--record", help="With a recorder.")] = False,
    feed: Annotated[
        bool, typer.Option("--feed", help="With the feed: metrics, vehicle positions and GeoJSON on port 9470 of this machine.")
    ] = False,
    page: Annotated[bool, typer.Option("--page", help="With the dispatch page, on port 9480 of this machine.")] = False,
    secure: Annotated[
        bool,
        typer.Option("--secure", help="Instead, the file to be laid over it, by which each container has its certificate."),
    ] = False,
) -> None:
    """Print the compose file of a train, a container a process, for the folder in which the command is given."""
    from .compose import Beside
    from .compose import compose as composed

    given = file or train
    text, unreadable = composed(find_file(given, "trains"), str(given), Beside(record, feed, page), secure)
    for path in unreadable:
        say(f"{path}: user 10001, as whom containers run, cannot read it")
    typer.echo(text, nl=False)
