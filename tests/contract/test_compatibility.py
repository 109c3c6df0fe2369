"""docs/compatibility.md holds: what version 1 was when it was frozen is still there, under the same names."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from milepost_schemas import BY_NAME
from milepost_schemas.documents import json_schema, schema_names

FROZEN = Path(__file__).parent / "frozen-v1"
SCHEMAS = {path.name.removesuffix(".schema.json"): json.loads(path.read_text()) for path in FROZEN.glob("*.schema.json")}
ROWS = json.loads((FROZEN / "streams.json").read_text(encoding="utf-8"))
Schema = dict[str, Any]
LOWER, UPPER = ("minimum", "exclusiveMinimum", "minItems"), ("maximum", "exclusiveMaximum", "maxItems")


def broken(before: Schema, now: Schema) -> Iterator[str]:
    """What version 1 promised and a newer schema does not keep."""
    yield from _object(before, now, before, now, "")


def _object(before: Schema, now: Schema, old: Schema, new: Schema, place: str) -> Iterator[str]:
    for name, field in before.get("properties", {}).items():
        where = f"{place}.{name}".lstrip(".")
        if name not in now.get("properties", {}):
            yield f"{where}: has vanished"
        else:
            yield from _value(field, now["properties"][name], old, new, where)
    required, needed = set(before.get("required", ())), set(now.get("required", ()))
    yield from (f"{place}.{name}".lstrip(".") + ": has become required" for name in sorted(needed - required))
    known = set(before.get("properties", {}))
    yield from (f"{place}.{name}".lstrip(".") + ": is no longer required" for name in sorted((required - needed) & known))


def _value(before: Schema, now: Schema, old: Schema, new: Schema, where: str) -> Iterator[str]:
    before, now = _followed(before, old), _followed(now, new)
    if {before.get("type"), *map(_kind, before.get("anyOf", ()))} != {now.get("type"), *map(_kind, now.get("anyOf", ()))}:
        yield f"{where}: has another type"
        return
    yield from (f"{where}: {value!r} is no longer allowed" for value in before.get("enum", ()) if value not in now["enum"])
    for names, narrower in ((LOWER, lambda a, b: b > a), (UPPER, lambda a, b: b < a)):
        for name in names:
            if name in now and (name not in before or narrower(before[name], now[name])):
                yield f"{where}: {name} is narrower"
    if before.get("pattern") != now.get("pattern"):
        yield f"{where}: has another pattern"
    for name in ("items", "additionalProperties"):
        if isinstance(before.get(name), dict):
            yield from _value(before[name], now[name], old, new, f"{where}[]")
    for one, other in zip(before.get("anyOf", ()), now.get("anyOf", ()), strict=True):
        yield from _value(one, other, old, new, where)
    if "properties" in before:
        yield from _object(before, now, old, new, where)


def _kind(schema: Schema) -> str:
    return str(schema.get("type") or schema.get("$ref"))


def _followed(schema: Schema, whole: Schema) -> Schema:
    return whole["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema


@pytest.mark.parametrize("name", sorted(SCHEMAS))
def test_a_message_of_version_1_keeps_what_it_promised(name: str) -> None:
    assert name in schema_names(), "the message has vanished"
    assert list(broken(SCHEMAS[name], json_schema(name))) == []


@pytest.mark.parametrize("name", sorted(ROWS))
def test_a_stream_of_version_1_keeps_its_key_and_encoding(name: str) -> None:
    assert {"key": BY_NAME[name].key, "encoding": BY_NAME[name].message.encoding()} == ROWS[name]


def changed(**change: Any) -> Schema:
    """The state's schema after a change to the field `epoch`, or without it."""
    schema = copy.deepcopy(SCHEMAS["state-1"])
    schema["properties"]["epoch"] |= change
    return schema


def without(*path: str) -> Schema:
    schema = copy.deepcopy(SCHEMAS["state-1"])
    inner = schema
    for name in path[:-1]:
        inner = inner[name]
    del inner[path[-1]]
    return schema


def required(*names: str) -> Schema:
    schema = copy.deepcopy(SCHEMAS["state-1"])
    schema["required"] = [*schema["required"], *names]
    return schema


def added() -> Schema:
    schema = changed()
    schema["properties"]["added_later"] = {"type": "number"}
    schema["properties"]["status"]["enum"] = [*schema["properties"]["status"]["enum"], "parked"]
    return schema


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (changed(), []),
        (added(), []),
        (without("properties", "epoch"), ["epoch: has vanished"]),
        (without("$defs", "SensorInUse", "properties", "share"), ["sensors[].share: has vanished"]),
        (changed(type="number"), ["epoch: has another type"]),
        (changed(minimum=5), ["epoch: minimum is narrower"]),
        (changed(maximum=5), ["epoch: maximum is narrower"]),
        (required("settled"), ["settled: has become required"]),
    ],
    ids=["the same", "added", "field", "inner field", "type", "minimum", "maximum", "required"],
)
def test_a_broken_promise_is_found_and_an_addition_is_none(now: Schema, said: list[str]) -> None:
    assert list(broken(SCHEMAS["state-1"], now)) == said
