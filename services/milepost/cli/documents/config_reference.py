"""docs/reference-configuration.md: every key of every configuration file with unit, range, default and meaning."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from milepost.config.ranges import range_of
from milepost.estimation.filters import FILTERS
from milepost.evaluation.scores import SCORES
from milepost.sensors import SENSORS
from milepost.sensors.base import SensorOptions
from milepost.simulation.faults import FAULTS

from .config_models import FILES, inside, keys_of, meaning, models
from .config_schemas import FILTER, Schema, config_schema, of_options

# the end of a key's name, longest first
UNITS = {
    "mps2_rthz": "m/s²/√Hz",
    "radps_rthz": "rad/s/√Hz",
    "rad_per_mps2": "rad s²/m",
    "m2ps5": "m²/s⁵",
    "m2ps2": "m²/s²",
    "per_hour": "1/h",
    "mps3": "m/s³",
    "mps2": "m/s²",
    "kmh": "km/h",
    "mps": "m/s",
    "deg": "°",
    "hz": "Hz",
    "ms": "ms",
    "m": "m",
    "s": "s",
}
HEAD = """\
# Every key of the configuration files

Made by `milepost schema` from the models that check the files. The JSON Schemas in `schemas/config` say the same to editors:
`# yaml-language-server: $schema=PATH` in the first line of a file turns completion and checks on. Unknown keys are refused.
Paths are meant from the folder of the file that names them.
"""
COLUMNS = "| key | values | unit | default | meaning |\n| --- | --- | --- | --- | --- |\n"


def config_reference() -> str:
    """The whole document."""
    parts = [HEAD]
    for kind, model in FILES.items():
        parts.append(f"## {kind.capitalize()} files\n\n{_about(model)}\n")
        parts += _sections(model, config_schema(kind), "")
        if kind == "train":
            parts += _units()
        if kind == "scenario":
            parts += [_faults(), _scores()]
    return "\n".join(parts)


def _about(model: type) -> str:
    # what stands below the first line names keys, and these have rows of their own
    return (inspect.getdoc(model) or "").split("\n\n")[0].replace("\n", " ")


def _sections(model: type[BaseModel], schema: Schema, place: str) -> Iterator[str]:
    """A table for a model, then one for each model in it; each model once."""
    left, done = [(model, place)], set[type]()
    while left:
        model, place = left.pop(0)
        if model in done:
            continue
        done.add(model)
        body = schema.get("$defs", {}).get(model.__name__, schema)
        if place:
            yield f"### `{place}`: {model.__name__.removesuffix('File').removesuffix('Options')}\n\n{_about(model)}\n"
        yield COLUMNS + "".join(_row(model, key, body) for key in keys_of(model))
        fields = model.model_fields.items()
        left += [(part, f"{place}.{key}".lstrip(".")) for key, field in fields for part in inside(field.annotation)]


def _row(model: type, key: str, body: Schema) -> str:
    field = body["properties"][key]
    default = "required" if key in body.get("required", []) else _default(model, key, field)
    return cells(f"`{key}`", values_in_words(field), _unit(key), default, meaning(model, key))


def cells(*texts: str) -> str:
    """A row of a table."""
    return f"| {' | '.join(text.replace('|', chr(92) + '|') for text in texts)} |\n"


def _default(model: type, key: str, field: Schema) -> str:
    value = field.get("default")
    if "default" not in field and isinstance(model, type) and issubclass(model, BaseModel):
        value = model.model_fields[key].get_default(call_default_factory=True)
        # a model in the place of a mapping: its own defaults have rows of their own
        return f"`{_shown(value)}`" if isinstance(value, list | dict) else "defaults"
    return "absent" if value is None else f"`{_shown(value)}`"


def _shown(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _unit(key: str) -> str:
    return next((unit for end, unit in UNITS.items() if key == end or key.endswith(f"_{end}")), "")


def values_in_words(field: Schema) -> str:
    """What a key may hold, in a few words."""
    if field.get("$ref") == FILTER:
        return "name, mapping or `null`"
    if "const" in field:
        return f"`{field['const']}`"
    if "enum" in field:
        return ", ".join(f"`{_shown(value).strip(chr(34))}`" for value in field["enum"])
    if "$ref" in field or field.get("type") == "object":
        return "mapping"
    alternatives: list[Schema] = field.get("anyOf") or field.get("oneOf") or []
    options = [each for each in alternatives if each.get("type") != "null"]
    if options:
        return " or ".join(dict.fromkeys(values_in_words(each) for each in options))
    limits = range_of(field)
    word = {"number": "number", "integer": "whole number", "boolean": "`true`, `false`", "array": "list"}.get(
        field.get("type", ""), "path" if field.get("format") == "path" else "text"
    )
    return f"{word} {limits}".strip()


def _units() -> Iterator[str]:
    """What every kind of unit has, then each kind's own, and the filters."""
    by_name = {model.__name__: model for model in models()}
    schema = config_schema("train")["$defs"]
    first = next(iter(SENSORS))
    common = "".join(_row(SensorOptions, key, schema[f"unit_{first}"]) for key in keys_of(SensorOptions) if key != "kind")
    kinds = ", ".join(f"`{kind}`" for kind in SENSORS)
    kind_row = f"| `kind` | {kinds} | | required | {meaning(SensorOptions, 'kind')} |\n"
    yield f"### `units.NAME`: every kind of unit\n\n{COLUMNS}{kind_row}{common}"
    for kind, sensor in SENSORS.items():
        options, body = sensor.options_model, schema[f"unit_{kind}"]
        own = [key for key in keys_of(options) if key not in SensorOptions.model_fields or key in options.__annotations__]
        rows = "".join(_row(options, key, body) for key in own)
        yield f"### `units.NAME` of kind `{kind}`\n\n{COLUMNS}{rows}"
        for key in own:
            for part in inside(options.model_fields[key].annotation):
                yield from _nested(part, key, schema, by_name)
    for kind, row in FILTERS.items():
        body = of_options(row.options_model)
        rows = "".join(_row(row.options_model, key, body) for key in keys_of(row.options_model))
        yield f"### `units.NAME.filter` of kind `{kind}`\n\n{COLUMNS + rows if rows else 'It has no options.'}\n"


