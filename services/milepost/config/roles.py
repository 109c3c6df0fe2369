"""THE ROLE TABLE: the kinds of process, and which of them a train needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from milepost.estimation.estimator import Prior
from milepost.estimation.filters.base import FilterSetup
from milepost.estimation.layout import Layout
from milepost.estimation.time_units import NS_PER_S
from milepost.fusion.hypotheses import Doubts, Suspect
from milepost.fusion.shares import FixedShares, Shares, SharesByAccuracy, SharesBySpeed, SpeedRow
from milepost.nodes.balise import BaliseNode
from milepost.nodes.base import Node
from milepost.nodes.faulty import FaultySensor
from milepost.nodes.filter import FilterNode
from milepost.nodes.fuser import FuserNode
from milepost.nodes.fuser_settings import FuserSettings
from milepost.nodes.judges import UnitJudge
from milepost.nodes.roster import UnitRow
from milepost.nodes.sensor import SensorNode
from milepost.nodes.world import WorldNode
from milepost.sensors.base import World
from milepost.simulation.faults import FaultEntry
from milepost_schemas import BY_NAME

from .faults import injection
from .train import Train
from .train_file import BySpeedFile
from .yaml_files import ConfigError


@dataclass(frozen=True)
class Setting:
    """The setting of a node: its instance's name and, on a simulated train, its world and scenario time.

    `start_ns` is the UTC time of scenario time 0, `from_s` the scenario time at which the process begins, `until_s` the
    scenario time at which recordings end, where they do not end before. `faults`: what goes wrong with units' readings.
    """

    instance: str
    world: World | None = None
    start_ns: int = 0
    from_s: float = 0.0
    until_s: float | None = None
    faults: tuple[FaultEntry, ...] = ()

    @classmethod
    def of(
        cls, train: Train, instance: str, until_s: float | None, start_ns: int = 0, faults: tuple[FaultEntry, ...] = ()
    ) -> Setting:
        """A train's setting: scenario time ends at `until_s`, or where the line or the recordings end. Raises ConfigError."""
        world = train.world(until_s) if train.file.world is not None else None
        return cls(instance, world, start_ns, until_s=until_s, faults=faults)


@dataclass(frozen=True)
class Role:
    """A kind of process: `units` lists what a train needs it for; `uses_world`: it needs the simulated train.

    `sends` are the streams of the stream table that the process for a unit sends, besides `event` and `health`.
    """

    name: str
    purpose: str
    per_unit: bool
    uses_world: bool
    units: Callable[[Train], list[str]]
    build: Callable[[Train, str, Setting], Node]
    sends: Callable[[Train, str], tuple[str, ...]]


def _world(train: Train, unit: str, setting: Setting) -> Node:  # noqa: ARG001
    if setting.world is None and not train.replayed_units:
        raise ConfigError(train.path, "world", "required for the role `world`")
    motion = setting.world.motion if setting.world is not None else None
    end_s = motion.end_s if motion is not None else min(train.recorded_end_s, setting.until_s or math.inf)
    period_ns = train.file.fusion.period_ms * 1_000_000
    return WorldNode(train.name, setting.instance, motion, end_s, setting.start_ns, period_ns)


def _sensor(train: Train, unit: str, setting: Setting) -> Node:
    sensor = train.sensors[unit]
    try:
        source = sensor.source(setting.world, setting.from_s)
    except (ValueError, OSError) as error:
        raise ConfigError(train.path, f"units.{unit}", str(error)) from error
    node = SensorNode(train.name, setting.instance, sensor, source, setting.start_ns)
    faults = [fault for fault in setting.faults if fault.unit == unit]
    if not (faults or train.file.chaos):
        return node
    return FaultySensor(node, injection(train, unit, setting.world, setting.start_ns, faults), train.file.chaos)


def _filter(train: Train, unit: str, setting: Setting) -> Node:
    sensor, fusion = train.sensors[unit], train.file.fusion
    # the share at standstill: the speed is not known before the first reading
    share = shares(train).at(train.fused_units, 0.0, {}).get(unit, 0.0) if fusion.feedback else 1.0
    setup = FilterSetup(
        full_layout(train).only([unit]),
        train.file.motion_model.jerk_psd_m2ps5,
        prior(train),
        round(fusion.horizon_s * NS_PER_S),
        share or 1.0,
    )
    kind, options = train.filters[unit]
    order = list(train.sensors).index(unit)
    return FilterNode(train.name, setting.instance, sensor, kind(setup, options), order, fusion.feedback)


def _balise(train: Train, unit: str, setting: Setting) -> Node:  # noqa: ARG001
    return BaliseNode(train.name, setting.instance, train.balise_readers, train.line)


def _fuser(train: Train, unit: str, setting: Setting) -> Node:  # noqa: ARG001
    return FuserNode(train.name, setting.instance, fuser_settings(train), train.line)


def full_layout(train: Train) -> Layout:
    """All states of a train: the common ones, then each unit's private ones, in the train file's order."""
    blocks = ((unit, train.sensors[unit].private_states) for unit in train.fused_units)
    return Layout(tuple((unit, states) for unit, states in blocks if states))


def prior(train: Train) -> Prior:
    """The train file's prior."""
    p = train.file.prior
    mean = np.array([p.position_m, p.speed_mps, p.acceleration_mps2])
    return Prior(mean, np.array([p.position_std_m, p.speed_std_mps, p.acceleration_std_mps2]))


