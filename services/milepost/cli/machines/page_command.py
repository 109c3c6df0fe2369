"""The command `milepost page` and its options; it imports its own code when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.cli.options import ConnectOption, LogFormatOption, LogLevelOption, UrlOption, ZenohConfigOption
from milepost.runtime.logs.records import LogFormat, LogLevel, choose
from milepost.runtime.zenoh_config import DEFAULT_ENDPOINT

DEFAULT_PORT = 9480


def page(
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Port of the web server.")] = DEFAULT_PORT,
    host: Annotated[
        str,
        typer.Option(
            "--host",
            help="Address to listen on; whoever reaches it can read. Default: this machine only, where faults may be injected.",
        ),
    ] = "127.0.0.1",
    line: Annotated[
        list[Path],
        typer.Option("--line", help="Line file, to draw trains on it, besides those in deploy/lines. Repeatable."),
    ] = [],  # noqa: B006
    connect: ConnectOption = [DEFAULT_ENDPOINT],  # noqa: B006
    zenoh_config: ZenohConfigOption = None,
    url: UrlOption = "",
    log_level: LogLevelOption = LogLevel.info,
    log_format: LogFormatOption = LogFormat.text,
) -> None:
    """Show the trains on a router in a browser: all of them, and each with its line, sensors and events."""
    from .web_servers import run_web_server

    choose(log_level, log_format)
    raise typer.Exit(run_web_server("page", zenoh_config or connect, host, port, line, url))
