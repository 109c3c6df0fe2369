"""The models behind the keys of configuration files, and what each key means."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel

from milepost.campaign.campaign_file import CampaignFile
from milepost.config.fleet_file import FleetFile
from milepost.config.line_file import LineFile
from milepost.config.scenario_file import ScenarioFile
from milepost.config.train_file import TrainFile
from milepost.estimation.filters import FILTERS
from milepost.evaluation.scores import SCORES
from milepost.sensors import SENSORS

FILES: dict[str, type[BaseModel]] = {
    "train": TrainFile,
    "line": LineFile,
    "fleet": FleetFile,
    "scenario": ScenarioFile,
    "campaign": CampaignFile,
}
LIKE = "like"


@cache
def table() -> dict[str, dict[str, str]]:
    """The table of meanings: model → key → meaning."""
    found: dict[str, dict[str, str]] = yaml.safe_load((Path(__file__).parent / "meanings.yaml").read_text(encoding="utf-8"))
    return found


def meaning(model: type, key: str) -> str:
    """What a key of a model means: by the model itself, what it is like, or what it inherits from; else its own description."""
    for each in model.__mro__:
        rows = table().get(each.__name__, {})
        if key in rows:
            return rows[key]
        if LIKE in rows and key in table()[rows[LIKE]]:
            return table()[rows[LIKE]][key]
    field = model.model_fields[key] if issubclass(model, BaseModel) else None
    return (field.description if field is not None else None) or ""


def keys_of(model: type) -> list[str]:
    """The keys of a model or of a dataclass of options."""
    if is_dataclass(model):
        return [field.name for field in fields(model)]
    return list(model.model_fields) if issubclass(model, BaseModel) else []


def models() -> list[type]:
    """Every model that a configuration file can hold, in the order in which they are met."""
    found: dict[type, None] = {}
    for model in FILES.values():
        _walk(model, found)
    for sensor in SENSORS.values():
        _walk(sensor.options_model, found)
    for row in SCORES.values():
        _walk(row.options, found)
    return [*found, *(row.options_model for row in FILTERS.values())]


def inside(annotation: Any) -> Iterator[type[BaseModel]]:
    """The models anywhere inside an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from inside(part)


def _walk(model: type[BaseModel], found: dict[type, None]) -> None:
    if model in found:
        return
    found[model] = None
    for field in model.model_fields.values():
        for part in inside(field.annotation):
            _walk(part, found)
