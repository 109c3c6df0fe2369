"""What a train file says of the fusion, as the settings of the fuser."""

from __future__ import annotations

import hashlib
import math
import sys
from functools import cache

import numpy as np

from milepost.estimation.estimator import Prior
from milepost.estimation.layout import Layout
from milepost.estimation.time_units import NS_PER_S
from milepost.fusion.hypotheses import Doubts, Suspect
from milepost.fusion.shares import FixedShares, Shares, SharesByAccuracy, SharesBySpeed, SpeedRow
from milepost.nodes.fuser_settings import FuserSettings
from milepost.nodes.judges import UnitJudge
from milepost.nodes.unit_record import UnitRow
from milepost_schemas import BY_NAME

from .shipped_files import PACKAGE
from .train import Train
from .train_file import BySpeedFile

# the packages whose sources make a fuser's figures
COMPUTING = ("estimation", "fusion", "nodes", "sensors", "track")


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
            sensor.pause,
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
        fingerprint=fingerprint(train),
    )


def fingerprint(train: Train) -> str:
    """A hash of all that a fuser's figures depend on: train file, line, sources, versions of Python and numpy."""
    # where the line's file lies, and what the simulated train does, does not matter
    stated = {name: value for name, value in train.file if name not in ("line", "world", "chaos", "health_every_s")}
    return hashlib.sha256(f"{_code()} {train.line.content_hash} {stated}".encode()).hexdigest()


@cache
def _code() -> str:
    whole = hashlib.sha256(f"{sys.version_info[:2]} {np.__version__}".encode())
    for room in COMPUTING:
        for path in sorted((PACKAGE / room).rglob("*.py")):
            whole.update(path.read_bytes())
    return whole.hexdigest()


def _judge(train: Train, unit: str) -> UnitJudge | None:
    """The judge of a unit's readings in the fuser; None where the fuser takes the filter's rows."""
    sensor, (kind, options) = train.sensors[unit], train.filters[unit]
    judge = UnitJudge(sensor, BY_NAME[sensor.stream].message, kind.learner(options))
    return None if judge.learner is None and judge.pure and not sensor.needs_belief else judge


def doubts(train: Train) -> Doubts:
    """Which units of a train may be lying, and the budgets of its train file."""
    suspects, wheels = [], []
    for unit, sensor in train.sensors.items():
        probability = sensor.options.fault_probability
        if probability is None:
            probability = sensor.fault_probability
        if probability == 0.0:
            continue  # trusted: nothing is held against it
        readings_per_s = 1.0 if sensor.period_s is None else 1.0 / sensor.period_s
        balises = sensor.stream == "balise_telegram"
        never_repeats = sensor.never_repeats and sensor.options.source == "simulation"
        slips = sensor.slip_probability > 0.0
        suspects.append(Suspect(unit, probability, readings_per_s, balises, never_repeats, slips, 2 if balises else 10))
        if slips:
            wheels.append((unit, sensor.slip_probability))
    # poor adhesion makes all wheels slip at once
    groups = (
        ((frozenset(unit for unit, _ in wheels), max(probability for _, probability in wheels)),) if len(wheels) > 1 else ()
    )
    fusion, motion = train.file.fusion, train.file.motion_model
    return Doubts(
        tuple(suspects),
        groups,
        fusion.false_alarms_per_hour,
        fusion.integrity_risk_per_hour,
        motion.hard_probability,
        motion.hard_jerk_psd_m2ps5,
        frozenset(unit for unit, sensor in train.sensors.items() if sensor.stream == "speed_reading"),
        frozenset(unit for unit, sensor in train.sensors.items() if sensor.stream == "position_reading"),
    )
