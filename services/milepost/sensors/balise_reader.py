"""Balise reader: the antenna that reads a balise as the train passes over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from milepost.recordings.measured import Measured, Source
from milepost.simulation.motion import when_at
from milepost.simulation.noise import WhiteNoise

from .base import Sensor, SensorOptions, Simulated, World, as_simulated
from .observed import Belief, Observed

LOOK_AHEAD_S = 1.0


class SimulatedReader(Simulated):
    """What the simulated reader really does."""

    read_std_m: Annotated[float, Field(ge=0.0)] | None = None
    latency_s: Annotated[float, Field(ge=0.0, le=10.0)] | None = None


class BaliseReaderOptions(SensorOptions):
    """`read_std_m`: how far from the balise's middle the passage is stamped; `latency_s`: from passage to telegram.

    RAIL.md's priors for a reader are 2 cm and 10 ms. `simulated`: what the simulated reader really does, where that differs
    from what it states.
    """

    filter: None = None
    read_std_m: Annotated[float, Field(gt=0.0)] = 0.02
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01
    simulated: SimulatedReader = Field(default_factory=SimulatedReader)


class BaliseReader(Sensor[BaliseReaderOptions]):
    """Telegrams carry a balise's identity and the time of passage; the balise service knows its position."""

    kind = "balise_reader"
    stream = "balise_telegram"
    options_model = BaliseReaderOptions

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:  # noqa: ARG002
        """No observation: a telegram becomes a fix in the balise service."""
        return ()

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated passages over the line's balises."""
        world = self.needed(world)
        return _Simulated(self.unit, self.options, world, from_s)


class _Simulated:
    """Searches the motion for the next passage, a second at a time."""

    def __init__(self, unit: str, options: BaliseReaderOptions, world: World, from_s: float) -> None:
        self._world, self._options = world, as_simulated(options, options.simulated)
        self._stated_variance = options.read_std_m**2
        self._noise = WhiteNoise(world.seed, unit)
        # a balise just behind may be read late: a reader that starts over it must not lose it
        behind = world.motion.at(from_s)[0] - 10.0 * self._options.read_std_m
        self._next = next((i for i, b in enumerate(world.line.balises) if b.position_m > behind), len(world.line.balises))
        self._searched_s = from_s
        self._passage_s: float | None = None

    def next_s(self) -> float | None:
        """The time at which the next telegram is ready, or at which to search again."""
        if self._passage_s is None:
            self._search()
        if self._passage_s is not None:
            return self._passage_s + self._options.latency_s
        over = self._next >= len(self._world.line.balises) or self._searched_s >= self._world.motion.end_s
        return None if over else self._searched_s

    def _search(self) -> None:
        balises, motion = self._world.line.balises, self._world.motion
        if self._next >= len(balises) or self._searched_s >= motion.end_s:
            return
        # the balise is read a little early or late, so the passage is that of the place with this error
        heard_m = balises[self._next].position_m + self._options.read_std_m * self._noise[self._next]
        if heard_m < motion.at(self._searched_s)[0]:
            self._next += 1
            return
        until = min(self._searched_s + LOOK_AHEAD_S, motion.end_s)
        self._passage_s = when_at(motion, heard_m, self._searched_s, until)
        if self._passage_s is None:
            self._searched_s = until

    def read(self) -> Measured | None:
        """The telegram of the passage that was found, if any."""
        if self._passage_s is None:
            return None
        passage, balise = self._passage_s, self._world.line.balises[self._next]
        self._next, self._passage_s, self._searched_s = self._next + 1, None, passage
        return Measured(passage, {"balise_id": balise.balise_id, "reader_variance_m2": self._stated_variance})
