"""`milepost pki` and `milepost acl`: certificates, and who may send what."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from milepost.config.errors import ConfigError
from milepost.config.shipped_files import find_file
from milepost.runtime.logs.records import say

from .options import DEFAULT_TRAIN, StateDirOption, TrainOption

# as in milepost.security.authority; the library behind it is not imported before it is needed
DEFAULT_DAYS = 7.0
HOST = re.compile(r"[0-9A-Za-z:](?:[0-9A-Za-z._:-]*[0-9A-Za-z:])?")

pki = typer.Typer(no_args_is_help=True, help="Certificates for the processes of a train, from an authority of its own.")
DirOption = Annotated[
    Path | None,
    typer.Option("--dir", help="Folder of the certificates. Default: pki/TRAIN in the state folder (~/.local/state/milepost)."),
]
DaysOption = Annotated[float, typer.Option("--days", min=0.0001, max=825.0, help="Days for which certificates are valid.")]
HostOption = Annotated[
    list[str], typer.Option("--host", help="Name or address of a router, besides its own name and localhost. Repeatable.")
]


def _checked(hosts: list[str], command: str) -> list[str]:
    for host in hosts:
        # letters of other alphabets are written in punycode; a wildcard would stand for hosts that are none of the train's
        if HOST.fullmatch(host) is None:
            raise ConfigError(command, "--host", f"{host!r} is no name or address of a host")
    return hosts


def _bundle(train: Path, folder: Path | None, state_dir: Path | None):  # type: ignore[no-untyped-def]
    from milepost.config.train import load_train
    from milepost.security.bundle import Bundle, folder_of

    loaded = load_train(find_file(train, "trains"))
    return Bundle(folder or folder_of(loaded.name, state_dir), loaded)


@pki.command()
def init(
    train: TrainOption = DEFAULT_TRAIN,
    folder: DirOption = None,
    days: DaysOption = DEFAULT_DAYS,
    host: HostOption = [],  # noqa: B006
    listen: Annotated[
        list[str], typer.Option("--listen", help="Endpoint on which a router listens. Repeat it for the second one.")
    ] = ["tls/127.0.0.1:7447"],  # noqa: B006
    connect: Annotated[
        list[str],
        typer.Option("--connect", help="Endpoints under which the routers are reached, in their order. Default: as --listen."),
    ] = [],  # noqa: B006
    owner: Annotated[
        int | None,
        typer.Option("--owner", min=0, help="User id of the processes, where it is another: 10001 in containers. Needs root."),
    ] = None,
    state_dir: StateDirOption = None,
) -> None:
    """Make an authority, a certificate for each process, router and tool, and the session configurations that use them."""
    if connect and len(connect) != len(listen):
        raise ConfigError("pki init", "--connect", f"there are {len(listen)} routers: name as many endpoints")
    for endpoint in (*listen, *connect):
        if not endpoint.startswith("tls/"):
            raise ConfigError("pki init", "--listen, --connect", f"{endpoint!r} is not tls/HOST:PORT")
    bundle = _bundle(train, folder, state_dir)
    bundle.create(days, _checked(host, "pki init"), owner)
    bundle.write_sessions(listen, connect or listen)
    say(f"{bundle.folder}: certificates for {days:g} days; keep ca.key from everybody")


@pki.command()
def issue(
    name: Annotated[list[str], typer.Argument(help="Names of processes, routers or tools, such as sensor-radar or dispatch.")],
    train: TrainOption = DEFAULT_TRAIN,
    folder: DirOption = None,
    days: DaysOption = DEFAULT_DAYS,
    host: HostOption = [],  # noqa: B006
    state_dir: StateDirOption = None,
) -> None:
    """Replace the certificates of some."""
    bundle = _bundle(train, folder, state_dir)
    bundle.issue(name, days, _checked(host, "pki issue"))
    say(f"{bundle.folder}: {', '.join(name)}: certificates for {days:g} days")


@pki.command()
def rotate(
    train: TrainOption = DEFAULT_TRAIN,
    folder: DirOption = None,
    days: DaysOption = DEFAULT_DAYS,
    state_dir: StateDirOption = None,
) -> None:
    """Replace all certificates while the train runs: routers last and one after the other, so that everybody connects again."""
    bundle = _bundle(train, folder, state_dir)
    bundle.rotate(days, say)
    say(f"{bundle.folder}: certificates for {days:g} days")


def acl(train: TrainOption = DEFAULT_TRAIN) -> None:
    """Print the access control of a train's routers, as Zenoh takes it: what each certificate may send and receive."""
    from milepost.config.train import load_train
    from milepost.security.rules import access_control

    print(json.dumps({"access_control": access_control(load_train(find_file(train, "trains")))}, indent=2))
