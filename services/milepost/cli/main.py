"""`milepost`: the commands and their options. Each command imports its own code when it is called."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file
from milepost.runtime.launch import exit_code
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

from .campaign_command import campaign
from .chaos_command import chaos
from .inject_command import FREE_OPTIONS, inject
from .options import ConnectOption, JsonOption, StateDirOption, TrainOption, complete_scenario, show_versions

DEFAULT_TRAIN = Path("full")

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Tells a train where it is and how fast it is going, with bounds on both errors.",
)


HIDDEN = {"hidden": True}


@app.callback()
def milepost(
    version: Annotated[
        bool, typer.Option("--version", callback=show_versions, is_eager=True, help="Show the versions and exit.")
    ] = False,
) -> None:
    """Tells a train where it is and how fast it is going, with bounds on both errors."""


@app.command()
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
) -> None:
    """Start a train and show it: a router, and one process for each sensor, each filter, the fuser and the balise service."""
    from .up import UpOptions, run_up

    raise typer.Exit(run_up(UpOptions(find_file(train, "trains"), duration, speed, report, headless, listen, state_dir)))


@app.command()
def watch(connect: ConnectOption = [DEFAULT_ENDPOINT]) -> None:  # noqa: B006
    """Show a live table of the trains on a router; for simulated trains with the true error."""
    from .watch import run_watch

    raise typer.Exit(run_watch(connect))


@app.command()
def status(
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    as_json: JsonOption = False,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds to wait for a state.")] = 2.0,
) -> None:
    """Print each train's state once. Exit code 1 if there is none, one is not `normal`, or a process has a second instance."""
    from .status import run_status

    raise typer.Exit(run_status(connect, as_json, timeout))


app.command(context_settings=FREE_OPTIONS)(inject)


@app.command()
def run(
    role: Annotated[str, typer.Argument(help="One of router, world, sensor, filter, balise, fuser.")],
    unit: Annotated[str, typer.Argument(help="The unit, for a sensor or a filter.")] = "",
    train: TrainOption = DEFAULT_TRAIN,
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    listen: Annotated[list[str], typer.Option("--listen", help="Router only: endpoints to listen on.")] = [DEFAULT_ENDPOINT],  # noqa: B006
    link: Annotated[list[str], typer.Option("--link", help="Router only: endpoint of another router to link with.")] = [],  # noqa: B006
    config: Annotated[Path | None, typer.Option("--config", help="Router only: Zenoh configuration file to use.")] = None,
    speed: Annotated[
        float, typer.Option("--speed", min=0.01, max=1000.0, help="World only: scenario seconds per second of real time.")
    ] = 1.0,
    duration: Annotated[
        float | None, typer.Option("--duration", min=0.1, help="Stop after this many seconds of scenario time.")
    ] = None,
    parent: Annotated[int | None, typer.Option("--parent", hidden=True)] = None,
    state_dir: StateDirOption = None,
) -> None:
    """Run one process of a train, as compose.yaml does."""
    from .run import run_role

    run_role(role, unit, find_file(train, "trains"), connect, listen, link, config, speed, duration, parent, state_dir)


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
app.command()(chaos)


@app.command()
def rerun(
    readings: Annotated[Path, typer.Argument(help="Recorded messages: one JSON object per line, in order of arrival.")],
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


@app.command()
def schema(
    out: Annotated[Path, typer.Option("--out", help="Folder to write to.")] = Path("schemas/json"),
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit code 1 if a file differs.")] = False,
) -> None:
    """Export the JSON Schemas of all messages."""
    from .schema import run_schema

    raise typer.Exit(run_schema(out, check))


@app.command(**HIDDEN)  # type: ignore[arg-type]
def display(
    connect: Annotated[list[str], typer.Option("--connect")],
    name: Annotated[str, typer.Option("--name")],
    expect: Annotated[list[str], typer.Option("--expect")],
    mode: Annotated[str, typer.Option("--mode")],
    began_ns: Annotated[int, typer.Option("--began-ns")],
) -> None:
    """Show a train for `up`."""
    from .display import run_display

    run_display(connect, name, expect, mode, began_ns)  # type: ignore[arg-type]


@app.command(**HIDDEN)  # type: ignore[arg-type]
def observe(
    report: Annotated[Path, typer.Option("--report")],
    stalls: Annotated[Path, typer.Option("--stalls")],
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    name: Annotated[str, typer.Option("--name")] = "*",
) -> None:
    """Listen from outside until stopped, then write a report."""
    from milepost.runtime.observer import run_observe

    run_observe(connect, name, report, stalls)


@app.command(**HIDDEN)  # type: ignore[arg-type]
def sentinel(stalls: Annotated[Path, typer.Option("--stalls")]) -> None:
    """Record when the machine delays a process: sleep a millisecond at a time and note longer gaps."""
    from milepost.runtime.stalls import run_sentinel

    run_sentinel(stalls)


def main() -> None:
    """Read the command line and do what it says. A configuration error is one line and exit code 2."""
    sys.exit(exit_code(partial(app, prog_name="milepost")))
