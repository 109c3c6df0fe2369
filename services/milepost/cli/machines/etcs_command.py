"""The command `milepost etcs` and its options; it imports its own code when it is called."""

from __future__ import annotations

from typing import Annotated

import typer

from milepost.cli.options import ConnectOption, JsonOption, ZenohConfigOption
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT


def etcs(
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
    as_json: JsonOption = False,
    count: Annotated[int | None, typer.Option("--count", min=1, help="End after so many reports.")] = None,
) -> None:
    """Print the position reports of ERTMS/ETCS that trains on a router send, one a line; with --json as JSON objects."""
    from .etcs import run_etcs

    raise typer.Exit(run_etcs(zenoh_config or connect, as_json, count))
