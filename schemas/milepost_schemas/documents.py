"""JSON Schemas of the messages, each field with its meaning."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from .meanings import MEANINGS
from .message import Message, Part
from .state import SimulationStart
from .streams import STREAMS

DRAFT = "https://json-schema.org/draft/2020-12/schema"
# what travels as an answer, and so is no stream
ANSWERS: dict[str, type[Part]] = {"simulation_start": SimulationStart}


def schema_name(message: type[Message]) -> str:
    """The name in `schema_names` of a message: `state-1`."""
    return f"{message.SCHEMA}-{message.VERSION}"


def schema_names() -> dict[str, type[Part]]:
    """`state-1` and the like → the model: every message of the stream table, and what is answered."""
    messages = {schema_name(row.message): row.message for row in STREAMS}
    return {**messages, **{f"{name}-1": part for name, part in ANSWERS.items()}}


def json_schema(name: str) -> dict[str, Any]:
    """The JSON Schema of a name in `schema_names`, with `$id` and a description of every field."""
    model = schema_names()[name]
    body = model.model_json_schema()
    _describe(body, meanings_of(model))
    for title, definition in body.get("$defs", {}).items():
        if "properties" in definition:
            _describe(definition, meanings_of(_by_name()[title]))
    return {"$schema": DRAFT, "$id": f"urn:milepost:{name}", **body}


@cache
def json_schema_text(name: str) -> str:
    """The same as the file in `schemas/json` has it."""
    return json_text(json_schema(name))


def json_text(body: Mapping[str, Any]) -> str:
    """A document as it is written to a file."""
    return json.dumps(body, indent=2, ensure_ascii=False) + "\n"


def meanings_of(model: type[Part]) -> dict[str, str]:
    """The meaning of each field of a message or a part of one."""
    head = MEANINGS["Message"] if issubclass(model, Message) else {}
    return {**head, **MEANINGS.get(model.__name__, {})}


def _describe(body: dict[str, Any], meanings: dict[str, str]) -> None:
    for name, field in body["properties"].items():
        field["description"] = meanings.get(name) or field.get("description", "")


def _by_name() -> dict[str, type[Part]]:
    found: dict[str, type[Part]] = {}
    left: list[type[Part]] = [Part]
    while left:
        model = left.pop()
        found[model.__name__] = model
        left += model.__subclasses__()
    return found
