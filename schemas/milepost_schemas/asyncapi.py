"""The stream table as an AsyncAPI 3 document, seen from a train: what it sends, and what it takes from others."""

from __future__ import annotations

import inspect
from typing import Any

from .documents import schema_names
from .message import Part
from .streams import ROOT, STREAMS, Stream, alive_key, simulation_start_key

FORMAT = "application/schema+json;version=draft-2020-12"
# what others may send to a train: readings of devices of their own, and faults where the train file allows them
TAKEN = ("reading/{unit}", "@chaos/{unit}")
# of the contract, not of the software: it is that of the keys
VERSION = ROOT.rpartition("/v")[2]
START, ALIVE = "simulationStart", "alive"
PARAMETERS = {
    "train": "name of the train, `[a-z0-9][a-z0-9_.-]{0,62}`",
    "unit": "a unit of the train file, or a process such as `fuser` or `sensor-radar`",
    "instance": "which run of the process",
}
ABOUT = f"""\
Keys are Zenoh keys below `{ROOT}/{{train}}/`; payloads are msgpack maps of the fields, and the Zenoh encoding names the schema:
`application/msgpack;state/1`. Unknown fields are ignored. Keys with a chunk that begins with `@` are not matched by `**`.
`x-paced-by` says what sets the rate of a stream, `x-cached` how many messages its publishers remember for late subscribers,
`x-largest-bytes` what a router lets pass."""


def asyncapi() -> dict[str, Any]:
    """The whole document; message schemas are the files in `json` beside it."""
    rows: dict[str, list[Stream]] = {}
    for row in STREAMS:
        rows.setdefault(row.key, []).append(row)
    channels = {_channel(key): _described(key, rows[key]) for key in rows}
    channels[START] = _start_channel()
    channels[ALIVE] = _alive_channel()
    operations: dict[str, Any] = {}
    for key, those in rows.items():
        if key != "@chaos/{unit}":
            operations[f"send{_capital(_channel(key))}"] = _operation("send", _channel(key), those)
        if key in TAKEN:
            operations[f"receive{_capital(_channel(key))}"] = _operation("receive", _channel(key), those)
    operations["answerStart"] = _answer()
    return {
        "asyncapi": "3.0.0",
        "id": f"urn:{ROOT.replace('/', ':')}",
        "info": {
            "title": "Milepost",
            "version": VERSION,
            "description": ABOUT,
            "license": {"name": "Apache-2.0", "url": "https://www.apache.org/licenses/LICENSE-2.0"},
        },
        "defaultContentType": "application/msgpack",
        "servers": {"router": {"host": "127.0.0.1:7447", "protocol": "zenoh", "description": "the router of `milepost up`"}},
        "channels": channels,
        "operations": operations,
        "components": {"messages": {_schema_of(name): _message(name) for name in schema_names()}},
    }


def _channel(key: str) -> str:
    return key.split("/")[0].lstrip("@") if key != "@sim/truth" else "truth"


def _capital(word: str) -> str:
    return word[0].upper() + word[1:]


def _described(key: str, rows: list[Stream]) -> dict[str, Any]:
    purposes = dict.fromkeys(row.purpose for row in rows)
    return {
        "address": f"{ROOT}/{{train}}/{key}",
        "description": "; ".join(purposes),
        "parameters": {name: {"description": text} for name, text in PARAMETERS.items() if f"{{{name}}}" in f"{{train}}{key}"},
        "messages": {row.message.SCHEMA: _to(f"components/messages/{row.message.SCHEMA}") for row in rows},
        "x-paced-by": rows[0].paced_by if len({row.paced_by for row in rows}) == 1 else "unit",
        "x-priority": rows[0].priority,
        "x-cached": max(row.cached for row in rows),
        "x-largest-bytes": max(row.largest_bytes for row in rows),
    }


def _start_channel() -> dict[str, Any]:
    return {
        "address": simulation_start_key("{train}"),
        "description": "a query, not a subscription: the process `world` of a simulated train answers when scenario time began",
        "parameters": {"train": {"description": PARAMETERS["train"]}},
        "messages": {
            "question": {"summary": "an empty Zenoh query", "payload": {"type": "null"}},
            "simulation_start": _to("components/messages/simulation_start"),
        },
    }


def _alive_channel() -> dict[str, Any]:
    address = alive_key("{train}", "{unit}", "{instance}")
    text = "Zenoh liveliness tokens: each process shows one as long as it lives; no messages travel here"
    parameters = {name: {"description": about} for name, about in PARAMETERS.items()}
    return {"address": address, "description": text, "parameters": parameters}


def _operation(action: str, channel: str, rows: list[Stream]) -> dict[str, Any]:
    messages = [_to(f"channels/{channel}/messages/{row.message.SCHEMA}") for row in rows]
    return {"action": action, "channel": _to(f"channels/{channel}"), "messages": messages}


def _answer() -> dict[str, Any]:
    channel = _to(f"channels/{START}")
    asked, answered = (_to(f"channels/{START}/messages/{name}") for name in ("question", "simulation_start"))
    reply = {"channel": channel, "messages": [answered]}
    return {"action": "receive", "channel": channel, "messages": [asked], "reply": reply}


def _message(name: str) -> dict[str, Any]:
    model: type[Part] = schema_names()[name]
    first, *_ = (inspect.getdoc(model) or "").splitlines()
    encoding = getattr(model, "encoding", None)
    return {
        "name": _schema_of(name),
        "title": model.__name__,
        "summary": first,
        "contentType": "application/msgpack" if encoding is None else encoding(),
        "payload": {"schemaFormat": FORMAT, "schema": _to_file(f"./json/{name}.schema.json")},
    }


def _schema_of(name: str) -> str:
    return name.rpartition("-")[0]


def _to(place: str) -> dict[str, str]:
    return {"$ref": f"#/{place}"}


def _to_file(path: str) -> dict[str, str]:
    return {"$ref": path}
