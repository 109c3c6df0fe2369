"""The model of train files."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Discriminator, Field, Tag, field_validator, model_validator

from milepost.fusion.hypotheses import MOTION_MODEL
from milepost.fusion.rules import RULES
from milepost.recordings.options import STRICT, DataPath
from milepost_schemas.message import Name, PositionM, SpeedMps

from .etcs_file import EtcsFile
from .mistakes import must_be_one_of
from .world.creep_file import CreepFile
from .world.motion_file import MotionFile

Positive = Annotated[float, Field(gt=0.0)]


class PriorFile(BaseModel):
    """The prior: position, speed and acceleration before the first observation."""

    model_config = STRICT
    position_m: PositionM
    position_std_m: Positive
    speed_mps: SpeedMps
    speed_std_mps: Positive
    acceleration_mps2: float = 0.0
    acceleration_std_mps2: Positive


def _sums_to_one(shares: dict[str, float]) -> dict[str, float]:
    if shares and abs(sum(shares.values()) - 1.0) > 1e-9:
        raise ValueError(f"shares must sum to 1, not {sum(shares.values()):g}")
    return shares


ShareTable = Annotated[dict[Name, Annotated[float, Field(ge=0.0, le=1.0)]], AfterValidator(_sums_to_one)]


class SpeedRowFile(BaseModel):
    """Shares below a speed; without `below_kmh`, above the row before."""

    model_config = STRICT
    below_kmh: Positive | None = None
    shares: ShareTable


class BySpeedFile(BaseModel):
    """Shares by speed; the last row has no upper end."""

    model_config = STRICT
    by_speed: Annotated[list[SpeedRowFile], Field(min_length=1)]

    @model_validator(mode="after")
    def _rising(self) -> BySpeedFile:
        ends = [row.below_kmh for row in self.by_speed]
        if ends[-1] is not None or any(end is None for end in ends[:-1]):
            raise ValueError("by_speed: below_kmh is required in every row but the last")
        if any(b <= a for a, b in pairwise(end for end in ends if end is not None)):
            raise ValueError("by_speed: below_kmh must increase")
        return self


def _kind_of_shares(value: Any) -> str:
    if isinstance(value, dict) and "by_speed" in value:
        return "by_speed"
    return "fixed" if isinstance(value, dict) else "by_accuracy"


Fixed = Annotated[ShareTable, Tag("fixed")]
BySpeed = Annotated[BySpeedFile, Tag("by_speed")]
ByAccuracy = Annotated[Literal["by_accuracy"], Tag("by_accuracy")]
SharesFile = Annotated[Fixed | BySpeed | ByAccuracy, Discriminator(_kind_of_shares)]


class VotingFile(BaseModel):
    """Two out of three: by how much two fusers that agree may differ, and when the voter stops waiting.

    `position_m`, `speed_mps`: of the estimate and its accuracy; `interval_m`, `interval_mps`: of the ends of the intervals;
    `sigmas`: of all else that is fed back, in standard deviations. `deadline_ms` after its time, or its first candidate where
    that is later, an epoch is closed. A fuser that was outvoted must agree for `readmit_after_s`.
    """

    model_config = STRICT
    position_m: Positive = 0.05
    speed_mps: Positive = 0.02
    interval_m: Positive = 1.0
    interval_mps: Positive = 0.5
    sigmas: Positive = 1.0
    deadline_ms: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    readmit_after_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 1.0


class FusionFile(BaseModel):
    """The settings of the fuser. Feedback is sent with every `feedback_every`-th state.

    `replicas`: so many fusers run on a live train; one leads, the others stand by. With `voting` none leads: a voter publishes
    what two of three agree on.
    """

    model_config = STRICT
    rule: str = "information"
    period_ms: Annotated[int, Field(ge=1, le=1000)] = 20
    deadline_ms: Annotated[float, Field(ge=0.0, le=1000.0)] = 15.0
    horizon_s: Annotated[float, Field(ge=0.1, le=60.0)] = 5.0
    feedback: bool = True
    feedback_every: Annotated[int, Field(ge=1, le=1000)] = 1
    shares: SharesFile = Field(default_factory=dict)
    interval_sigmas: Positive = 5.0
    false_alarms_per_hour: Positive = 0.01
    integrity_risk_per_hour: Positive = 1e-4
    lost_above_m: Positive = 100.0
    replicas: Annotated[int, Field(ge=1, le=3)] = 1
    voting: VotingFile | None = None

    @model_validator(mode="after")
    def _known(self) -> FusionFile:
        if self.rule not in RULES:
            raise ValueError(f"rule: {must_be_one_of(RULES, self.rule)}")
        if self.voting is not None and self.replicas != 3:
            raise ValueError(f"replicas: must be 3 with `voting`, not {self.replicas}")
        return self


class WorldFile(BaseModel):
    """The simulated train. Absent on a real train, and where recordings are replayed without a truth."""

    model_config = STRICT
    seed: Annotated[int, Field(ge=0)] = 1
    motion: MotionFile
    creep: CreepFile | None = None


class MotionModelFile(BaseModel):
    """The estimator's motion model: white jerk of this density.

    `hard_jerk_psd_m2ps5` instead while the train moves harder, which it does at any moment with `hard_probability`; 0: never.
    With 50 the acceleration changes by 4 m/s², more than adhesion allows, in 0.3 s.
    """

    model_config = STRICT
    jerk_psd_m2ps5: Positive
    hard_jerk_psd_m2ps5: Positive = 50.0
    hard_probability: Annotated[float, Field(ge=0.0, lt=0.5)] = 1e-6


class TrainFile(BaseModel):
    """A train: its line, its units in order, how they are fused. `chaos`: whether faults may be injected while it runs.

    `health_every_s`: how often each process tells how it is doing. `etcs`: it reports its position as ERTMS/ETCS does.
    """

    model_config = STRICT
    train: Name
    chaos: bool = False
    health_every_s: Annotated[float, Field(ge=1.0, le=60.0)] = 1.0
    line: DataPath
    motion_model: MotionModelFile
    prior: PriorFile
    fusion: FusionFile = Field(default_factory=FusionFile)
    world: WorldFile | None = None
    etcs: EtcsFile | None = None
    units: Annotated[dict[Name, dict[str, Any]], Field(min_length=1)]

    @field_validator("units")
    @classmethod
    def _no_name_of_ours(cls, units: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        if MOTION_MODEL in units:
            raise ValueError(f"{MOTION_MODEL}: the fuser reports its motion model by this name")
        return units
