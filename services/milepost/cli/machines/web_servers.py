"""The web servers that `milepost up` starts beside its trains: the feed for machines, the dispatch page for people."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from milepost.config.errors import ConfigError
from milepost.runtime.launch import Job
from milepost.runtime.zenoh_config import Connection, as_options

HERE = "127.0.0.1"


@dataclass(frozen=True)
class WebPorts:
    """The ports of the servers; None: it is not started."""

    feed: int | None = None
    page: int | None = None

    def check(self) -> None:
        """Raises ConfigError where a library is missing or nothing can listen on a port."""
        if self.feed is not None:
            from .feed import check_feed

            check_feed(HERE, self.feed, "up", "--feed")
        if self.page is not None:
            from .page import check_page

            check_page(HERE, self.page, "up", "--page")
            if self.page == self.feed:
                raise ConfigError("up", "--page", f"{HERE}:{self.page} is that of --feed")

    def sentences(self) -> list[str]:
        """Where they are, for people."""
        feed = [] if self.feed is None else [f"http://{HERE}:{self.feed} lists what machines can read"]
        return feed + ([] if self.page is None else [f"the dispatch page is at http://{HERE}:{self.page}"])

    def jobs(self, connection: Callable[[str], Connection], lines: Sequence[Path]) -> Iterator[Job]:
        """Their processes. `connection`: how each connects, by its name; `lines`: the files of the trains' lines."""
        lines = list(dict.fromkeys(lines))
        options = [word for line in lines for word in ("--line", str(line))]
        if self.feed is not None:
            from .feed import feed_body

            yield _job("feed", self.feed, options, connection("feed"), feed_body, lines)
        if self.page is not None:
            from .page import page_body

            yield _job("page", self.page, options, connection("page"), page_body, lines)


def _job(
    name: str, port: int, options: Sequence[str], connection: Connection, body: Callable[..., None], lines: Sequence[Path]
) -> Job:
    words = ("--port", str(port), *options, *as_options(connection))
    return Job(name, (name,), words, partial(body, connection, HERE, port, lines))
