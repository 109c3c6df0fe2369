"""Trains and sensors made up for the properties: two linear sensors, one with a private bias, one with a private scale."""

from __future__ import annotations

import random

import numpy as np

from milepost.estimation.estimator import Prior
from milepost.estimation.filters.base import FilterSetup
from milepost.estimation.filters.kalman import KalmanFilter, KalmanOptions
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.time_units import NS_PER_S
from milepost.fusion.hypotheses import Doubts, Suspect
from milepost.fusion.rule import NO_DOUBTS
from milepost.fusion.shares import FixedShares
from milepost.nodes.filter import FilterNode
from milepost.nodes.fuser import FuserNode
from milepost.nodes.fuser_settings import FuserSettings
from milepost.nodes.unit_record import UnitRow
from milepost.sensors.base import Sensor, SensorOptions
from milepost.sensors.observed import Observed
from milepost.track.line import Line
from milepost_schemas import AbsoluteFix, SpeedReading

T0 = 1_000 * NS_PER_S
Q = 1e-3
PRIOR = Prior(np.array([0.0, 20.0, 0.0]), np.array([1.0, 0.5, 0.1]))
HORIZON_NS = 5 * NS_PER_S
BIAS = PrivateState("bias", 0.0, 0.3, time_constant_s=50.0, noise_psd=1e-4)
SCALE = PrivateState("scale", 0.0, 0.001)


class Plain(Sensor[SensorOptions]):
    """z = v + e."""

    kind, stream, options_model = "plain", "speed_reading", SensorOptions

    def observe(self, reading, belief):
        return (Observed((0.0, 1.0, 0.0), reading.speed_mps, reading.speed_variance_m2ps2),)

    def open(self, world, from_s):
        raise NotImplementedError


class Biased(Plain):
    """z = v + b + e, b private."""

    kind = "biased"

    @property
    def private_states(self):
        return (BIAS,)

    def observe(self, reading, belief):
        return (Observed((0.0, 1.0, 0.0, 1.0), reading.speed_mps, reading.speed_variance_m2ps2),)


class Scaled(Plain):
    """z = (1 + k) v + e, k private; linearised at the belief."""

    kind = "scaled"

    @property
    def private_states(self):
        return (SCALE,)

    def observe(self, reading, belief):
        v, k = (PRIOR.mean[1], 0.0) if belief is None else (belief.mean[1], belief.mean[3])
        return (Observed((0.0, 1.0 + k, 0.0, v), reading.speed_mps + k * v, reading.speed_variance_m2ps2),)


LINE = Line("invented", 1e6, ())


def sensors(*kinds) -> dict[str, Sensor]:
    """Units named after their kinds."""
    return {kind.kind: kind(kind.kind, SensorOptions(kind=kind.kind), LINE) for kind in kinds}


def layout_of(units: dict[str, Sensor]) -> Layout:
    return Layout(tuple((name, sensor.private_states) for name, sensor in units.items() if sensor.private_states))


def doubts_of(units: dict[str, Sensor], rate_hz: float) -> Doubts:
    """Any of these units may be lying, and so may the balise reader."""
    suspects = [Suspect(name, 1e-3, rate_hz) for name in units]
    return Doubts((*suspects, Suspect("reader", 1e-3, 1.0, odd_alone=True, hold=2)))


def fuser_of(
    units: dict[str, Sensor],
    rule: str = "information",
    horizon_ns: int = HORIZON_NS,
    period_ns: int | None = None,
    doubts: Doubts = NO_DOUBTS,
) -> FuserNode:
    """A fuser for these units and a balise reader behind them."""
    rows = [UnitRow(name, i, period_ns, True) for i, name in enumerate(units)] + [UnitRow("reader", len(units), None, False)]
    shares = FixedShares({name: 1.0 / len(units) for name in units})
    layout = layout_of(units)
    settings = FuserSettings(
        rule, 20_000_000, 15_000_000, horizon_ns, True, 1, shares, 5.0, 1e6, Q, PRIOR, layout, rows, doubts=doubts
    )
    return FuserNode("t", "f", settings, LINE)


def filter_of(units: dict[str, Sensor], name: str, instance: str = "i0") -> FilterNode:
    """The local filter of one unit."""
    setup = FilterSetup(layout_of(units).only([name]), Q, PRIOR, HORIZON_NS, 1.0 / len(units))
    return FilterNode("t", instance, units[name], KalmanFilter(setup, KalmanOptions()), list(units).index(name), True)


def reading(unit: str, sequence: int, t_s: float, speed: float, variance: float, instance: str = "s0") -> SpeedReading:
    at = T0 + round(t_s * NS_PER_S)
    head = {"train": "t", "unit": unit, "instance": instance, "sequence": sequence}
    return SpeedReading(**head, measured_at_ns=at, published_at_ns=at, speed_mps=speed, speed_variance_m2ps2=variance)


def fix(sequence: int, t_s: float, position: float, variance: float = 4e-4) -> AbsoluteFix:
    at = T0 + round(t_s * NS_PER_S)
    return AbsoluteFix(
        train="t",
        unit="balise",
        instance="b",
        sequence=sequence,
        measured_at_ns=at,
        published_at_ns=at,
        reader="reader",
        reader_instance="r",
        reading_sequence=sequence,
        balise_id=f"b{sequence}",
        position_m=position,
        position_variance_m2=variance,
        location_accuracy_m=0.0,
    )


def drive(seed: int, units: dict[str, Sensor], length_s: float, rate_hz: float) -> tuple[list[SpeedReading], list[AbsoluteFix]]:
    """Readings at uneven times, and fixes, of a train that wanders around 20 m/s."""
    rng = random.Random(seed)
    truth = {"bias": rng.gauss(0.0, 0.3), "scale": rng.gauss(0.0, 0.001), "wave": rng.uniform(0.1, 0.5)}
    readings, fixes = [], []

    def speed(t: float) -> float:
        return 20.0 + truth["wave"] * np.sin(0.3 * t)

    def position(t: float) -> float:
        return 20.0 * t + truth["wave"] / 0.3 * (1.0 - np.cos(0.3 * t))

    for name in units:
        t, sequence = 0.0, 0
        while t < length_s:
            t += rng.uniform(0.2, 1.8) / rate_hz
            v = float(speed(t))
            seen = v + truth["bias"] if name == "biased" else v * (1.0 + truth["scale"]) if name == "scaled" else v
            variance = rng.choice([0.01, 0.04, 0.1])
            readings.append(reading(name, sequence, t, seen + rng.gauss(0.0, variance**0.5), variance))
            sequence += 1
    for i in range(int(length_s / 1.3)):
        t = 1.3 * i + rng.uniform(0.1, 1.2)
        fixes.append(fix(i, t, float(position(t)) + rng.gauss(0.0, 0.02)))
    readings.sort(key=lambda r: r.measured_at_ns)
    return readings, fixes


def lying(readings: list[SpeedReading], unit: str, from_s: float, to_s: float, size: float) -> list[SpeedReading]:
    """The readings, those of a unit biased for a while."""
    begin, end = T0 + round(from_s * NS_PER_S), T0 + round(to_s * NS_PER_S)
    return [
        r.model_copy(update={"speed_mps": r.speed_mps + size}) if r.unit == unit and begin <= r.measured_at_ns < end else r
        for r in readings
    ]
