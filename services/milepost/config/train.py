"""Train files are loaded and checked completely before any process starts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from milepost.estimation.filters import FILTERS
from milepost.estimation.filters.base import LocalFilter
from milepost.recordings.column_map import check_map
from milepost.recordings.column_options import RecordingOptions
from milepost.sensors import SENSORS
from milepost.sensors.base import Sensor, World
from milepost.track.line import Line
from milepost_schemas import BY_NAME

from .etcs_file import balise_groups
from .line_file import load_line
from .mistakes import must_be_one_of
from .shipped_files import is_file
from .train_file import BySpeedFile, TrainFile
from .world.motion_file import RecordedFile
from .yaml_files import ConfigError, merged, read_yaml, validate, validate_dataclass


@dataclass(frozen=True)
class Train:
    """A train file, with its line, sensors and filters loaded and checked."""

    path: Path
    file: TrainFile
    line: Line
    sensors: Mapping[str, Sensor[Any]]
    filters: Mapping[str, tuple[type[LocalFilter[Any]], Any]]

    @property
    def name(self) -> str:
        """The train's name in keys."""
        return self.file.train

    @property
    def fused_units(self) -> list[str]:
        """The units with a local filter, in order."""
        return list(self.filters)

    @property
    def balise_readers(self) -> list[str]:
        """The units that read balises."""
        return [unit for unit, sensor in self.sensors.items() if sensor.stream == "balise_telegram"]

    @property
    def replayed_units(self) -> list[str]:
        """The units whose readings come from a file."""
        return [unit for unit, sensor in self.sensors.items() if getattr(_origin(sensor), "file", None) is not None]

    @property
    def has_scenario_time(self) -> bool:
        """Whether the process `world` owns time: on a simulated train, and where recordings are replayed."""
        return self.file.world is not None or bool(self.replayed_units)

    @cached_property
    def recorded_end_s(self) -> float:
        """The scenario time of the last reading of all recordings; 0 without any. Raises ConfigError."""
        return max((self._last_s(unit) for unit in self.replayed_units), default=0.0)

    def _last_s(self, unit: str) -> float:
        last_s = 0.0
        try:
            source = self.sensors[unit].source(None, 0.0)
            while (at_s := source.next_s()) is not None:
                last_s = at_s
                source.read()
        except (ValueError, OSError) as error:
            raise ConfigError(self.path, f"units.{unit}", str(error)) from error
        return last_s

    def world(self, until_s: float | None = None) -> World:
        """The simulated world, until its line, its recording or `until_s` ends. Raises ConfigError if there is none."""
        if self.file.world is None:
            raise ConfigError(self.path, "world", "required for simulated units")
        file, seed = self.file.world, self.file.world.seed
        try:
            motion = file.motion.build(self.line, seed, until_s)
        except ValueError as error:
            field, _, text = str(error).partition(": ")
            raise ConfigError(self.path, f"world.motion.{field}", text) from error
        creep = file.creep.build(motion, self.line, seed) if file.creep else None
        return World(motion, self.line, seed, creep)


