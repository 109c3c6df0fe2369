"""Options that several commands share, `--version`, and the completion of names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from milepost.config.errors import ConfigError
from milepost.config.shipped_files import names_in
from milepost.runtime.logs.records import FORMAT_VARIABLE, LEVEL_VARIABLE, LogFormat, LogLevel
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

DEFAULT_TRAIN = Path("full")
# what Zenoh's links are called
WITH_PORT, WITHOUT_PORT = ("tcp", "tls", "udp", "quic", "ws"), ("unixsock-stream", "unixpipe", "serial", "vsock")
LAST_PORT = 65535
DISTRIBUTIONS = ("milepost", "milepost-schemas")


def show_versions(asked: bool) -> None:
    """Print the versions of both distributions and end, if asked to."""
    if asked:
        from importlib.metadata import version

        for distribution in DISTRIBUTIONS:
            typer.echo(f"{distribution} {version(distribution)}")
        raise typer.Exit


def _complete(kind: str, typed: str) -> list[str]:
    # where this finds none, the shell completes file names
    return [name for name in names_in(kind) if name.startswith(typed)]


def complete_train(incomplete: str) -> list[str]:
    """The names of trains that begin so."""
    return _complete("trains", incomplete)


def complete_scenario(incomplete: str) -> list[str]:
    """The names of scenarios that begin so."""
    return _complete("scenarios", incomplete)


def complete_fleet(incomplete: str) -> list[str]:
    """The names of fleets that begin so."""
    return _complete("fleets", incomplete)


def complete_campaign(incomplete: str) -> list[str]:
    """The names of campaigns that begin so."""
    return _complete("campaigns", incomplete)


def _checked_endpoints(option: str, given: list[str] | None) -> list[str] | None:
    for each in given or ():
        protocol, _, address = each.partition("/")
        port = re.match(r".+:(\d+)", address)
        whole = (
            port is not None and int(port[1]) <= LAST_PORT if protocol in WITH_PORT else address and protocol in WITHOUT_PORT
        )
        if not whole:
            raise ConfigError(option, "", f"{each!r} is not an endpoint such as {DEFAULT_ENDPOINT}")
    return given


def endpoints(given: list[str] | None) -> list[str] | None:
    """Endpoints as they are given. Raises ConfigError for what is none: to look for a router there would end in `no router`."""
    return _checked_endpoints("--connect", given)


def links(given: list[str] | None) -> list[str] | None:
    """The same of the endpoints of other routers."""
    return _checked_endpoints("--link", given)


TrainOption = Annotated[
    Path,
    typer.Option(
        "--train",
        autocompletion=complete_train,
        envvar="MILEPOST_TRAIN",
        help="Train file, or the name of one: looked up in ./deploy/trains, then among those shipped with Milepost.",
    ),
]
ConnectOption = Annotated[
    list[str],
    typer.Option(
        "--connect",
        envvar="MILEPOST_CONNECT",
        callback=endpoints,
        help="Endpoint of the router. Repeat the option to name others for failover.",
    ),
]
ZenohConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--zenoh-config",
        envvar="MILEPOST_ZENOH_CONFIG",
        help="File of a whole Zenoh session configuration, with endpoints and certificates; --connect is not used then.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
StateDirOption = Annotated[
    Path | None,
    typer.Option(
        "--state-dir",
        envvar="MILEPOST_STATE_DIR",
        help="Folder for what outlives a run: calibrations of filters and, in pki/TRAIN, certificates.",
    ),
]
RecordOption = Annotated[
    Path | None,
    typer.Option(
        "--record", help="Folder in which everything that is sent is recorded, in MCAP files. Needs the extra `record`."
    ),
]
LogLevelOption = Annotated[
    LogLevel,
    typer.Option(
        "--log-level", envvar=LEVEL_VARIABLE, help="Log what is as bad as this, or worse. With `debug` also tracebacks."
    ),
]
LogFormatOption = Annotated[
    LogFormat, typer.Option("--log-format", envvar=FORMAT_VARIABLE, help="Log lines for people, or JSON objects, one a line.")
]
UrlOption = Annotated[
    str,
    typer.Option(
        "--url", help="What it says its address is, where people reach it by another one: the port that a container publishes."
    ),
]
