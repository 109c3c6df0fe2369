"""`milepost`: the commands and their options. Each command imports its own code when it is called."""

from __future__ import annotations

import logging
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file
from milepost.runtime.launch import exit_code
from milepost.runtime.logs.records import say
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from .campaign_command import campaign
from .chaos_command import chaos
from .composing.command import compose
from .helper_commands import display, observe, sentinel, vacant
from .importing.command import import_log
from .inject_command import FREE_OPTIONS, inject
from .machines.etcs_command import etcs
from .machines.feed_command import feed
from .machines.page_command import page
from .options import (
    ConnectOption,
    JsonOption,
    ZenohConfigOption,
    complete_scenario,
    show_versions,
)
from .pki_command import acl, pki
from .recording.commands import export, info, replay, rerun
from .run_command import run
from .up_command import up
from .usage import UsageError, usage_line

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Tells a train where it is and how fast it is going, with bounds on both errors.",
)


@app.callback()
def milepost(
    version: Annotated[  # noqa: ARG001
        bool, typer.Option("--version", callback=show_versions, is_eager=True, help="Show the versions and exit.")
    ] = False,
) -> None:
    """Tells a train where it is and how fast it is going, with bounds on both errors."""
    # the command line has been read, and from here on KeyboardInterrupt is caught
    signal.signal(signal.SIGINT, signal.default_int_handler)


app.command()(up)
app.command()(feed)
app.command()(page)
app.command()(etcs)
app.command()(compose)


@app.command()
def watch(
    train: Annotated[str, typer.Option("--train", help="Show the train of this name alone, with its sensors.")] = "",
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Show a live table of the trains on a router: of one with its sensors; for simulated trains with the true error."""
    from .showing.watch import run_watch

    raise typer.Exit(run_watch(zenoh_config or connect, train or "*"))


@app.command()
def status(
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
    as_json: JsonOption = False,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds to wait for a state.")] = 2.0,
) -> None:
    """Print each train's state once. Exit code 1 if one is silent or not `normal`, or a process has a second instance."""
    from .status import run_status

    raise typer.Exit(run_status(zenoh_config or connect, as_json, timeout))


app.command(context_settings=FREE_OPTIONS)(inject)


app.command()(run)
app.command(name="import")(import_log)


@app.command()
def evaluate(
    scenario: Annotated[
        Path | None,
        typer.Argument(
            autocompletion=complete_scenario,
            help="Scenario file, or the name of one: looked up in ./deploy/scenarios, then among those shipped with Milepost. "
            "With --all, a folder of scenario files.",
        ),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Evaluate every scenario of the folder, beside the sources' claims.")
    ] = False,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Use this seed instead of the scenario's.")] = None,
    runs: Annotated[
        int | None,
        typer.Option(
            "--runs", min=1, help="Run on this many consecutive seeds; show median and worst. Default 1, with --all 20."
        ),
    ] = None,
    jobs: Annotated[int | None, typer.Option("--jobs", min=1, help="Use this many processes. Default: one per core.")] = None,
    as_json: JsonOption = False,
    plot: Annotated[Path | None, typer.Option("--plot", help="Draw errors and intervals to this PNG file.")] = None,
    record: Annotated[Path | None, typer.Option("--record", help="Write every message to this JSON Lines file.")] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="Write index.html, results.json and pictures to this folder.")
    ] = None,
    only: Annotated[list[str], typer.Option("--only", help="With --all: evaluate only the scenarios of these names.")] = [],  # noqa: B006
) -> None:
    """Run a scenario offline on the same nodes and compare the estimators with the truth."""
    from .evaluate import run_evaluate, run_evaluate_all

    if everything:
        if seed is not None or plot is not None or record is not None:
            raise typer.BadParameter("--seed, --plot and --record need a single scenario", param_hint="--all")
        raise typer.Exit(run_evaluate_all(scenario, runs, jobs, as_json, report, only))
    if scenario is None or only:
        raise typer.BadParameter("name one scenario, or use --all", param_hint="SCENARIO")
    raise typer.Exit(run_evaluate(find_file(scenario, "scenarios"), seed, runs, jobs, as_json, plot, record, report))


app.command()(campaign)
app.command()(acl)
app.add_typer(pki, name="pki")
app.command()(chaos)
for recording in (rerun, info, export, replay):
    app.command()(recording)


@app.command()
def events(
    as_json: JsonOption = False,
    as_rules: Annotated[bool, typer.Option("--prometheus", help="Print alert rules for Prometheus.")] = False,
) -> None:
    """Show every event that processes send: its code, how bad it is, and what it means; with --json also what to do."""
    from .machines.events import run_events

    run_events(as_json, as_rules)


@app.command()
def schema(
    out: Annotated[Path, typer.Option("--out", help="Folder to write to: that of the repository.")] = Path(),
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit code 1 if a file differs.")] = False,
) -> None:
    """Write what is made from tables: JSON Schemas of messages and configuration files, AsyncAPI, the references."""
    from .schema import run_schema

    raise typer.Exit(run_schema(out, check))


for helper in (display, observe, sentinel, vacant):
    app.command(hidden=True)(helper)


def main() -> None:
    """Read the command line and do what it says. A mistake on it or in a configuration is one line and exit code 2."""
    sys.exit(exit_code(_run))


def _run() -> None:
    try:
        code = app(prog_name="milepost", standalone_mode=False)
    except UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # `milepost` alone
            error.show()
        else:
            say(usage_line(error), logging.ERROR)
        sys.exit(error.exit_code)
    sys.exit(code)
