"""A campaign file as cells: every train, fault and unit, with a run for each seed."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from milepost.config.mistakes import must_be_one_of
from milepost.config.train import Train, load_train
from milepost.config.yaml_files import ConfigError
from milepost.sensors import SENSORS
from milepost.simulation.faults import FAULTS, FaultEntry

from .campaign_file import CampaignFile, FaultRow, TrainEntry
from .fingerprint import code_fingerprint, train_fingerprint
from .task import Task

NO_FAULT = "no fault"
DRAWN = "drawn at random"


@dataclass(frozen=True)
class Cell:
    """A train, the unit or units that lie, and how; with its runs. `units` is empty without a fault."""

    train: str
    units: tuple[str, ...]
    fault: str
    tasks: tuple[Task, ...]


@dataclass(frozen=True)
class _Loaded:
    """An entry for a train with the train, and by unit the faults of the campaign that it can have."""

    name: str
    entry: TrainEntry
    train: Train
    place: str
    inputs: str
    faults: Mapping[str, list[FaultRow]]


def cells(path: Path, campaign: CampaignFile, runs: int | None, seed: int | None) -> list[Cell]:
    """The cells of a campaign, with `runs` and `seed` instead of the file's where given. Raises ConfigError."""
    for number, row in enumerate(campaign.faults):
        if row.kind not in FAULTS:
            raise ConfigError(path, f"faults.{number}.kind", must_be_one_of(FAULTS, row.kind))
    loaded = [_load(path, campaign, name, entry) for name, entry in campaign.trains.items()]
    _check_rows(path, campaign, loaded)
    seeds = [(campaign.seed if seed is None else seed) + run for run in range(runs or campaign.runs_per_cell)]
    return [cell for each in loaded for cell in _cells(campaign, each, seeds)]


def _cells(campaign: CampaignFile, each: _Loaded, seeds: list[int]) -> Iterator[Cell]:
    if not campaign.faults:
        yield Cell(each.name, (), NO_FAULT, tuple(_task(each, seed, {}) for seed in seeds))
    elif campaign.pairs:
        for pair in combinations(each.faults, 2):
            yield Cell(each.name, pair, DRAWN, tuple(_draw(each, pair, seed) for seed in seeds))
    else:
        for row in campaign.faults:
            for unit, rows in each.faults.items():
                if row in rows:
                    tasks = (_task(each, seed, {unit: row}) for seed in seeds)
                    yield Cell(each.name, (unit,), row.label, tuple(tasks))


def _draw(each: _Loaded, pair: tuple[str, ...], seed: int) -> Task:
    """A run in which each unit of a pair has a fault drawn from those that it can have; the same in every campaign."""
    chance = random.Random(f"{each.name}/{'/'.join(pair)}/{seed}")
    return _task(each, seed, {unit: chance.choice(each.faults[unit]) for unit in pair})


def _task(each: _Loaded, seed: int, chosen: Mapping[str, FaultRow]) -> Task:
    entry, faults = each.entry, []
    for unit, row in chosen.items():
        late_s = random.Random(f"{each.name}/{unit}/{row.label}/{seed}").random() * entry.onset_spread_s
        faults.append(_fields(row, unit, round(entry.onset_s + late_s, 3)))
    labels = tuple(row.label for row in chosen.values())
    head = (each.name, each.place, entry.duration_s, entry.onset_s, seed, each.inputs, code_fingerprint())
    return Task(*head, entry.change, tuple(faults), labels)


def _fields(row: FaultRow, unit: str, from_s: float) -> dict[str, Any]:
    return {"unit": unit, "kind": row.kind, "from_s": from_s, "for_s": row.for_s, **row.options}


def _load(path: Path, campaign: CampaignFile, name: str, entry: TrainEntry) -> _Loaded:
    try:
        file = entry.file(path.parent)
        # without an error here the train is valid by itself, and the mistake is in the change
        train = load_train(file)
    except ConfigError as error:
        raise ConfigError(path, f"trains.{name}.train", str(error)) from error
    try:
        train = load_train(file, entry.change)
    except ConfigError as error:
        raise ConfigError(path, f"trains.{name}.change", str(error)) from error
    if train.file.world is None:
        raise ConfigError(path, f"trains.{name}.train", f"{file} has no `world`, and so no truth to compare with")
    # a name is looked up where the run is made, which may be another machine
    place = entry.train if file != path.parent / entry.train else str(file.resolve())
    fitting = {unit: _fitting(path, campaign, name, train, unit) for unit in train.sensors}
    return _Loaded(name, entry, train, place, train_fingerprint(file), {u: rows for u, rows in fitting.items() if rows})


def _fitting(path: Path, campaign: CampaignFile, name: str, train: Train, unit: str) -> list[FaultRow]:
    """The faults that a unit of a train can have and the campaign asks for."""
    sensor, out = train.sensors[unit], []
    for number, row in enumerate(campaign.faults):
        if not row.selects(name, unit, sensor.stream, sensor.kind):
            continue
        misfit = _entry(path, number, row, unit).misfit(sensor.stream, sensor.kind, has_motion=True)
        if misfit is None:
            out.append(row)
        elif unit in row.units:
            raise ConfigError(path, f"faults.{number}.units", f"{unit} of {name}: {misfit}")
    return out


def _entry(path: Path, number: int, row: FaultRow, unit: str) -> FaultEntry:
    try:
        return FaultEntry.model_validate(_fields(row, unit, 0.0))
    except ValidationError as error:
        text = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise ConfigError(path, f"faults.{number}.options", text) from error


def _check_rows(path: Path, campaign: CampaignFile, loaded: list[_Loaded]) -> None:
    labels: set[str] = set()
    for number, row in enumerate(campaign.faults):
        place = f"faults.{number}"
        if row.label in labels:
            raise ConfigError(path, f"{place}.label", f"another fault is called {row.label!r}")
        labels.add(row.label)
        for name in row.trains:
            if name not in campaign.trains:
                raise ConfigError(path, f"{place}.trains", must_be_one_of(campaign.trains, name))
        for name in row.sensors:
            if name not in SENSORS:
                raise ConfigError(path, f"{place}.sensors", must_be_one_of(SENSORS, name))
        units = [unit for each in loaded for unit in each.train.sensors if not row.trains or each.name in row.trains]
        for unit in row.units:
            if unit not in units:
                raise ConfigError(path, f"{place}.units", must_be_one_of(dict.fromkeys(units), unit))
        if not any(row in rows for each in loaded for rows in each.faults.values()):
            raise ConfigError(path, place, "fits no unit of any train")
    if campaign.pairs and all(len(each.faults) < 2 for each in loaded):
        raise ConfigError(path, "pairs", "no train has two units that can have a fault")
