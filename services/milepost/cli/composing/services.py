"""The services of a train's compose file: what each adds to what all have, which is in skeleton.yaml."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

from milepost.config.roles import ROLES, Process, processes
from milepost.config.train import Train
from milepost.sensors.base import Sensor

STATE_DIR = "/var/lib/milepost"
KEPT = f"${{MILEPOST_STATE:-learned}}:{STATE_DIR}"
RECORDINGS = f"{STATE_DIR}/recordings"
PLAIN = re.compile(r"(-{0,2}|\.?/)[a-z][a-z0-9_./-]*")
# words that YAML takes for something else
NO_TEXT = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}


@dataclass(frozen=True)
class Service:
    """A container: its name, the anchor that it is like, its command, and what else is its own.

    `extra_volumes` besides the train's files; `fields` are lines of YAML.
    """

    name: str
    like: str
    command: Sequence[str]
    extra_volumes: Sequence[str] = ()
    fields: Mapping[str, str] = field(default_factory=dict)

    def lines(self, files: Sequence[str]) -> Iterator[str]:
        """Its lines; `files` are the anchors of the train's files."""
        yield f"  {self.name}:"
        yield f"    <<: *{self.like}"
        yield f"    command: {flow(self.command)}"
        if self.extra_volumes:
            yield f"    volumes: [{', '.join([*(f'*{each}' for each in files), *map(word, self.extra_volumes)])}]"
        yield from (f"    {key}: {value}" for key, value in self.fields.items())


def word(text: str) -> str:
    """A text in YAML."""
    return text if PLAIN.fullmatch(text) and text not in NO_TEXT else json.dumps(text, ensure_ascii=False)


def literal(text: str) -> str:
    """A text in YAML that is not to have variables of the environment put in."""
    return word(text.replace("$", "$$"))


def flow(words: Sequence[str]) -> str:
    """A list in YAML, on one line."""
    return f"[{', '.join(map(word, words))}]"


def train_services(train: Train, recorded: bool) -> Iterator[Service]:
    """A service for each process of the train besides the routers, in the order of the role table."""
    for process in processes(train, live=True):
        unit = [] if process.unit == process.role else [process.unit]
        waits = ["--await", "recorder"] if process.role == "world" and recorded else []
        keeps = process.role == "filter" and keeps_calibration(train, process.unit)
        command = ["run", process.role, *unit, *waits, *(["--state-dir", STATE_DIR] if keeps else [])]
        speaks = "state" in ROLES[process.role].sends(train, process.unit)
        fields = _device(train, process)
        yield Service(process.name, "speaker" if speaks else "process", command, [KEPT] if keeps else [], fields)


def keeps_calibration(train: Train, unit: str) -> bool:
    """Whether a unit's filter has something to keep from one run to the next."""
    kind: type[Sensor[Any]] = type(train.sensors[unit])
    return train.file.fusion.feedback and kind.snapshot is not Sensor.snapshot


def _device(train: Train, process: Process) -> dict[str, str]:
    """The serial device of a sensor's receiver, which a group of this machine may open."""
    receiver = getattr(train.sensors[process.unit].options, "receiver", None) if process.role == "sensor" else None
    device = getattr(receiver, "serial", None)
    if device is None:
        return {}
    return {"devices": f"[{literal(f'{device}:{device}')}]", "group_add": '["${MILEPOST_SERIAL_GROUP:-20}"]'}


def recorder_service() -> Service:
    """The recorder, whose recordings are all that it can write."""
    volume = f"${{MILEPOST_RECORDINGS:-recordings}}:{RECORDINGS}"
    return Service("recorder", "process", ["run", "recorder", "--record", RECORDINGS], [volume])


def web_service(name: str, port: int, line: PurePosixPath) -> Service:
    """A web server, reachable from this machine only; `line` is the train's line file in the container."""
    published = f"127.0.0.1:${{MILEPOST_{name.upper()}_PORT:-{port}}}"
    command = [name, "--host", "0.0.0.0", "--port", str(port), "--line", str(line), "--url", f"http://{published}"]
    asks = f"import urllib.request; urllib.request.urlopen('http://127.0.0.1:{port}/', timeout=4)"
    check = f"{{<<: *healthcheck, test: [CMD, python3, -c, {json.dumps(asks)}], interval: 30s}}"
    return Service(name, "process", command, (), {"ports": f"[{json.dumps(f'{published}:{port}')}]", "healthcheck": check})
