"""The options of `milepost inject`."""

from __future__ import annotations

from typing import Annotated

import typer

from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from .options import ConnectOption, JsonOption, ZenohConfigOption

# what a fault's own options need: they are known only once its kind is
FREE_OPTIONS = {"allow_extra_args": True, "ignore_unknown_options": True}
UnitArgument = Annotated[str, typer.Argument(help="The unit whose sensor shall lie.")]
FaultArgument = Annotated[
    str, typer.Argument(metavar="[FAULT [--OPTION VALUE]...]", help="The kind of fault and its options; see --list.")
]
ForOption = Annotated[
    float | None,
    typer.Option("--for", min=0.001, help="End after so many seconds of scenario time. Default: with the process."),
]
TrainNameOption = Annotated[str, typer.Option("--train", help="The train's name. Not needed where only one train is running.")]
ClearOption = Annotated[bool, typer.Option("--clear", help="End the unit's injected faults.")]
ListOption = Annotated[bool, typer.Option("--list", help="Show the kinds of faults, their options, and what they fit.")]


def inject(
    context: typer.Context,
    unit: UnitArgument = "",
    fault: FaultArgument = "",
    for_s: ForOption = None,
    train: TrainNameOption = "",
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
    clear: ClearOption = False,
    show: ListOption = False,
    as_json: JsonOption = False,
) -> None:
    """Make a sensor of a running train lie, where its train file says `chaos: true`: `inject radar bias --size 1 --for 10`."""
    from .inject import Wanted, run_inject, run_list

    wanted = Wanted(unit, fault, context.args, for_s, clear, train)
    raise typer.Exit(run_list(wanted, as_json) if show else run_inject(wanted, zenoh_config or connect, as_json))
