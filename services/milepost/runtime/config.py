"""Train and scenario files: everything that can be wrong with them is said before anything starts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, model_validator

from milepost.estimation.filters import FILTERS
from milepost.estimation.fusion import RULES
from milepost.estimation.track import Line
from milepost.sensors import SENSORS
from milepost.sensors.base import DataPath, Sensor, World
from milepost.simulation.motion import Motion, Profile, WhiteJerkMotion
from milepost.simulation.recording import read_gnss_log, smooth_motion
from milepost_schemas.message import Name, PositionM, SpeedMps

from .lines import STRICT, load_line
from .yaml_files import ConfigError, merged, read_yaml, validate

Positive = Annotated[float, Field(gt=0.0)]


class PriorFile(BaseModel):
    """What is believed before the first observation."""

    model_config = STRICT
    position_m: PositionM
    position_std_m: Positive
    speed_mps: SpeedMps
    speed_std_mps: Positive
    acceleration_mps2: float = 0.0
    acceleration_std_mps2: Positive


class FusionFile(BaseModel):
    """How the fuser works; DESIGN's defaults."""

    model_config = STRICT
    rule: str = "information"
    period_ms: Annotated[int, Field(ge=1, le=1000)] = 20
    deadline_ms: Annotated[float, Field(ge=0.0, le=1000.0)] = 15.0
    horizon_s: Annotated[float, Field(ge=0.1, le=60.0)] = 5.0
    feedback: bool = True
    shares: dict[str, Annotated[float, Field(ge=0.0, le=1.0)]] = Field(default_factory=dict)
    interval_sigmas: Positive = 5.0
    lost_above_m: Positive = 100.0

    @model_validator(mode="after")
    def _known(self) -> FusionFile:
        if self.rule not in RULES:
            raise ValueError(f"rule: {self.rule!r} is none of {', '.join(RULES)}")
        if self.shares and abs(sum(self.shares.values()) - 1.0) > 1e-9:
            raise ValueError(f"shares: they must sum to 1, not {sum(self.shares.values()):g}")
        return self


class WhiteJerkFile(BaseModel):
    """A simulated motion: a seeded white-jerk path around a speed profile of [time s, speed m/s] corners."""

    model_config = STRICT
    kind: Literal["white_jerk"]
    profile: Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=1)]
    start_m: PositionM = 0.0
    jerk_psd_m2ps5: Annotated[float, Field(ge=0.0)]
    driver_time_s: Annotated[float, Field(ge=30.0)] | None = None
    start_std: Annotated[list[Annotated[float, Field(ge=0.0)]], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]

    @model_validator(mode="after")
    def _increasing(self) -> WhiteJerkFile:
        times = [corner[0] for corner in self.profile]
        if times[0] != 0.0 or any(b <= a for a, b in pairwise(times)):
            raise ValueError("profile: times must start at 0 and increase")
        return self


class RecordedFile(BaseModel):
    """A motion that a GNSS log's RTK fixes show."""

    model_config = STRICT
    kind: Literal["recorded"]
    gnss_log: DataPath
    fix_std_m: Positive = 0.01
    jerk_psd_m2ps5: Positive = 0.01


class WorldFile(BaseModel):
    """The train that is not there. Absent on a real train."""

    model_config = STRICT
    seed: Annotated[int, Field(ge=0)] = 1
    motion: Annotated[WhiteJerkFile | RecordedFile, Field(discriminator="kind")]


class MotionModelFile(BaseModel):
    """The estimator's motion model: white jerk of this density."""

    model_config = STRICT
    jerk_psd_m2ps5: Positive


class TrainFile(BaseModel):
    """A train: its line, its units in order, how they are fused."""

    model_config = STRICT
    train: Name
    line: DataPath
    motion_model: MotionModelFile
    prior: PriorFile
    fusion: FusionFile = Field(default_factory=FusionFile)
    world: WorldFile | None = None
    units: Annotated[dict[Name, dict[str, Any]], Field(min_length=1)]


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


