"""THE ROLE TABLE: the kinds of process, and which of them a train needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from milepost.estimation.filters.base import FilterSetup
from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.balise import BaliseNode
from milepost.nodes.base import Node
from milepost.nodes.clocks.own_clock import late_after_ns
from milepost.nodes.clocks.timed import Timed
from milepost.nodes.faulty import FaultySensor
from milepost.nodes.filter import FilterNode
from milepost.nodes.fuser import FuserNode
from milepost.nodes.fuser_faults.bit_flip import CorruptibleFuser
from milepost.nodes.fuser_faults.wrong_clock import WrongClock
from milepost.nodes.fuser_settings import FuserSettings
from milepost.nodes.position_report import PositionReportNode
from milepost.nodes.sensor import SensorNode
from milepost.nodes.standby.replica import ReplicaNode
from milepost.nodes.voting.agreement import Tolerance
from milepost.nodes.voting.candidate import CandidateNode
from milepost.nodes.voting.voter import VoterNode
from milepost.nodes.world import WorldNode
from milepost.sensors.base import World
from milepost.simulation.faults import FaultEntry

from .etcs_file import balise_groups
from .faults import injection
from .fusion_settings import full_layout, fuser_settings, prior, shares
from .train import Train
from .train_file import VotingFile
from .yaml_files import ConfigError


@dataclass(frozen=True)
class Setting:
    """The setting of a node: its instance's name and, on a simulated train, its world and scenario time.

    `start_ns` is the UTC time of scenario time 0, `from_s` the scenario time at which the process begins, `until_s` the
    scenario time at which recordings end, where they do not end before. `faults`: what goes wrong with units' readings.
    `live`: other replicas of the process may run beside it.
    """

    instance: str
    world: World | None = None
    start_ns: int = 0
    from_s: float = 0.0
    until_s: float | None = None
    faults: tuple[FaultEntry, ...] = ()
    live: bool = False

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

    `sends` are the streams of the stream table that the process for a unit sends, besides `event` and `health`. `replicas`: so
    many processes of a live train hold the role for each unit. `live_only`: an offline run does without.
    """

    name: str
    purpose: str
    per_unit: bool
    uses_world: bool
    units: Callable[[Train], list[str]]
    build: Callable[[Train, str, Setting], Node]
    sends: Callable[[Train, str], tuple[str, ...]]
    replicas: Callable[[Train], int] = lambda train: 1  # noqa: ARG005
    live_only: bool = False

    def instances(self, train: Train) -> list[str]:
        """The units of all processes of a live train: each unit, then its standbys: `fuser`, `fuser-2`."""
        units = self.units(train)
        return units + [f"{unit}-{n}" for n in range(2, self.replicas(train) + 1) for unit in units]


def _world(train: Train, unit: str, setting: Setting) -> Node:  # noqa: ARG001
    if setting.world is None and not train.replayed_units:
        raise ConfigError(train.path, "world", "required for the role `world`")
    motion = setting.world.motion if setting.world is not None else None
    end_s = motion.end_s if motion is not None else min(train.recorded_end_s, setting.until_s or math.inf)
    period_ns = train.file.fusion.period_ms * 1_000_000
    return WorldNode(train.name, setting.instance, motion, end_s, setting.start_ns, period_ns, setting.from_s)


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
    node = FilterNode(train.name, setting.instance, sensor, kind(setup, options), order, fusion.feedback)
    return _timed(node, train, process_name("filter", unit)) if setting.live and fusion.feedback else node


def _balise(train: Train, unit: str, setting: Setting) -> Node:  # noqa: ARG001
    return BaliseNode(train.name, setting.instance, train.balise_readers, train.line)


def _timed(node: Node, train: Train, name: str = "") -> Node:
    """A node that hears others enough to tell whether its own host's clock is wrong."""
    fusion = train.file.fusion
    return Timed(node, late_after_ns(fusion.period_ms * 1_000_000, round(fusion.deadline_ms * 1e6)), name=name)


def _fuser(train: Train, unit: str, setting: Setting) -> Node:
    settings = fuser_settings(train)
    fuser = FuserNode(train.name, setting.instance, settings, train.line, unit)
    if not setting.live:
        return fuser
    node = _one_of_several(CorruptibleFuser(fuser) if train.file.chaos else fuser, train, settings)
    return WrongClock(node) if train.file.chaos else node


