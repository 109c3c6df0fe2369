"""THE TABLE OF WEB SERVERS: the feed for machines and the dispatch page for people, as commands and beside `milepost up`."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType

from milepost.cli.endpoint import port_is_free
from milepost.config.errors import ConfigError
from milepost.runtime.launch import Job
from milepost.runtime.logs.records import say, set_up_log
from milepost.runtime.zenoh_config import Connection, as_options

HERE = "127.0.0.1"
# where it is, for people; the code of each is the module of its name, with `needs` and `serve`
WEB_SERVERS = {
    "feed": "http://{place} lists what machines can read",
    "page": "the dispatch page is at http://{place}",
}


def run_web_server(name: str, connection: Connection, host: str, port: int, lines: Sequence[Path], url: str) -> int:
    """The command of a web server. Raises ConfigError."""
    set_up_log(name)
    _check(name, host, port, name, "--port")
    # opening a session waits inside Zenoh, where Python cannot see a signal
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _code(name).serve(connection, host, port, lines, say, url)
    return 0


@dataclass(frozen=True)
class WebPorts:
    """The ports of the servers beside `milepost up`; None: it is not started."""

    feed: int | None = None
    page: int | None = None

    def check(self) -> None:
        """Raises ConfigError where a library is missing or nothing can listen on a port."""
        taken: dict[int, str] = {}
        for name, port in self._wanted():
            _check(name, HERE, port, "up", f"--{name}")
            if port in taken:
                raise ConfigError("up", f"--{name}", f"{HERE}:{port} is that of --{taken[port]}")
            taken[port] = name

    def sentences(self) -> list[str]:
        """Where they are, for people."""
        return [WEB_SERVERS[name].format(place=f"{HERE}:{port}") for name, port in self._wanted()]

    def jobs(self, connection: Callable[[str], Connection], lines: Sequence[Path]) -> Iterator[Job]:
        """Their processes. `connection`: how each connects, by its name; `lines`: the files of the trains' lines."""
        lines = list(dict.fromkeys(lines))
        options = [word for line in lines for word in ("--line", str(line))]
        for name, port in self._wanted():
            own = connection(name)
            words = ("--port", str(port), *options, *as_options(own))
            yield Job(name, (name,), words, partial(_body, name, own, port, lines))

    def _wanted(self) -> list[tuple[str, int]]:
        return [(name, port) for name, port in (("feed", self.feed), ("page", self.page)) if port is not None]


def _code(name: str) -> ModuleType:
    """Loaded when it is used: `milepost up` says its first words before anything heavy."""
    return import_module(f".{name}", __package__)


def _body(name: str, connection: Connection, port: int, lines: Sequence[Path]) -> None:
    set_up_log(name)
    _code(name).serve(connection, HERE, port, lines, None, "")


def _check(name: str, host: str, port: int, command: str, option: str) -> None:
    """Raises ConfigError where a library is missing or nothing can listen on a port."""
    _code(name).needs(command, option)
    place = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    try:
        free = port_is_free(f"tcp/{place}")
    except ValueError as error:
        raise ConfigError(command, option, str(error)) from error
    if not free:
        raise ConfigError(command, option, f"{place} is in use")
