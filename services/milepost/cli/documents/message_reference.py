"""docs/reference-messages.md: every stream with its key, pace and message, and every field of every message."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

from milepost_schemas import ROOT, STREAMS, Stream
from milepost_schemas.documents import json_schema, schema_name, schema_names
from milepost_schemas.message import Message

from .config_reference import cells, values_in_words

PACES = {
    "unit": "the unit's, from the train file",
    "epoch": "each epoch (`fusion.period_ms`)",
    "feedback": "every so many epochs (`fusion.feedback_every`)",
    "second": "once a second",
    "event": "when it happens",
}
HEAD = f"""\
# Every message

Made by `milepost schema` from the table of streams and the models of the messages. Keys are below `{ROOT}/{{train}}/`;
payloads are msgpack maps, and the Zenoh encoding names the schema. `schemas/json` has the same as JSON Schemas,
`schemas/asyncapi.json` as one AsyncAPI 3 document. A receiver ignores what it does not know:
[what stays the same](compatibility.md).

"""
COMMON = """\
## What every message has

"""
STREAM_COLUMNS = f"| key | message | when | priority | kept | recorded | content |\n|{' --- |' * 7}\n"
AFTER_STREAMS = """
`kept`: so many messages a publisher remembers for a subscriber that was cut off. `recorded`: whether a recorder writes it.

"""
# what msgpack can carry is no limit that anybody meets
LARGEST = 2**63
FIELD_COLUMNS = "| field | values | required | meaning |\n| --- | --- | --- | --- |\n"


def message_reference() -> str:
    """The whole document."""
    common = json_schema(schema_name(STREAMS[0].message))
    shared = {name: common["properties"][name] for name in Message.model_fields}
    parts = [HEAD, STREAM_COLUMNS, *(_stream(row) for row in STREAMS), AFTER_STREAMS]
    parts += [COMMON, FIELD_COLUMNS, *(_field(name, body, common) for name, body in shared.items())]
    parts += _messages(set(shared))
    return "".join(parts)


def _stream(row: Stream) -> str:
    name = schema_name(row.message)
    link = f"[`{name.replace('-', '/')}`](#{name})"
    kept = str(row.cached or "")
    recorded = "yes" if row.recorded else "no"
    return cells(f"`{row.key}`", link, PACES[row.paced_by], row.priority.replace("_", " "), kept, recorded, row.purpose)


def _messages(shared: set[str]) -> Iterator[str]:
    """A section for each message, then one for each part that messages have in common."""
    parts: dict[str, dict[str, Any]] = {}
    for name, model in schema_names().items():
        schema = json_schema(name)
        yield _section(name, inspect.getdoc(model) or "", schema, shared if issubclass(model, Message) else set())
        parts |= {title: part for title, part in schema.get("$defs", {}).items() if title not in _titles()}
    for title, part in parts.items():
        if "properties" in part:
            yield _section(title, part.get("description", ""), part, set())


def _titles() -> set[str]:
    """Models that are messages themselves, and have a section already."""
    return {model.__name__ for model in schema_names().values()}


def _section(name: str, about: str, schema: dict[str, Any], without: set[str]) -> str:
    rows = [_field(key, body, schema) for key, body in schema["properties"].items() if key not in without]
    return f"\n## {name}\n\n{about.strip()}\n\n{FIELD_COLUMNS}{''.join(rows)}"


def _field(name: str, body: dict[str, Any], schema: dict[str, Any]) -> str:
    required = "yes" if name in schema.get("required", ()) else ""
    return cells(f"`{name}`", _words(body), required, body.get("description", ""))


def _words(body: dict[str, Any]) -> str:
    """What a field may hold; of parts their name, of lists what is in them."""
    if "$ref" in body:
        return _part(body)
    if "anyOf" in body:
        return " or ".join(_words(each) for each in body["anyOf"] if each.get("type") != "null")
    if body.get("type") == "array":
        return f"list{_length(body)} of {_words(body['items'])}"
    if body.get("type") == "object":
        inside = next(iter(body.get("patternProperties", {}).values()), body.get("additionalProperties"))
        return f"mapping of {_words(inside)}" if isinstance(inside, dict) else "mapping"
    return values_in_words({key: value for key, value in body.items() if value != LARGEST})


def _length(body: dict[str, Any]) -> str:
    return f" of {body['minItems']}:" if body.get("minItems") == body.get("maxItems", -1) else ""


def _part(body: dict[str, Any]) -> str:
    title = body["$ref"].removeprefix("#/$defs/")
    name = next((name for name, model in schema_names().items() if model.__name__ == title), title)
    return f"[{name}](#{name.lower()})"