def _one_of_several(node: Node, train: Train, settings: FuserSettings) -> Node:
    replicas = ROLES["fuser"].instances(train)
    if train.file.fusion.voting is not None:
        return _timed(CandidateNode(node, _tolerance(train.file.fusion.voting), settings.period_ns), train)
    return node if len(replicas) == 1 else ReplicaNode(node, replicas, settings.period_ns, settings.deadline_ns)


def _tolerance(voting: VotingFile) -> Tolerance:
    return Tolerance(voting.position_m, voting.speed_mps, voting.interval_m, voting.interval_mps, voting.sigmas)


def _voter(train: Train, unit: str, setting: Setting) -> Node:
    fusion, voting = train.file.fusion, train.file.fusion.voting
    if voting is None:
        raise ConfigError(train.path, "fusion.voting", "required for the role `voter`")
    period_ns, deadline_ns, readmit_ns = (
        round(ms * 1e6) for ms in (fusion.period_ms, voting.deadline_ms, voting.readmit_after_s * 1e3)
    )
    fusers, tolerance = ROLES["fuser"].instances(train), _tolerance(voting)
    node = VoterNode(train.name, setting.instance, fusers, tolerance, period_ns, deadline_ns, readmit_ns, unit)
    return _timed(node, train)


def _one(name: str, needed: Callable[[Train], bool] = lambda train: True) -> Callable[[Train], list[str]]:  # noqa: ARG005
    return lambda train: [name] if needed(train) else []


def _votes(train: Train) -> bool:
    return train.file.fusion.voting is not None


def _fused(train: Train, unit: str) -> tuple[str, ...]:  # noqa: ARG001
    told = ("hypotheses",) if train.file.fusion.rule == "information" else ()
    return (("candidate",) if _votes(train) else ("state", "feedback")) + told


def _always(*streams: str) -> Callable[[Train, str], tuple[str, ...]]:
    return lambda train, unit: streams  # noqa: ARG005


def _truth(train: Train, unit: str) -> tuple[str, ...]:  # noqa: ARG001
    return ("truth",) if train.file.world is not None else ()


def _etcs(train: Train, unit: str, setting: Setting) -> Node:  # noqa: ARG001
    etcs = train.file.etcs
    if etcs is None:
        raise ConfigError(train.path, "etcs", "required for the role `etcs`")
    every_ns = round(etcs.every_s * NS_PER_S)
    return PositionReportNode(train.name, setting.instance, balise_groups(train.line), etcs.on_board, every_ns)


_ETCS = "position reports as ERTMS/ETCS sends them"
_WORLD = "scenario time, and the truth where there is one"
_SENSOR = "a unit's readings"
_BALISE = "telegrams into absolute fixes"
_VOTED = "what two of three fusers agree on"
_FUSED = "one state an epoch from all estimates and fixes"
ROLES: dict[str, Role] = {
    role.name: role
    for role in (
        Role("etcs", _ETCS, False, False, _one("etcs", lambda t: t.file.etcs is not None), _etcs, _always("position_report")),
        Role("voter", _VOTED, False, False, _one("voter", _votes), _voter, _always("state", "feedback"), live_only=True),
        Role("fuser", _FUSED, False, False, _one("fuser"), _fuser, _fused, lambda t: t.file.fusion.replicas),
        Role("filter", "a unit's local filter", True, False, lambda t: t.fused_units, _filter, _always("estimate")),
        Role(
            "balise",
            "telegrams into absolute fixes",
            False,
            False,
            _one("balise", lambda t: bool(t.balise_readers)),
            _balise,
            _always("fix"),
        ),
        Role(
            "sensor", "a unit's readings", True, True, lambda t: list(t.sensors), _sensor, lambda t, u: (t.sensors[u].stream,)
        ),
        Role("world", _WORLD, False, True, _one("world", lambda t: t.has_scenario_time), _world, _truth),
    )
}


@dataclass(frozen=True, slots=True)
class Process:
    """One process of a train: `name` is the name of its token, its health messages and its container."""

    name: str
    role: str
    unit: str


def process_name(role: str, unit: str) -> str:
    """`sensor-radar` for a role per unit, `fuser` and `fuser-2` for the others."""
    return f"{role}-{unit}" if ROLES[role].per_unit else unit


def processes(train: Train, live: bool = False) -> list[Process]:
    """All processes of a train besides the router, listeners before speakers; standbys and voter too on a `live` train."""
    return [
        Process(process_name(role.name, unit), role.name, unit)
        for role in ROLES.values()
        if live or not role.live_only
        for unit in (role.instances(train) if live else role.units(train))
    ]
