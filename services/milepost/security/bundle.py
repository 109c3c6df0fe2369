"""The folder of a train's certificates: for each name one folder with all that its process needs to connect.

ca.pem, ca.key              the authority; nothing but `milepost pki` reads its key
NAME/ca.pem, identity.pem, session.json5
"""

from __future__ import annotations

import datetime
import json
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milepost.config.errors import ConfigError
from milepost.config.mistakes import must_be_one_of
from milepost.config.train import Train
from milepost.runtime import zenoh_config

from .access import ROUTERS, names
from .authority import DEFAULT_DAYS, IDENTITY, ROOT, Authority, expires_at, hosts_of, write_public
from .rules import access_control

SESSION = "session.json5"
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
CONNECTS = {"root_ca_certificate": ROOT, "connect_certificate": IDENTITY, "connect_private_key": IDENTITY}
LISTENS = {"listen_certificate": IDENTITY, "listen_private_key": IDENTITY}
CHECKS = {"enable_mtls": True, "verify_name_on_connect": True, "close_link_on_expiration": True}
# a router looks for a new certificate once a second, and its clients must be elsewhere before the next one goes
BETWEEN_ROUTERS_S = 5.0


def folder_of(train: str, state_dir: Path | None) -> Path:
    """Where a train's certificates lie, if nothing else is said."""
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return (state_dir or Path(home) / "milepost") / "pki" / train


@dataclass(frozen=True)
class Bundle:
    """The certificates of a train in a folder."""

    folder: Path
    train: Train

    def session(self, name: str) -> Path:
        """The whole session configuration of a process or tool."""
        return self.folder / name / SESSION

    def create(self, days: float, hosts: Sequence[str], owner: int | None = None) -> None:
        """An authority and a certificate for everybody, owned by the user `owner`. Raises ConfigError, OSError."""
        authority = Authority.create(self.folder, self.train.name)
        for name in names(self.train):
            (self.folder / name).mkdir(mode=0o755)
            if owner is not None:
                os.chown(self.folder / name, owner, owner)
        self._issue(authority, names(self.train), days, hosts)

    def issue(self, wanted: Sequence[str], days: float, hosts: Sequence[str] = ()) -> None:
        """New certificates for some. Raises ConfigError for a name that the train does not have."""
        known = names(self.train)
        for name in wanted:
            if name not in known:
                raise ConfigError("pki issue", "NAME", must_be_one_of(known, name))
        self._issue(self._authority(), wanted, days, hosts)

    def rotate(self, days: float, tell: Callable[[str], None], wait_s: float = BETWEEN_ROUTERS_S) -> None:
        """New certificates for all: first for those that connect, then for one router after the other."""
        authority = self._authority()
        routers = [name for name in ROUTERS if (self.folder / name / IDENTITY).is_file()]
        self._issue(authority, [name for name in names(self.train) if name not in ROUTERS], days)
        for i, name in enumerate(routers):
            if i:
                tell(f"waiting {wait_s:g} s, until everybody is connected to {routers[i - 1]}")
                time.sleep(wait_s)
            self._issue(authority, [name], days)
            tell(f"{name} has a new certificate; its clients connect again with theirs")

    def _authority(self) -> Authority:
        """The folder's authority. Raises ConfigError where it is another train's: its processes have other names."""
        authority = Authority.load(self.folder)
        if authority.train != self.train.name:
            text = f"is the authority of {authority.train}, not of {self.train.name}; name its train with `--train`"
            raise ConfigError(self.folder / ROOT, "", text)
        return authority

    def _issue(self, authority: Authority, wanted: Iterable[str], days: float, hosts: Sequence[str] = ()) -> None:
        for name in wanted:
            folder = self.folder / name
            its_hosts: Sequence[str] = ()
            if name in ROUTERS:
                its_hosts = [*dict.fromkeys((name, *LOCAL_HOSTS, *hosts))] if hosts else hosts_of(folder / IDENTITY)
            authority.issue(folder, name, days, its_hosts or ((name, *LOCAL_HOSTS) if name in ROUTERS else ()))

    def due(self, days: float, hosts: Sequence[str]) -> list[str]:
        """Who has no certificate, or one that is valid for less than half of so many days, or not for a router's hosts."""
        enough = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=days / 2.0)
        files = {name: self.folder / name / IDENTITY for name in names(self.train)}
        return [
            name
            for name, file in files.items()
            if not file.is_file() or expires_at(file) < enough or (name in ROUTERS and not set(hosts) <= set(hosts_of(file)))
        ]

    def write_sessions(self, listen: Sequence[str], connect: Sequence[str]) -> None:
        """The configurations of all sessions; the routers listen on `listen`, everybody else connects to `connect`."""
        for i, name in enumerate(ROUTERS[: len(listen)]):
            self._write_session(name, self._router(name, listen[i], connect[:i]))
        for name in names(self.train):
            if name not in ROUTERS:
                tls = {**CONNECTS, **CHECKS}
                connects = {"mode": "client", "connect": {"endpoints": list(connect)}, "transport": {"link": {"tls": tls}}}
                self._write_session(name, {**connects, "scouting": {"multicast": {"enabled": False}}})

    def _router(self, name: str, listen: str, link: Sequence[str]) -> dict[str, Any]:
        config = zenoh_config.router([listen], link)
        config["transport"]["link"]["tls"] = {**CONNECTS, **LISTENS, **CHECKS}
        about = {"name": name, "train": self.train.name}
        return {**config, "metadata": about, "access_control": access_control(self.train)}

    def _write_session(self, name: str, config: dict[str, Any]) -> None:
        write_public(self.session(name), (json.dumps(config, indent=2) + "\n").encode())


def certified(train: Train, state_dir: Path | None, listen: Sequence[str]) -> Callable[[str], Path]:
    """The session file of each process of a train on this machine, after certificates were made or renewed where that is due.

    Raises ConfigError.
    """
    bundle = Bundle(folder_of(train.name, state_dir), train)
    if len(listen) > len(ROUTERS):
        raise ConfigError("up", "--listen", f"a secure train has at most {len(ROUTERS)} routers")
    hosts = [endpoint.removeprefix("tls/").rpartition(":")[0].strip("[]") for endpoint in listen]
    try:
        if not (bundle.folder / ROOT).is_file():
            bundle.create(DEFAULT_DAYS, hosts)
        elif due := bundle.due(DEFAULT_DAYS, hosts):
            bundle.issue(due, DEFAULT_DAYS, hosts)
        bundle.write_sessions(listen, listen)
    except OSError as error:
        raise ConfigError(bundle.folder, "", error.strerror or str(error)) from error
    return bundle.session
