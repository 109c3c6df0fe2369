"""What one offline run said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from milepost.estimation.centralised import Reading, Row
from milepost.estimation.layout import N_COMMON, Array
from milepost.estimation.timeline import Observation
from milepost.nodes.base import Output
from milepost.nodes.observations import POSITION, of_fix, of_reading
from milepost.runtime.config import Train
from milepost.runtime.memory_bus import Tap
from milepost.sensors.base import Belief
from milepost_schemas import AbsoluteFix, Feedback, FusedState, Message, Truth


@dataclass
class Heard:
    """What one offline run said: truth, readings and fixes, states, and the fused private states that went back.

    `private`: epoch → (means, variances), in the order of the train's layout.
    """

    train: Train
    also: Tap | None = None
    truth: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    said: list[tuple[int, Message]] = field(default_factory=list)
    live: dict[int, FusedState] = field(default_factory=dict)
    settled: dict[int, FusedState] = field(default_factory=dict)
    private: dict[int, tuple[list[float], list[float]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._orders = {unit: order for order, unit in enumerate(self.train.sensors)}

    def tap(self, output: Output, now_ns: int) -> None:
        """One message on the bus."""
        message = output.message
        if self.also is not None:
            self.also(output, now_ns)
        if isinstance(message, Truth):
            self.truth[message.measured_at_ns] = (message.position_m, message.speed_mps, message.acceleration_mps2)
        elif isinstance(message, FusedState):
            self.live[message.measured_at_ns] = message
        elif isinstance(message, Feedback):
            mean, P = message.fused.mean, message.fused.covariance
            if len(mean) > N_COMMON:
                variances = [P[i][i] for i in range(N_COMMON, len(mean))]
                self.private[message.measured_at_ns] = (list(mean[N_COMMON:]), variances)
        elif isinstance(message, AbsoluteFix):
            self.said.append((self._orders[message.reader], message))
        elif output.stream.endswith("_reading"):
            self.said.append((self._orders[message.unit], message))

    def keep(self, state: FusedState) -> None:
        """One settled state."""
        self.settled[state.measured_at_ns] = state

    def readings(self, unit: str | None = None) -> list[Reading]:
        """Readings and fixes for a centralised pass, seen by observers of its own; of one unit, or of all."""
        observers = {name: sensor.observer() for name, sensor in self.train.sensors.items()}
        out = []
        for order, message in self.said:
            if isinstance(message, AbsoluteFix):
                o = of_fix(message, order)
                reading = Reading(*o[:4], message.reader, _always((POSITION, o.value, o.variance)))
            else:
                head = (message.measured_at_ns, order, message.sequence, message.instance)
                reading = Reading(*head, message.unit, _seen_by(observers[message.unit], message))
            if unit is None or reading.unit == unit:
                out.append(reading)
        return out

    @property
    def observations(self) -> list[Observation]:
        """What fixes and the readings of linear sensors say, whatever is believed."""
        out = []
        for order, message in self.said:
            if isinstance(message, AbsoluteFix):
                out.append(of_fix(message, order))
            else:
                out += of_reading(message, order, self.train.sensors[message.unit].observe(message, None))
        return out


def _always(row: Row) -> Callable[[Array, Array], list[Row]]:
    return lambda mean, covariance: [row]  # noqa: ARG005


def _seen_by(observer: Any, message: Message) -> Callable[[Array, Array], Any]:
    return lambda mean, covariance: observer.observe(message, Belief(mean, covariance))
