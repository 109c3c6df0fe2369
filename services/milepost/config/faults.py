"""Faults of a train's units: whether each fits its unit, and what it depends on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from milepost.nodes.faulty import unknown_balise
from milepost.sensors.base import World
from milepost.simulation.faults import FaultEntry, Injection, Surroundings

from .mistakes import must_be_one_of
from .train import Train
from .yaml_files import ConfigError


def check_faults(train: Train, faults: Sequence[FaultEntry], path: Path, place: str) -> None:
    """Check that every fault fits its unit. Raises ConfigError for the file at `path`, whose list of faults is at `place`."""
    for number, fault in enumerate(faults):
        sensor = train.sensors.get(fault.unit)
        if sensor is None:
            raise ConfigError(path, f"{place}.{number}.unit", must_be_one_of(train.sensors, fault.unit))
        misfit = fault.misfit(sensor.stream, sensor.kind, train.file.world is not None)
        if misfit is not None:
            raise ConfigError(path, f"{place}.{number}.kind", f"{fault.unit}: {misfit}")
        unknown = unknown_balise(fault, train.line)
        if unknown is not None:
            raise ConfigError(path, f"{place}.{number}", f"{fault.unit}: {unknown}")


def injection(train: Train, unit: str, world: World | None, start_ns: int, faults: Iterable[FaultEntry]) -> Injection:
    """The faults of one unit at work. Scenario time 0 is at `start_ns`."""
    sensor = train.sensors[unit]
    around = Surroundings(
        unit,
        sensor.stream,
        sensor.kind,
        train.line,
        motion=None if world is None else world.motion,
        seed=0 if world is None else world.seed,
        # what only some kinds of sensor have among their options
        position_std_m=getattr(sensor.options, "position_std_m", {}),
        force_noise_mps2_rthz=getattr(sensor.options, "noise_density_mps2_rthz", None),
    )
    return Injection(around, start_ns, faults)