def load_train(path: Path, change: Mapping[str, Any] | None = None, seed: int | None = None) -> Train:
    """A train from its file, changed by `change` and, where it has a world, by `seed`. Raises ConfigError."""
    content = merged(read_yaml(path), change or {})
    file = validate(path, content, TrainFile)
    if seed is not None and file.world is not None:
        file = file.model_copy(update={"world": file.world.model_copy(update={"seed": seed})})
    if not is_file(file.line):
        raise ConfigError(path, "line", f"{file.line}: no such file")
    line = load_line(file.line)
    sensors: dict[str, Sensor[Any]] = {}
    filters: dict[str, tuple[type[LocalFilter[Any]], Any]] = {}
    for unit, entry in file.units.items():
        kind = SENSORS.get(str(entry.get("kind")))
        if kind is None:
            raise ConfigError(path, f"units.{unit}.kind", must_be_one_of(SENSORS, entry.get("kind")))
        options = validate(path, entry, kind.options_model, f"units.{unit}")
        if options.filter is not None:
            filters[unit] = _filter(path, f"units.{unit}.filter", options.filter)
        sensors[unit] = kind(unit, options, line)
    train = Train(path, file, line, sensors, filters)
    if file.world is not None and file.world.creep is not None:
        for where, unit in file.world.creep.units_named():
            if unit not in sensors:
                raise ConfigError(path, f"world.creep.{where}", f"{unit} is not a unit of this train")
    for where, unit in _units_of_shares(file.fusion.shares):
        if unit not in filters:
            raise ConfigError(path, f"{where}.{unit}", "is not a unit with a filter")
    if file.etcs is not None and not balise_groups(line):
        raise ConfigError(path, "etcs", f"needs balises with an identity; line {line.name} has no `nid_c` and `nid_bg`")
    if not train.fused_units:
        raise ConfigError(path, "units", "no unit has a filter")
    for unit, sensor in train.sensors.items():
        _check_source(train, unit, sensor)
    _check_line(train)
    return train


def _filter(path: Path, field: str, named: str | dict[str, Any]) -> tuple[type[LocalFilter[Any]], Any]:
    """A filter's row and its options, from its name alone or from a mapping with `kind`."""
    entry = {"kind": named} if isinstance(named, str) else dict(named)
    name = entry.pop("kind", None)
    row = FILTERS.get(str(name))
    if row is None:
        raise ConfigError(path, field, must_be_one_of(FILTERS, name))
    return row, validate_dataclass(path, entry, row.options_model, field)


def _units_of_shares(shares: Any) -> Iterator[tuple[str, str]]:
    if isinstance(shares, BySpeedFile):
        for number, row in enumerate(shares.by_speed):
            yield from ((f"fusion.shares.by_speed.{number}.shares", unit) for unit in row.shares)
    elif isinstance(shares, dict):
        yield from (("fusion.shares", unit) for unit in shares)


def _origin(sensor: Sensor[Any]) -> Any:
    """The options of a unit's `recording` or `receiver`; None where its readings are simulated."""
    source = sensor.options.source
    return None if source == "simulation" else getattr(sensor.options, source, None)


def _check_source(train: Train, unit: str, sensor: Sensor[Any]) -> None:
    options, place = sensor.options, f"units.{unit}"
    origin = _origin(sensor)
    if options.source != "simulation" and origin is None:
        raise ConfigError(train.path, f"{place}.{options.source}", f"required with `source: {options.source}`")
    if isinstance(origin, RecordingOptions):
        try:
            check_map(origin, BY_NAME[sensor.stream].message)
        except ValueError as error:
            raise ConfigError(train.path, f"{place}.recording", str(error)) from error
    file = getattr(origin, "file", None)
    if file is not None and not is_file(file):
        raise ConfigError(train.path, f"{place}.{options.source}", f"{file}: no such file")
    if origin is not None and file is None and train.has_scenario_time:
        text = "a live receiver keeps real time and cannot be used with a `world` or a recording"
        raise ConfigError(train.path, f"{place}.receiver", text)
    motion = train.file.world.motion if train.file.world is not None else None
    if isinstance(origin, RecordingOptions) and isinstance(motion, RecordedFile):
        try:
            motion.check_time_zero(unit, origin)
        except (ValueError, OSError) as error:
            field, _, text = str(error).partition(": ")
            raise ConfigError(train.path, f"world.motion.{field}", text) from error


def _check_line(train: Train) -> None:
    prior, end_m = train.file.prior, train.line.length_m
    if not -3.0 * prior.position_std_m <= prior.position_m <= end_m + 3.0 * prior.position_std_m:
        text = f"{prior.position_m:g} is not on line {train.line.name}, 0 to {end_m:g} m"
        raise ConfigError(train.path, "prior.position_m", text)
    for unit, sensor in train.sensors.items():
        if sensor.stream == "position_reading" and train.line.track is None:
            raise ConfigError(train.path, f"units.{unit}", f"requires a line with geometry; {train.line.name} has none")
