"""The model of campaign files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, model_validator

from milepost.config.shipped_files import named_in_file
from milepost.config.train_file import Positive
from milepost.config.yaml_files import read_yaml, validate
from milepost.recordings.options import STRICT
from milepost_schemas.message import Name

Stream = Literal["speed_reading", "position_reading", "inertial_reading", "balise_telegram"]
Seconds = Annotated[float, Field(ge=0.0)]


class TrainEntry(BaseModel):
    """A train of a campaign: the name or the file of a train, changes to it, the length of a run and the onset of the faults.

    `train` is a name, or a path relative to the campaign file. `onset_spread_s`: each fault begins at a time drawn between
    `onset_s` and so much later.
    """

    model_config = STRICT
    train: str
    duration_s: Positive
    onset_s: Seconds = 0.0
    onset_spread_s: Seconds = 0.0
    change: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _onset_within(self) -> TrainEntry:
        if self.onset_s + self.onset_spread_s >= self.duration_s:
            raise ValueError("onset_s and onset_spread_s must leave time for the faults before duration_s")
        return self

    def file(self, folder: Path) -> Path:
        """The train file, given the campaign file's folder. Raises ConfigError."""
        return named_in_file(self.train, folder, "trains")


class FaultRow(BaseModel):
    """A fault of a campaign: a kind of fault with its options and label, and the units that have it, one after another.

    Without `streams`, `sensors` (kinds of sensor) and `units` these are all units that the kind fits. `trains`: only these
    entries. `for_s`: how long it lasts; to the end of the run by default.
    """

    model_config = STRICT
    label: str
    kind: str
    options: dict[str, Any] = Field(default_factory=dict)
    streams: list[Stream] = Field(default_factory=list)
    sensors: list[str] = Field(default_factory=list)
    units: list[Name] = Field(default_factory=list)
    trains: list[Name] = Field(default_factory=list)
    for_s: Positive | None = None

    def selects(self, train: str, unit: str, stream: str, sensor: str) -> bool:
        """Whether the row asks for this unit, if the kind fits it."""
        if self.trains and train not in self.trains:
            return False
        everything = not (self.streams or self.sensors or self.units)
        return everything or stream in self.streams or sensor in self.sensors or unit in self.units


class CampaignFile(BaseModel):
    """A campaign: trains and faults; a cell for every train, fault and unit, and a run of it for each of `runs` seeds.

    With `pairs` a cell is a pair of units, and each run draws a fault for both. Without faults a cell is a train.
    """

    model_config = STRICT
    campaign: Name
    about: str = ""
    trains: Annotated[dict[Name, TrainEntry], Field(min_length=1)]
    faults: list[FaultRow] = Field(default_factory=list)
    pairs: bool = False
    draws: Annotated[int, Field(ge=1)] | None = None
    runs: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0)] = 1

    @model_validator(mode="after")
    def _consistent(self) -> CampaignFile:
        if self.pairs and not self.faults:
            raise ValueError("pairs: true requires faults to draw from")
        if self.draws is not None and not self.pairs:
            raise ValueError("draws requires pairs: true")
        if self.pairs and self.runs is not None:
            raise ValueError("runs: with pairs: true, draws says how many runs a pair has")
        return self

    @property
    def runs_per_cell(self) -> int:
        """The number of runs of a cell: draws of a pair, or seeds."""
        return self.draws or self.runs or 1


def load_campaign(path: Path) -> CampaignFile:
    """A campaign file. Raises ConfigError."""
    return validate(path, read_yaml(path), CampaignFile)
