"""`milepost import` and its options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption


def import_log(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="CSV files of one run on one clock: the receiver's, and perhaps others of wheels or inertial unit.",
        ),
    ],
    line: Annotated[
        Path | None, typer.Option("--line", help="Line file with geometry. Without it a line is made from the track itself.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files. Default: one here, named after the first log.")
    ] = None,
    column: Annotated[
        list[str],
        typer.Option("--column", help="FIELD=COLUMN: which column a field is; FIELD= for none. Repeat `wheel` for several."),
    ] = [],  # noqa: B006
    unit: Annotated[list[str], typer.Option("--unit", help="FIELD=UNIT: the unit of a field, such as speed=km/h.")] = [],  # noqa: B006
    force: Annotated[bool, typer.Option("--force", help="Overwrite files of an earlier import.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a train of your own log: line, train and scenario files, to be replayed offline or live."""
    from .job import run_import

    raise typer.Exit(run_import(logs, line, out, column, unit, force, as_json))
