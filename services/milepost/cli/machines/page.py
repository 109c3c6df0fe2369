"""`milepost page`: the dispatch page, a web server for people."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from milepost.cli.say import say
from milepost.config.errors import ConfigError
from milepost.config.line_tracks import KnownLines
from milepost.runtime.logs.records import set_up_log
from milepost.runtime.zenoh_config import Connection

from .feed import check_port

if TYPE_CHECKING:
    from milepost.page.injecting import Answer, Order


def check_page(host: str, port: int, command: str, option: str) -> None:
    """Raises ConfigError where the library is missing or nothing can listen on a port."""
    from importlib.util import find_spec

    if find_spec("nicegui") is None:
        raise ConfigError(command, option, "needs nicegui: pip install 'milepost[page]'")
    check_port(host, port, command, option)


def page_body(
    connection: Connection,
    host: str,
    port: int,
    lines: Sequence[Path],
    tell: Callable[[str], None] | None = None,
    url: str = "",
) -> None:
    """Serve until stopped. Raises ConfigError for a line file that cannot be used."""
    from milepost.runtime.web.page_server import run_page

    set_up_log("page")
    run_page(connection, host, port, KnownLines(lines, say), lambda order: _send(connection, order), tell, url)


def _send(connection: Connection, order: Order) -> Answer:
    """What `milepost inject` does, with the answer for a page."""
    from milepost.cli.inject import Wanted, fields_of
    from milepost.page.injecting import Answer
    from milepost.runtime.bus import NoRouterError
    from milepost.runtime.injecting.commands import NoAnswerError, send_command

    wanted = Wanted(order.unit, order.fault, order.options, order.for_s, not order.fault, order.train)
    try:
        answer = send_command(connection, order.train, order.unit, fields_of(wanted))
    except (ConfigError, NoRouterError, NoAnswerError) as error:
        return Answer(False, str(error))
    return Answer(answer.code != "fault_refused", answer.text.rpartition(" (")[0])


def run_page_command(connection: Connection, host: str, port: int, lines: Sequence[Path], url: str = "") -> int:
    """`milepost page`. Raises ConfigError."""
    set_up_log("page")
    check_page(host, port, "page", "--port")
    # opening a session waits inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    page_body(connection, host, port, lines, say, url)
    return 0
