"""What one offline run said."""

from __future__ import annotations

from dataclasses import dataclass, field

from milepost.estimation.timeline import Observation
from milepost.nodes.base import Output
from milepost.nodes.observations import of_fix, of_reading
from milepost.runtime.config import Train
from milepost.runtime.memory_bus import Tap
from milepost_schemas import AbsoluteFix, FusedState, Truth


@dataclass
class Heard:
    """What one offline run said: truth, observations (made from readings and fixes, not from estimates), states."""

    train: Train
    also: Tap | None = None
    truth: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    observations: list[Observation] = field(default_factory=list)
    live: dict[int, FusedState] = field(default_factory=dict)
    settled: dict[int, FusedState] = field(default_factory=dict)

    def tap(self, output: Output, now_ns: int) -> None:
        """One message on the bus."""
        message = output.message
        if self.also is not None:
            self.also(output, now_ns)
        if isinstance(message, Truth):
            self.truth[message.measured_at_ns] = (message.position_m, message.speed_mps, message.acceleration_mps2)
        elif isinstance(message, FusedState):
            self.live[message.measured_at_ns] = message
        elif isinstance(message, AbsoluteFix):
            order = list(self.train.sensors).index(message.reader)
            self.observations.append(of_fix(message, order))
        elif output.stream.endswith("_reading"):
            order = list(self.train.sensors).index(message.unit)
            self.observations += of_reading(message, order, self.train.sensors[message.unit].observe(message, None))

    def keep(self, state: FusedState) -> None:
        """One settled state."""
        self.settled[state.measured_at_ns] = state
