"""The log of one offline run: what its estimators are scored from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from milepost.config.train import Train
from milepost.estimation.centralised import Reading
from milepost.estimation.layout import N_COMMON, PLACES_OF_COMMON, Array, Layout
from milepost.estimation.observation import Observation
from milepost.nodes.base import Output
from milepost.nodes.observations import POSITION, of_fix, of_reading
from milepost.offline.memory_bus import Tap
from milepost.sensors.base import Observer
from milepost.sensors.observed import Belief
from milepost_schemas import AbsoluteFix, Estimate, Feedback, FusedState, Gaussian, Message, Truth


class PrivateStates(NamedTuple):
    """Some states' means and variances."""

    means: list[float]
    variances: list[float]


def private_part(belief: Gaussian) -> PrivateStates:
    """The private states of a belief."""
    P = belief.covariance
    return PrivateStates(list(belief.mean[N_COMMON:]), [P[i][i] for i in range(N_COMMON, len(P))])


@dataclass
class RunLog:
    """The truth, readings and fixes, states and private states of one offline run. `truth` is empty where there is none.

    `private`: epoch → (means, variances), in the order of the train's layout: as they went back with the feedback, or, where
    the rule fuses none, as each filter believed. `counted`: unit → the times of the observations that its filter sent to the
    fuser.
    """

    train: Train
    also: Tap | None = None
    truth: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    readings: list[tuple[int, Message]] = field(default_factory=list)
    live: dict[int, FusedState] = field(default_factory=dict)
    settled: dict[int, FusedState] = field(default_factory=dict)
    private: dict[int, tuple[list[float], list[float]]] = field(default_factory=dict)
    counted: dict[str, set[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._orders = {unit: order for order, unit in enumerate(self.train.sensors)}
        self._believed = {unit: PrivateStates([], []) for unit, sensor in self.train.sensors.items() if sensor.private_states}

    def tap(self, output: Output, now_ns: int) -> None:
        """Take one message of the bus."""
        message = output.message
        if self.also is not None:
            self.also(output, now_ns)
        if isinstance(message, Truth):
            self.truth[message.measured_at_ns] = (message.position_m, message.speed_mps, message.acceleration_mps2)
        elif isinstance(message, FusedState):
            self.live[message.measured_at_ns] = message
        elif isinstance(message, Feedback):
            self._note_private(message)
        elif isinstance(message, Estimate):
            if message.unit in self._believed:
                self._believed[message.unit] = private_part(message.belief)
            self.counted.setdefault(message.unit, set()).update(o.measured_at_ns for o in message.observations)
        elif isinstance(message, AbsoluteFix):
            self.readings.append((self._orders[message.reader], message))
        elif output.stream.endswith("_reading"):
            self.readings.append((self._orders[message.unit], message))

    def _note_private(self, feedback: Feedback) -> None:
        fused, believed = private_part(feedback.fused), self._believed.values()
        if fused.means:
            self.private[feedback.measured_at_ns] = fused
        elif believed and all(part.means for part in believed):
            means, variances = ([value for part in believed for value in part[i]] for i in (0, 1))
            self.private[feedback.measured_at_ns] = PrivateStates(means, variances)

    def keep(self, state: FusedState) -> None:
        """Take one settled state."""
        self.settled[state.measured_at_ns] = state

    def centralised_readings(self, unit: str | None = None) -> list[Reading]:
        """Readings and fixes for a centralised pass, of one unit or of all, observed and judged at the belief of that pass.

        The fuser judges the readings in the same way, in the order of time at its own belief, so that both count the same ones.
        """
        observers = {name: sensor.model() for name, sensor in self.train.sensors.items()}
        return [
            _reading(order, message, observers)
            for order, message in self.readings
            if unit is None or unit == (message.reader if isinstance(message, AbsoluteFix) else message.unit)
        ]

    def begins_ns(self, mean: Array, covariance: Array, layout: Layout) -> int | None:
        """The time of the earliest reading that counts, given the prior over all states: there the prior sits."""
        observers = {name: sensor.model() for name, sensor in self.train.sensors.items()}
        for order, message in sorted(self.readings, key=lambda entry: (entry[1].measured_at_ns, entry[0], entry[1].sequence)):
            reading = _reading(order, message, observers)
            own = list(layout.indices.get(reading.unit, PLACES_OF_COMMON))
            if tuple(reading.observe(mean[own], covariance[np.ix_(own, own)])):
                return reading.measured_at_ns
        return None

    @property
    def observations(self) -> list[Observation]:
        """The observations of fixes and of the readings of linear sensors, which need no belief."""
        out = []
        for order, message in self.readings:
            if isinstance(message, AbsoluteFix):
                out.append(of_fix(message, order))
            else:
                out += of_reading(message, order, self.train.sensors[message.unit].observe(message, None))
        return out


def _reading(order: int, message: Any, observers: Mapping[str, Observer]) -> Reading:
    if isinstance(message, AbsoluteFix):
        o = of_fix(message, order)
        rows = [(POSITION, o.value, o.variance)]
        return Reading(o.measured_at_ns, order, o.sequence, o.instance, message.reader, lambda mean, covariance: rows)  # noqa: ARG005
    observe = observers[message.unit].observe
    head = (message.measured_at_ns, order, message.sequence, message.instance)
    return Reading(*head, message.unit, lambda mean, covariance: observe(message, Belief(mean, covariance)))
