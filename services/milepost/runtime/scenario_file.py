"""What a scenario file may say."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from milepost.sensors.base import DataPath
from milepost_schemas.message import Name

from .lines import STRICT
from .train_file import Positive


class WithheldFile(BaseModel):
    """Readings of a unit that the filters do not get and that the result is compared with afterwards."""

    model_config = STRICT
    unit: Name
    from_s: float
    to_s: float


class ScenarioFile(BaseModel):
    """An evaluation: a train, changes to its file, how long, and what to compare."""

    model_config = STRICT
    scenario: Name
    train: DataPath
    duration_s: Positive
    seed: Annotated[int, Field(ge=0)] = 1
    change: dict[str, Any] = Field(default_factory=dict)
    alone: list[Name] = Field(default_factory=list)
    speed_after_s: Annotated[float, Field(ge=0.0)] = 0.0
    withheld: WithheldFile | None = None
