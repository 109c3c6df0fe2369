"""The command line of `milepost up`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..machines.web_servers import WebPorts

if TYPE_CHECKING:
    from milepost.cli.showing.display import Mode

NO_SERVERS = WebPorts()


@dataclass(frozen=True)
class UpOptions:
    """The command line of `milepost up`. `connect`: the routers to join, instead of those on `listen`."""

    train_files: list[Path]
    fleet_file: Path | None
    duration_s: float | None
    speed: float
    report: Path | None
    headless: bool
    listen: list[str]
    connect: list[str]
    state_dir: Path | None
    secure: bool = False
    record: Path | None = None
    external: Sequence[str] = ()
    web: WebPorts = NO_SERVERS
    together: bool = False

    @property
    def mode(self) -> Mode:
        """How the trains are shown."""
        if self.headless:
            return "start"
        return "table" if sys.stdout.isatty() else "lines"

    @property
    def endpoints(self) -> list[str]:
        """Where the routers are."""
        return self.connect or self.listen
