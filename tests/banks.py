"""A train in pure numbers for tests of the bank: devices that measure at a rate, faults in what they say, no processes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.observation import Observation
from milepost.estimation.time_units import NS_PER_S, S_PER_NS
from milepost.fusion.bank import BankKernel
from milepost.fusion.bank_state import Bank, protected
from milepost.fusion.hypotheses import Doubts, Suspect
from milepost.sensors.observed import Stacked

T0 = 1_000 * NS_PER_S
MEAN, STD = np.array([0.0, 20.0, 0.0]), np.array([0.5, 0.3, 0.05])
JERK_PSD = 1e-3
POSITION, SPEED, ACCELERATION = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def true_position(t_s: float) -> float:
    """20 m/s and a slow wave."""
    return 20.0 * t_s + 2.5 * (1.0 - math.cos(0.2 * t_s))


def true_acceleration(t_s: float) -> float:
    """The derivative of the speed."""
    return 0.1 * math.cos(0.2 * t_s)


def true_speed(t_s: float) -> float:
    """The derivative of the position."""
    return 20.0 + 0.5 * math.sin(0.2 * t_s)


@dataclass(frozen=True)
class Device:
    """A unit: its suspect, what it measures, the standard deviation of its noise, and when it begins."""

    suspect: Suspect
    measures: Callable[[float], float]
    std: float
    row: tuple[float, ...] | None
    phase_s: float = 0.0

    @property
    def unit(self) -> str:
        return self.suspect.unit


class ScaledSpeed:
    """The pure judge of a wheel: z = (1 + κ) v + e, linearised at each belief."""

    pure = True
    learner = None

    def __init__(self, std: float) -> None:
        self._variance = std**2

    def start(self) -> None:
        """It remembers nothing."""

    restart = start

    def judge(self, memory: Any, reading: float, mean: Any, covariance: Any) -> Any:
        raise NotImplementedError

    def each(self, reading: float, beliefs: Any) -> list[Stacked]:
        v, scale = beliefs.mean(1), beliefs.mean(3)
        h = np.zeros((4, len(v)))
        h[1], h[3] = 1.0 + scale, v
        return [Stacked(h, reading + scale * v, np.full(len(v), self._variance))]


def speedometer(unit: str, std: float = 0.1, hz: float = 20.0, phase_s: float = 0.0, rate: float = 1e-4) -> Device:
    """A device that measures the speed."""
    return Device(Suspect(unit, rate, hz, never_repeats=True), true_speed, std, SPEED, phase_s)


def accelerometer(unit: str = "accelerometer", std: float = 0.02, hz: float = 20.0, rate: float = 1e-4) -> Device:
    """A device that measures the acceleration."""
    return Device(Suspect(unit, rate, hz, never_repeats=True), true_acceleration, std, ACCELERATION, 0.04)


def receiver(unit: str = "receiver", std: float = 0.5, hz: float = 5.0, rate: float = 1e-4) -> Device:
    """A device that measures the position."""
    return Device(Suspect(unit, rate, hz, never_repeats=True), true_position, std, POSITION, 0.013)


def reader(unit: str = "reader", std: float = 0.05, hz: float = 0.5, rate: float = 1e-4) -> Device:
    """A device that measures the position now and then, of which a lone odd reading is that reading's fault."""
    return Device(Suspect(unit, rate, hz, odd_alone=True, hold=2), true_position, std, POSITION, 0.017)


def wheel(unit: str = "wheel", std: float = 0.05, hz: float = 20.0, phase_s: float = 0.031) -> Device:
    """A device that measures the speed with a scale of its own."""
    return Device(Suspect(unit, 3e-3, hz, slips=True), true_speed, std, None, phase_s)


# what a fault makes of (t_s, z, noise); None: no reading
Fault = Callable[[float, float, float], float | None]


def between(from_s: float, to_s: float, fault: Fault) -> Fault:
    """The fault for a while."""
    return lambda t_s, z, noise: fault(t_s, z, noise) if from_s <= t_s < to_s else z


def bias(size: float) -> Fault:
    """Reads so much more."""
    return lambda t_s, z, noise: z + size


def scale(factor: float) -> Fault:
    """Reads so many times as much."""
    return lambda t_s, z, noise: z * factor


