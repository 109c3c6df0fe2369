"""The file that gives each container of a train its certificate, to be laid over the train's compose file."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from milepost.config.train import Train
from milepost.security.access import DISPATCH, ROUTERS

from .services import Service

SKELETON = Path(__file__).with_name("secure.yaml")
# where a container has its own certificate, and that of a tool that only reads
OWN, READER = "/run/milepost", "/run/dispatch"


def secure_text(train: Train, services: Sequence[Service], given: str, options: Sequence[str]) -> str:
    """The overlay of these services and the routers. `given`: how the command line named the train."""
    likes = {**dict.fromkeys(ROUTERS, "router"), **{each.name: each.like for each in services}}
    # for a shell, in comments
    opened = shlex.join(["milepost", "compose", given, *options])
    parts = {
        "train": train.name,
        "command": f"{opened} --secure",
        "open_command": opened,
        "given": shlex.quote(given),
        "services": "\n\n".join("\n".join(_lines(name, like)) for name, like in likes.items()),
    }
    text = SKELETON.read_text(encoding="utf-8")
    for name, value in parts.items():
        text = text.replace(f"<{name}>", value)
    return text


def _lines(name: str, like: str) -> Iterator[str]:
    """Routers and who speaks look at their own health as a tool that only reads."""
    looks = like in ("router", "speaker")
    yield f"  {name}:"
    yield f"    <<: *{like}" if looks else "    environment: *environment"
    volumes = [_mount(name, OWN), *([_mount(DISPATCH, READER)] if looks else [])]
    yield f"    volumes: [{', '.join(volumes)}]"


def _mount(name: str, target: str) -> str:
    return f'"${{MILEPOST_PKI:-./pki}}/{name}:{target}:ro"'
