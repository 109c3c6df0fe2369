"""JSON Schemas of the configuration files: the models', with the options of every kind of sensor, filter and fault in place."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, TypeAdapter
from pydantic.dataclasses import dataclass as pydantic_dataclass

from milepost.estimation.filters import FILTERS
from milepost.sensors import SENSORS
from milepost.simulation.faults import FAULTS
from milepost_schemas.documents import DRAFT

from .config_models import FILES, meaning, models

Schema = dict[str, Any]
DEFINITION = "#/$defs/{model}"
FILTER = DEFINITION.format(model="filter")
# a log may also be a bare path, which the model completes before it checks it
BARE_PATHS = {("RecordedFile", "gnss_log"), ("GnssOptions", "recording")}


def config_schema(kind: str) -> Schema:
    """The JSON Schema of a kind of file: `train`, `line`, `fleet`, `scenario` or `campaign`."""
    body = _of_model(FILES[kind])
    if kind == "train":
        _with_kinds_of_sensors(body)
    if "FaultEntry" in body.get("$defs", {}):
        _with_kinds_of_faults(body["$defs"]["FaultEntry"])
    return {"$schema": DRAFT, "$id": f"urn:milepost:config:{kind}", **body}


def _of_model(model: type[BaseModel]) -> Schema:
    body = model.model_json_schema(ref_template=DEFINITION)
    by_name: dict[str, type] = {each.__name__: each for each in models()}
    for name, part in [(model.__name__, body), *body.get("$defs", {}).items()]:
        for key, field in part.get("properties", {}).items():
            if (name, key) in BARE_PATHS:
                part["properties"][key] = field = {"anyOf": [{"type": "string"}, dict(field)]}
            field["description"] = meaning(by_name[name], key)
    return body


def _with_kinds_of_sensors(body: Schema) -> None:
    """A unit is of one kind, and has the options of that one."""
    units = []
    body["$defs"]["filter"] = _filters()
    for kind, sensor in SENSORS.items():
        options = _of_model(sensor.options_model)
        body["$defs"].update(options.pop("$defs", {}))
        options["properties"]["kind"] |= {"const": kind}
        if sensor.options_model.model_fields["filter"].annotation is not type(None):
            described = options["properties"]["filter"]["description"]
            options["properties"]["filter"] = {"$ref": FILTER, "default": "kalman", "description": described}
        body["$defs"][f"unit_{kind}"] = options
        units.append({"$ref": DEFINITION.format(model=f"unit_{kind}")})
    named = body["properties"]["units"]["patternProperties"]
    body["properties"]["units"]["patternProperties"] = {key: {"oneOf": units} for key in named}
    body["properties"]["units"]["additionalProperties"] = False


def _filters() -> Schema:
    """A filter by its kind alone, by its kind and options, or none."""
    with_options = []
    for kind, row in FILTERS.items():
        options = of_options(row.options_model)
        with_options.append({**options, "properties": {"kind": {"const": kind}, **options.get("properties", {})}})
    return {"anyOf": [{"enum": [*FILTERS, None]}, {"oneOf": with_options}]}


def of_options(model: type) -> Schema:
    """As `validate_dataclass` checks them."""
    checked: Any = pydantic_dataclass(model, frozen=True, config=ConfigDict(strict=True, extra="forbid"))
    body = TypeAdapter(checked).json_schema()
    for key, field in body.get("properties", {}).items():
        field["description"] = meaning(model, key)
    return {**body, "additionalProperties": False, "required": ["kind", *body.get("required", [])]}


def _with_kinds_of_faults(entry: Schema) -> None:
    entry["properties"]["kind"]["enum"] = list(FAULTS)
    entry["allOf"] = []
    for kind, row in FAULTS.items():
        options = row.options.model_json_schema() if row.options.model_fields else {}
        then = {key: options[key] for key in ("properties", "required") if key in options}
        entry["allOf"].append({"if": {"properties": {"kind": {"const": kind}}}, "then": then})
    del entry["additionalProperties"]
    entry["unevaluatedProperties"] = False
