"""The compose file of a train, as text."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from milepost.cli.machines import feed_command, page_command
from milepost.config.shipped_files import shipped_folder
from milepost.config.train import Train, load_train

from .secure import secure_text
from .services import KEPT, Service, literal, recorder_service, train_services, web_service
from .train_files import Mounted, TrainFiles, train_files

SKELETON = Path(__file__).with_name("skeleton.yaml")
READABLE_BY_ALL = 0o004


@dataclass(frozen=True)
class Beside:
    """What runs beside the train."""

    record: bool = False
    feed: bool = False
    page: bool = False

    @property
    def options(self) -> list[str]:
        """As the command line names it."""
        return [f"--{name}" for name in ("record", "feed", "page") if getattr(self, name)]


def compose_text(train: Train, files: TrainFiles, beside: Beside, given: str) -> str:
    """The compose file for the working folder. `given`: how the command line named the train."""
    anchors = {each.target: f"file-{number}" for number, each in enumerate(files.all, start=1)}
    services = _services(train, files, beside)
    source = shipped_folder().parent
    buildable = (source / "deploy" / "Dockerfile").is_file()
    parts = {
        "train": train.name,
        "command": shlex.join(["milepost", "compose", given, *beside.options]),
        "variables": "\n".join(_variables(services, beside, buildable)),
        "made_by": "the service `router` builds it" if buildable else "it is built in Milepost's repository",
        "train_file": literal(str(files.train.target)),
        "files": "\n".join(f"    - &{anchors[each.target]} {_mount(each)}" for each in files.all),
        "build": "\n".join(_build(source)) if buildable else "",
        "services": "\n\n".join("\n".join(each.lines(list(anchors.values()))) for each in services),
        "volumes": "\n".join(_volumes(services)),
    }
    text = SKELETON.read_text(encoding="utf-8")
    for name, value in parts.items():
        text = text.replace(f"<{name}>\n", f"{value}\n" if value else "").replace(f"<{name}>", value)
    return text.rstrip("\n") + "\n"


def unreadable(files: TrainFiles) -> list[Path]:
    """Files that the user of the containers, who is nobody on this machine, cannot read."""
    return [each.source for each in files.all if not each.source.stat().st_mode & READABLE_BY_ALL]


def _services(train: Train, files: TrainFiles, beside: Beside) -> list[Service]:
    """Those of the train and of what runs beside it, without the routers."""
    return [*train_services(train, beside.record), *_beside(beside, files)]


def _beside(beside: Beside, files: TrainFiles) -> Iterator[Service]:
    if beside.record:
        yield recorder_service()
    if beside.feed:
        yield web_service("feed", feed_command.DEFAULT_PORT, files.line.target)
    if beside.page:
        yield web_service("page", page_command.DEFAULT_PORT, files.line.target)


def _here(path: Path) -> str:
    """A path as seen from the working folder, where the compose file is to be; what is elsewhere by its whole path."""
    whole = Path(os.path.abspath(path))
    inside = whole.is_relative_to(Path.cwd())
    return literal(f"./{whole.relative_to(Path.cwd())}".removesuffix("/.") if inside else str(whole))


def _mount(file: Mounted) -> str:
    target = literal(str(file.target))
    return f"{{type: bind, source: {_here(file.source)}, target: {target}, read_only: true}}"


def _build(source: Path) -> Iterator[str]:
    yield "    build:"
    yield f"      context: {_here(source)}"
    yield "      dockerfile: deploy/Dockerfile"
    yield "      network: ${MILEPOST_BUILD_NETWORK:-default}"
    yield "      args:"
    yield "        BASE_IMAGE: ${MILEPOST_BASE_IMAGE:-python:3.11-slim}"


def _variables(services: Sequence[Service], beside: Beside, buildable: bool) -> Iterator[str]:
    rows = [
        ("MILEPOST_PORT", "the router's port on this machine, for dispatch tools (7447)", True),
        ("MILEPOST_PORT_2", "the second router's (7448)", True),
        ("MILEPOST_LOG_LEVEL", "debug, info, warning or error (info)", True),
        ("MILEPOST_STATE", "a folder that user 10001 can write, for wheel diameters (a volume)", _keeps(services)),
        ("MILEPOST_RECORDINGS", "one for recordings (a volume)", beside.record),
        ("MILEPOST_FEED_PORT", f"the feed's port on this machine ({feed_command.DEFAULT_PORT})", beside.feed),
        ("MILEPOST_PAGE_PORT", f"the dispatch page's ({page_command.DEFAULT_PORT})", beside.page),
        ("MILEPOST_SERIAL_GROUP", "the group that may open serial devices (20)", any("devices" in s.fields for s in services)),
        ("MILEPOST_BASE_IMAGE", "the image to build on (python:3.11-slim)", buildable),
        ("MILEPOST_BUILD_NETWORK", "the network that the build's pip uses (default)", buildable),
    ]
    yield from (f"#   {name:<23} {meaning}" for name, meaning, there in rows if there)


def _keeps(services: Sequence[Service]) -> bool:
    return any(KEPT in each.extra_volumes for each in services)


def _volumes(services: Sequence[Service]) -> Iterator[str]:
    named = {"learned": _keeps(services), "recordings": any(each.name == "recorder" for each in services)}
    if any(named.values()):
        yield "\n# from one `up` to the next\nvolumes:"
        yield from (f"  {name}:" for name, there in named.items() if there)


def compose(train_file: Path, given: str, beside: Beside, secure: bool = False) -> tuple[str, list[Path]]:
    """The compose file of a train, and the files that its containers cannot read. Raises ConfigError.

    `secure`: instead of it the file that is laid over it and gives each container its certificate.
    """
    train = load_train(train_file)
    files = train_files(train)
    if secure:
        return secure_text(train, _services(train, files, beside), given, beside.options), []
    return compose_text(train, files, beside, given), unreadable(files)