def shares(train: Train) -> Shares:
    """The train file's rule for the shares."""
    entry = train.file.fusion.shares
    if isinstance(entry, BySpeedFile):
        rows = entry.by_speed
        return SharesBySpeed(tuple(SpeedRow(r.below_kmh / 3.6 if r.below_kmh else math.inf, r.shares) for r in rows))
    return FixedShares(entry) if isinstance(entry, dict) else SharesByAccuracy()


def fuser_settings(train: Train) -> FuserSettings:
    """The settings of the fuser's node, from a train file."""
    fusion = train.file.fusion
    judges = {unit: judge for unit in train.fused_units if (judge := _judge(train, unit)) is not None}
    rows = [
        UnitRow(
            unit,
            order,
            None if sensor.period_s is None else round(sensor.period_s * NS_PER_S),
            sensor.options.filter is not None,
            round(sensor.latency_s * NS_PER_S),
        )
        for order, (unit, sensor) in enumerate(train.sensors.items())
    ]
    return FuserSettings(
        rule=fusion.rule,
        period_ns=fusion.period_ms * 1_000_000,
        deadline_ns=round(fusion.deadline_ms * 1e6),
        horizon_ns=round(fusion.horizon_s * NS_PER_S),
        feedback=fusion.feedback,
        feedback_every=fusion.feedback_every,
        shares=shares(train),
        sigmas=fusion.interval_sigmas,
        lost_above_m=fusion.lost_above_m,
        jerk_psd=train.file.motion_model.jerk_psd_m2ps5,
        prior=prior(train),
        layout=full_layout(train),
        units=rows,
        judges=judges,
        doubts=doubts(train),
    )


def _judge(train: Train, unit: str) -> UnitJudge | None:
    """The judge of a unit's readings in the fuser; None where the fuser takes the filter's rows."""
    sensor, (kind, _) = train.sensors[unit], train.filters[unit]
    judge = UnitJudge(sensor, BY_NAME[sensor.stream].message)
    return None if not kind.passes_readings or (judge.pure and not sensor.needs_belief) else judge


def doubts(train: Train) -> Doubts:
    """Which units of a train may be lying, and the budgets of its train file."""
    suspects, wheels = [], []
    for unit, sensor in train.sensors.items():
        rate = sensor.options.fault_probability
        if rate is None:
            rate = sensor.fault_probability
        readings_per_s = 1.0 if sensor.period_s is None else 1.0 / sensor.period_s
        balises = sensor.stream == "balise_telegram"
        never_repeats = sensor.never_repeats and sensor.options.source == "simulation"
        slips = sensor.slip_probability > 0.0
        suspects.append(Suspect(unit, rate, readings_per_s, balises, never_repeats, slips, 2 if balises else 10))
        if sensor.slip_probability > 0.0 and rate > 0.0:
            wheels.append((unit, sensor.slip_probability))
    # poor adhesion makes all wheels slip at once
    groups = ((frozenset(unit for unit, _ in wheels), max(rate for _, rate in wheels)),) if len(wheels) > 1 else ()
    fusion = train.file.fusion
    return Doubts(tuple(suspects), groups, fusion.false_alarms_per_hour, fusion.integrity_risk_per_hour)


def _world_units(train: Train) -> list[str]:
    return ["world"] if train.has_scenario_time else []


def _one(name: str) -> Callable[[Train], list[str]]:
    return lambda train: [name]  # noqa: ARG005


def _always(*streams: str) -> Callable[[Train, str], tuple[str, ...]]:
    return lambda train, unit: streams  # noqa: ARG005


def _balise_units(train: Train) -> list[str]:
    return ["balise"] if train.balise_readers else []


def _truth(train: Train, unit: str) -> tuple[str, ...]:  # noqa: ARG001
    return ("truth",) if train.file.world is not None else ()


def _readings(train: Train, unit: str) -> tuple[str, ...]:
    return (train.sensors[unit].stream,)


_FUSED = "one state an epoch from all estimates and fixes"
ROLES: dict[str, Role] = {
    role.name: role
    for role in (
        Role("fuser", _FUSED, False, False, _one("fuser"), _fuser, _always("state", "feedback")),
        Role("filter", "a unit's local filter", True, False, lambda t: t.fused_units, _filter, _always("estimate")),
        Role("balise", "telegrams into absolute fixes", False, False, _balise_units, _balise, _always("fix")),
        Role("sensor", "a unit's readings", True, True, lambda t: list(t.sensors), _sensor, _readings),
        Role("world", "scenario time, and the truth where there is one", False, True, _world_units, _world, _truth),
    )
}


@dataclass(frozen=True, slots=True)
class Process:
    """One process of a train: `name` is the name of its token, its health messages and its container."""

    name: str
    role: str
    unit: str


def process_name(role: str, unit: str) -> str:
    """`sensor-radar` for a role per unit, `fuser` for the others."""
    return f"{role}-{unit}" if ROLES[role].per_unit else role


def processes(train: Train) -> list[Process]:
    """All processes of a train besides the router, listeners before speakers."""
    return [Process(process_name(role.name, unit), role.name, unit) for role in ROLES.values() for unit in role.units(train)]