def _nested(model: type[BaseModel], place: str, schema: Schema, by_name: dict[str, type]) -> Iterator[str]:
    if model.__name__ == "RecordingOptions" and place != "recording":
        return
    rows = "".join(_row(model, key, schema[model.__name__]) for key in keys_of(by_name[model.__name__]))
    yield f"#### `{place}`\n\n{_about(model)}\n\n{COLUMNS}{rows}"
    for key, field in model.model_fields.items():
        for part in inside(field.annotation):
            yield from _nested(part, f"{place}.{key}", schema, by_name)


def _faults() -> str:
    """The options of the kinds of fault, which stand beside `unit`, `kind`, `from_s` and `for_s`."""
    rows = ""
    for kind, row in FAULTS.items():
        for key, field in row.options.model_json_schema().get("properties", {}).items():
            needed = row.options.model_fields[key].is_required()
            default = "required" if needed else _default(row.options, key, field)
            rows += f"| `{kind}`: `{key}` | {values_in_words(field)} | {_unit(key)} | {default} | {field['description']} |\n"
    return f"### `faults`: options of each kind\n\n{COLUMNS}{rows}"


def _scores() -> str:
    """The options of the rows of the table of scores."""
    rows = ""
    for name, score in SCORES.items():
        body = score.options.model_json_schema()
        rows += "".join(_row(score.options, key, body).replace("| `", f"| `{name}`: `", 1) for key in keys_of(score.options))
    names = ", ".join(f"`{name}`" for name in SCORES)
    return f"### `scores`: options of each row\n\nThe rows: {names}.\n\n{COLUMNS}{rows}"