@dataclass(frozen=True)
class Train:
    """A train file with everything it names loaded and checked."""

    path: Path
    file: TrainFile
    line: Line
    sensors: Mapping[str, Sensor[Any]]

    @property
    def name(self) -> str:
        """The train's name in keys."""
        return self.file.train

    @property
    def fused_units(self) -> list[str]:
        """The units that a local filter speaks for, in order."""
        return [unit for unit, sensor in self.sensors.items() if sensor.options.filter is not None]

    @property
    def balise_readers(self) -> list[str]:
        """The units that read balises."""
        return [unit for unit, sensor in self.sensors.items() if sensor.stream == "balise_telegram"]

    def world(self, until_s: float | None = None) -> World:
        """The simulated world, until its line, its recording or `until_s` ends. Raises ConfigError if there is none."""
        if self.file.world is None:
            raise ConfigError(self.path, "world", "needed for simulated or replayed units")
        return World(self._motion(self.file.world, until_s), self.line, self.file.world.seed)

    def _motion(self, world: WorldFile, until_s: float | None) -> Motion:
        motion = world.motion
        if isinstance(motion, RecordedFile):
            try:
                if self.line.track is None:
                    raise ValueError("a recorded motion needs a line with geometry")
                fixes = read_gnss_log(motion.gnss_log)
                recorded = smooth_motion(fixes, self.line.track, motion.fix_std_m, motion.jerk_psd_m2ps5)
            except (ValueError, OSError) as error:
                raise ConfigError(self.path, "world.motion.gnss_log", str(error)) from error
            recorded.end_s = min(recorded.end_s, until_s) if until_s else recorded.end_s
            return recorded
        profile = Profile([(corner[0], corner[1]) for corner in motion.profile], motion.start_m)
        end_s = profile.reaches(self.line.length_m - 50.0)
        if until_s is None and math.isinf(end_s):
            raise ConfigError(self.path, "world.motion.profile", "never reaches the line's end; give a duration")
        return WhiteJerkMotion(
            profile, min(end_s, until_s or end_s), motion.jerk_psd_m2ps5, motion.driver_time_s, motion.start_std, world.seed
        )


def load_train(path: Path, change: Mapping[str, Any] | None = None) -> Train:
    """A train from its file, with `change` laid over it. Raises ConfigError."""
    file = validate(path, merged(read_yaml(path), change or {}), TrainFile)
    line = load_line(file.line)
    sensors: dict[str, Sensor[Any]] = {}
    for unit, entry in file.units.items():
        kind = SENSORS.get(str(entry.get("kind")))
        if kind is None:
            raise ConfigError(path, f"units.{unit}.kind", f"{entry.get('kind')!r} is none of {', '.join(SENSORS)}")
        options = validate(path, entry, kind.options_model, f"units.{unit}")
        if options.filter is not None and options.filter not in FILTERS:
            raise ConfigError(path, f"units.{unit}.filter", f"{options.filter!r} is none of {', '.join(FILTERS)}")
        _check_recording(path, unit, options)
        if file.world is None and options.source == "recording":
            raise ConfigError(path, "world", f"needed to replay the recording of {unit}: it owns the time")
        sensors[unit] = kind(unit, options, line)
    train = Train(path, file, line, sensors)
    unknown = [unit for unit in file.fusion.shares if unit not in train.fused_units]
    if unknown:
        raise ConfigError(path, f"fusion.shares.{unknown[0]}", "is not a unit with a filter")
    if not train.fused_units:
        raise ConfigError(path, "units", "no unit has a filter")
    _check_geometry(train)
    return train


def _check_recording(path: Path, unit: str, options: Any) -> None:
    if options.source == "recording":
        recording = getattr(options, "recording", None)
        if recording is None:
            raise ConfigError(path, f"units.{unit}.recording", "needed with `source: recording`")
        if not recording.is_file():
            raise ConfigError(path, f"units.{unit}.recording", f"{recording}: no such file")


def _check_geometry(train: Train) -> None:
    for unit, sensor in train.sensors.items():
        if sensor.stream == "position_reading" and train.line.track is None:
            raise ConfigError(train.path, f"units.{unit}", f"needs a line with geometry, and {train.line.name} has none")


def load_scenario(path: Path, seed: int | None = None, rule: str | None = None) -> tuple[ScenarioFile, Train]:
    """A scenario and its train, with changes, seed and rule laid over the train file. Raises ConfigError."""
    scenario = validate(path, read_yaml(path), ScenarioFile)
    change = merged(scenario.change, {"world": {"seed": scenario.seed if seed is None else seed}})
    if rule is not None:
        change = merged(change, {"fusion": {"rule": rule}})
    try:
        return scenario, load_train(scenario.train, change)
    except ConfigError as error:
        # if the train is sound by itself, it is the change that is not
        load_train(scenario.train)
        raise ConfigError(path, "change", str(error)) from error
