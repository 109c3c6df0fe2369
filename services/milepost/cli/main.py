"""`milepost`: the commands and their options. The work is in the other files, imported when it is asked for."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from milepost.runtime.launch import exit_code
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

DEFAULT_TRAIN = Path("deploy/trains/full.yaml")

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Tells a train where it is and how fast it goes, with an honest bound on the error.",
)

TrainOption = Annotated[Path, typer.Option("--train", help="the train file")]
ConnectOption = Annotated[
    list[str], typer.Option("--connect", envvar="MILEPOST_CONNECT", help="the router's endpoint; again for failover")
]
JsonOption = Annotated[bool, typer.Option("--json", help="print JSON")]
StateDirOption = Annotated[
    Path | None,
    typer.Option("--state-dir", envvar="MILEPOST_STATE_DIR", help="the folder where filters keep what they learned"),
]
HIDDEN = {"hidden": True}


@app.command()
def up(
    train: TrainOption = DEFAULT_TRAIN,
    duration: Annotated[float | None, typer.Option("--duration", min=0.1, help="seconds of scenario time, then end")] = None,
    speed: Annotated[float, typer.Option("--speed", min=0.01, max=1000.0, help="scenario time runs so much faster")] = 1.0,
    report: Annotated[
        Path | None, typer.Option("--report", help="write what was measured to this JSON file at the end")
    ] = None,
    headless: Annotated[bool, typer.Option("--headless", help="no live table")] = False,
    listen: Annotated[str, typer.Option("--listen", help="the endpoint of the embedded router")] = DEFAULT_ENDPOINT,
    state_dir: StateDirOption = None,
) -> None:
    """Start a train: router, sensors, filters, fuser and balise service, each a process of its own, and show it."""
    from .up import UpOptions, run_up

    raise typer.Exit(run_up(UpOptions(train, duration, speed, report, headless, listen, state_dir)))


@app.command()
def watch(connect: ConnectOption = [DEFAULT_ENDPOINT]) -> None:  # noqa: B006
    """A live table of the trains on a router: position, interval, speed, status, sensors, true error where truth exists."""
    from .watch import run_watch

    raise typer.Exit(run_watch(connect))


@app.command()
def status(
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    as_json: JsonOption = False,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="seconds to wait for a state")] = 2.0,
) -> None:
    """One look at the state; exit code 1 if a train's status is not normal or there is none."""
    from .status import run_status

    raise typer.Exit(run_status(connect, as_json, timeout))


@app.command()
def run(
    role: Annotated[str, typer.Argument(help="router, world, sensor, filter, balise or fuser")],
    unit: Annotated[str, typer.Argument(help="the unit, for sensor and filter")] = "",
    train: TrainOption = DEFAULT_TRAIN,
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    listen: Annotated[list[str], typer.Option("--listen", help="for the router: endpoints to listen on")] = [DEFAULT_ENDPOINT],  # noqa: B006
    config: Annotated[Path | None, typer.Option("--config", help="for the router: a Zenoh configuration file instead")] = None,
    speed: Annotated[
        float, typer.Option("--speed", min=0.01, max=1000.0, help="for the world: how fast scenario time runs")
    ] = 1.0,
    duration: Annotated[float | None, typer.Option("--duration", min=0.1, help="seconds of scenario time")] = None,
    parent: Annotated[int | None, typer.Option("--parent", hidden=True)] = None,
    state_dir: StateDirOption = None,
) -> None:
    """Run one process; what compose.yaml calls."""
    from .run import run_role

    run_role(role, unit, train, connect, listen, config, speed, duration, parent, state_dir)


@app.command()
def evaluate(
    scenario: Annotated[
        Path | None, typer.Argument(help="a scenario file; with --all, the folder of them (deploy/scenarios)")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="every scenario of the folder, beside what sources claim")] = False,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="another seed than the scenario's")] = None,
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="so many seeds, counting up; medians and worst (1; with --all, 20)")
    ] = None,
    jobs: Annotated[int | None, typer.Option("--jobs", min=1, help="so many processes; as many as cores")] = None,
    as_json: JsonOption = False,
    plot: Annotated[Path | None, typer.Option("--plot", help="draw errors and intervals to this PNG file")] = None,
    record: Annotated[Path | None, typer.Option("--record", help="keep every message in this JSON-lines file")] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="write index.html, results.json and pictures to this folder")
    ] = None,
    only: Annotated[list[str], typer.Option("--only", help="with --all: these scenarios alone, by name")] = [],  # noqa: B006
) -> None:
    """Run scenarios offline, on the same nodes, and compare the estimators with the truth."""
    from .evaluate import run_evaluate, run_evaluate_all

    if everything:
        if seed is not None or plot is not None or record is not None:
            raise typer.BadParameter("--seed, --plot and --record are for one scenario", param_hint="--all")
        raise typer.Exit(run_evaluate_all(scenario, runs, jobs, as_json, report, only))
    if scenario is None or only:
        raise typer.BadParameter("give one scenario file, or --all", param_hint="SCENARIO")
    raise typer.Exit(run_evaluate(scenario, seed, runs, jobs, as_json, plot, record, report))


@app.command()
def rerun(
    readings: Annotated[Path, typer.Argument(help="recorded messages, one JSON object a line, in order of arrival")],
    out: Annotated[Path, typer.Option("--out", help="the settled states, one a line")],
    train: TrainOption = DEFAULT_TRAIN,
    origin: Annotated[
        str, typer.Option("--from", help="`readings`: run filters, balise service and fuser; `estimates`: the fuser alone")
    ] = "readings",
) -> None:
    """Run recorded messages through the same nodes, as fast as it goes."""
    from .rerun import run_rerun

    raise typer.Exit(run_rerun(readings, train, out, origin))


@app.command()
def schema(
    out: Annotated[Path, typer.Option("--out", help="the folder to write to")] = Path("schemas/json"),
    check: Annotated[bool, typer.Option("--check", help="write nothing; exit 1 if a file differs")] = False,
) -> None:
    """Export the JSON Schemas of all messages."""
    from .schema import run_schema

    raise typer.Exit(run_schema(out, check))


@app.command(**HIDDEN)  # type: ignore[arg-type]
def display(
    connect: Annotated[str, typer.Option("--connect")],
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
    from milepost.evaluation.live import run_observe

    run_observe(connect, name, report, stalls)


@app.command(**HIDDEN)  # type: ignore[arg-type]
def sentinel(stalls: Annotated[Path, typer.Option("--stalls")]) -> None:
    """Sleep a millisecond at a time and note when it took much longer: the machine's own stalls."""
    from milepost.evaluation.stalls import run_sentinel

    run_sentinel(stalls)


def main() -> None:
    """Read the command line and do what it says. A configuration error is one line and exit code 2."""
    sys.exit(exit_code(app))
