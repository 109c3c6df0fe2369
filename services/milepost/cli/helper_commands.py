"""Commands that `milepost up` starts where it cannot fork; nobody else needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from .options import ConnectOption, ZenohConfigOption


def display(
    name: Annotated[list[str], typer.Option("--name")],
    expect: Annotated[list[str], typer.Option("--expect")],
    mode: Annotated[str, typer.Option("--mode")],
    began_ns: Annotated[int, typer.Option("--began-ns")],
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Show trains for `up`."""
    from .showing.display import run_display

    run_display(zenoh_config or connect, name, expect, mode, began_ns)  # type: ignore[arg-type]


def observe(
    report: Annotated[Path, typer.Option("--report")],
    stalls: Annotated[Path, typer.Option("--stalls")],
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
    name: Annotated[list[str], typer.Option("--name")] = [],  # noqa: B006
) -> None:
    """Listen from outside until stopped, then write a report."""
    from milepost.checks.observer import run_observe

    run_observe(zenoh_config or connect, name, report, stalls)


def vacant(
    name: Annotated[list[str], typer.Option("--name")],
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
) -> None:
    """Exit code 2 where a train of one of these names is running."""
    from .joining import check_vacant

    check_vacant(connect, name)


def sentinel(stalls: Annotated[Path, typer.Option("--stalls")]) -> None:
    """Record when a processor of the machine stands still: sleep a millisecond at a time on each and note longer gaps."""
    from milepost.checks.stalls import run_sentinel

    run_sentinel(stalls)
