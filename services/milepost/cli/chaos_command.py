"""The command `milepost chaos` and its options; it imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file

from .options import JsonOption, TrainOption


def chaos(
    train: TrainOption = Path("full"),
    only: Annotated[
        list[str], typer.Option("--only", help="Run only cells whose name matches this pattern, such as 'fuser*killed'.")
    ] = [],  # noqa: B006
    show: Annotated[bool, typer.Option("--list", help="Show the names of the cells and run none.")] = False,
    as_json: JsonOption = False,
    report: Annotated[
        Path | None, typer.Option("--report", help="Write results.json, matrix.txt and .md to this folder.")
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(
            "--soak", min=0.1, help="Instead of the cells: one train for so many minutes, broken at random every 5 s."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="What the soak draws from.")] = 1,
) -> None:
    """Kill, stop and replace each process of a running train, make sensors lie meanwhile, and measure what outsiders see.

    Exit code 1 if a cell exceeded its limit, the truth left an interval, or a process raised an exception; else 0.
    """
    from .chaos import run_chaos, run_soak

    if minutes is not None:
        raise typer.Exit(run_soak(find_file(train, "trains"), minutes, seed, only, as_json, report))
    raise typer.Exit(run_chaos(find_file(train, "trains"), only, as_json, report, show))