def noisy(factor: float) -> Fault:
    """Has so many times its noise."""
    return lambda t_s, z, noise: z + (factor - 1.0) * noise


def stuck(at: float) -> Fault:
    """Says always the same."""
    return lambda t_s, z, noise: at


class Moment(NamedTuple):
    """The bank after a reading of `unit` at `t_s`."""

    t_s: float
    unit: str
    bank: Bank

    @property
    def excluded(self) -> frozenset[str]:
        """The units that are left out."""
        return self.bank.rows.excluded

    def holds(self) -> bool:
        """Whether the truth is in the intervals of position and speed."""
        truths = true_position(self.t_s), true_speed(self.t_s)
        return all(low <= truth <= high for (low, high), truth in zip(self.intervals(), truths, strict=True))

    def intervals(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The intervals of position and speed."""
        return protected(self.bank)


@dataclass(frozen=True)
class Ride:
    """A train's devices and budgets; `layout` and `judges` for those with private states."""

    devices: Sequence[Device]
    layout: Layout = field(default_factory=Layout)
    groups: tuple[tuple[frozenset[str], float], ...] = ()
    seed: int = 1
    prior_std: tuple[float, float, float] = tuple(STD.tolist())

    def doubts(self) -> Doubts:
        """What is held possible on this train."""
        speeds = frozenset(d.unit for d in self.devices if d.row in (None, SPEED))
        positions = frozenset(d.unit for d in self.devices if d.row == POSITION and not d.suspect.odd_alone)
        return Doubts(tuple(d.suspect for d in self.devices), self.groups, speed_units=speeds, position_units=positions)

    def observations(self, duration_s: float, faults: Mapping[str, Fault]) -> list[Observation]:
        """All that the devices say, in order of time; a device's noise is the same whatever the others do."""
        out = []
        for order, device in enumerate(self.devices):
            rng = np.random.default_rng([self.seed, *device.unit.encode()])
            fault = faults.get(device.unit)
            period_s = 1.0 / device.suspect.readings_per_s
            for sequence in range(int((duration_s - device.phase_s) / period_s)):
                t_s = device.phase_s + sequence * period_s
                noise = device.std * rng.normal()
                z: float | None = device.measures(t_s) + noise
                if fault is not None and z is not None:
                    z = fault(t_s, z, noise)
                if z is None:
                    continue
                head = (T0 + round(t_s * NS_PER_S), order, sequence, "i", 0, device.unit)
                if device.row is None:
                    out.append(Observation(*head, (), reading=z))
                else:
                    row = self.layout.lift(device.unit, device.row)
                    out.append(Observation(*head, row, z, device.std**2))
        return sorted(out, key=lambda o: o.place)

    def kernel(self, doubts: Doubts | None = None) -> BankKernel:
        """The bank's mathematics for this train; made once where the doubts are its own, for its bounds cost 10 ms."""
        return self._kernel if doubts is None else self._with(doubts)

    @cached_property
    def _kernel(self) -> BankKernel:
        return self._with(self.doubts())

    def _with(self, doubts: Doubts) -> BankKernel:
        judges = {d.unit: ScaledSpeed(d.std) for d in self.devices if d.row is None}
        return BankKernel(self.layout, JERK_PSD, judges, doubts, 5.0)

    def moments(self, duration_s: float, faults: Mapping[str, Fault] | None = None) -> Iterator[Moment]:
        """The bank after each observation, one after the other."""
        kernel = self._with(self.doubts())
        bank, at_ns = kernel.prior(*self.layout.prior(MEAN, np.array(self.prior_std))), None
        for o in self.observations(duration_s, faults or {}):
            if at_ns is not None and o.measured_at_ns > at_ns:
                bank = kernel.advance(bank, (o.measured_at_ns - at_ns) * S_PER_NS)
            at_ns = o.measured_at_ns
            bank = kernel.take(bank, o)
            yield Moment((at_ns - T0) * S_PER_NS, o.unit, bank)


def scaled_layout(unit: str = "wheel", std: float = 0.01, noise_psd: float = 1e-9) -> Layout:
    """A wheel's scale, κ = 0 ± 1 %."""
    return Layout(((unit, (PrivateState("scale", 0.0, std, noise_psd=noise_psd),)),))
