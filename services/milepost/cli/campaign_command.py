"""The command `milepost campaign` and its options; it imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file

from .options import JsonOption, complete_campaign


def campaign(
    file: Annotated[
        Path,
        typer.Argument(
            autocompletion=complete_campaign,
            help="Campaign file, or the name of one: looked up in ./deploy/campaigns, then among those shipped with Milepost.",
        ),
    ],
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="Run each cell on this many consecutive seeds. Default: the file's.")
    ] = None,
    jobs: Annotated[int | None, typer.Option("--jobs", min=1, help="Use this many processes. Default: one per core.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="First seed, instead of the file's.")] = None,
    as_json: JsonOption = False,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            help="Write index.html, maps.md and results.json to this folder; keep finished runs there to go on from.",
        ),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", help="Keep finished runs in this JSON Lines file, and take from it those that it has."),
    ] = None,
    dask: Annotated[
        str | None, typer.Option("--dask", help="Run on the workers of the Dask scheduler at this address: tcp://HOST:PORT.")
    ] = None,
) -> None:
    """Inject every fault into every unit, offline on many seeds, and measure what the published interval and exclusion do.

    Exit code 1 if in any run the truth left the position or speed interval after the onset, or a node crashed; else 0.
    """
    from .campaign import run_campaign_command

    found = find_file(file, "campaigns")
    raise typer.Exit(run_campaign_command(found, runs, jobs, seed, as_json, report, resume, dask))
