"""The interface of a sensor: how it observes the state, and where its readings come from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Generic, Literal, NamedTuple, Protocol, TypeVar

from pydantic import BaseModel, Field

from milepost.estimation.beliefs import Beliefs
from milepost.estimation.layout import PrivateState
from milepost.estimation.notice import Notice
from milepost.recordings.column_map import CsvSource
from milepost.recordings.column_options import RecordingOptions
from milepost.recordings.measured import Source
from milepost.recordings.options import STRICT, Span
from milepost.simulation.motion import Motion
from milepost.simulation.noise import standard_normal
from milepost.track.line import Line
from milepost_schemas import BY_NAME

from .observed import Belief, Observed, Stacked, stacked


class SensorOptions(BaseModel):
    """A unit's entry in a train file. `filter` names a row of the filter table, alone or as `kind` beside its options.

    `fault_probability`: that the unit lies at any moment; without it, the kind's. 0: it is trusted, and never excluded.
    """

    model_config = STRICT

    kind: str
    source: Literal["simulation", "recording", "receiver"] = "simulation"
    recording: RecordingOptions | None = None
    filter: str | dict[str, Any] | None = "kalman"
    withhold_s: list[Span] = Field(default_factory=list, description="spans [from, to) of scenario time without readings")
    fault_probability: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None


class Simulated(BaseModel):
    """What the simulated device really does, in a unit's `simulated` block; what is not given is as the filter believes."""

    model_config = STRICT


D = TypeVar("D", bound=SensorOptions)


def as_simulated(options: D, simulated: Simulated) -> D:
    """A unit's options with those of its `simulated` block in their place."""
    return options.model_copy(update=simulated.model_dump(exclude_none=True))


class WheelCreep(Protocol):
    """The creep of the wheels on the rail: their surface speed is v (1 + c)."""

    def at(self, unit: str, t_s: float) -> float:
        """The creep ratio c of a unit's wheel at a scenario time: spin above 0, slide below."""


@dataclass(frozen=True)
class World:
    """The simulated world of a sensor: the train's motion, the line, the seed of all noise, and the wheels' creep."""

    motion: Motion
    line: Line
    seed: int
    creep: WheelCreep | None = None

    def true_value(self, unit: str, state: PrivateState) -> float:
        """The true value of a private state, drawn from its prior, so that the prior is correct."""
        return state.prior_mean + state.prior_std * float(standard_normal(self.seed, f"{unit}.{state.name}", 1)[0])


class Observer(Protocol):
    """Turns one unit's readings into observations, and may have a memory; its only time is that of the readings.

    `memory` is its whole memory, as an immutable value: set to an earlier one, the observer continues from there.
    """

    memory: Any

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """A reading as observations, linearised, where need be, at `belief`."""

    def notices(self) -> list[Notice]:
        """The notices since the last call."""

    def restarted(self) -> None:
        """Note that the filter restarts on a running train: the memory of the readings is lost."""

    @property
    def gating(self) -> str | None:
        """The reason for which no reading counts at present; None where readings count. Feedback still reaches the filter."""

    @property
    def refused(self) -> str | None:
        """The reason for which the last reading did not count; None where it did."""


O = TypeVar("O", bound=SensorOptions)  # noqa: E741


class Pause(NamedTuple):
    """For how long a device that works may be unheard, below a speed."""

    longest_s: float
    below_mps: float


class Sensor(ABC, Generic[O]):
    """One kind of sensor. `stream` names the row of the stream table that its readings travel on."""

    kind: ClassVar[str]
    stream: ClassVar[str]
    options_model: ClassVar[type[SensorOptions]]
    # that such a device lies at any moment, where the train file does not say; and that all wheels of a train slip together
    fault_probability: ClassVar[float] = 1e-4
    slip_probability: ClassVar[float] = 0.0

    # a sensor by itself has no memory of its readings
    memory: Any = None

    def __init__(self, unit: str, options: O, line: Line) -> None:
        self.unit = unit
        self.options = options
        self.line = line

    @property
    def private_states(self) -> tuple[PrivateState, ...]:
        """The private states that this unit's observations involve."""
        return ()

    @property
    def period_s(self) -> float | None:
        """The time between readings; None for an aperiodic sensor, whose readings are never due."""
        return None

    @property
    def never_repeats(self) -> bool:
        """Whether the noise of the device makes every reading another one: one that repeats is stuck."""
        return False

    @property
    def pause(self) -> Pause | None:
        """How long a device that works may be unheard; None: no longer than its period."""
        return None

    @property
    def latency_s(self) -> float:
        """The time in seconds from when a reading is true to when it is ready."""
        return 0.0

    @property
    def needs_belief(self) -> bool:
        """Whether `observe` uses the belief, which costs one prediction per reading."""
        return bool(self.private_states)

    @abstractmethod
    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """A reading as observations, linearised, where need be, at `belief`."""

    def observe_each(self, reading: Any, beliefs: Beliefs) -> list[Stacked]:
        """A reading's rows at each of H beliefs: `observe`, for all at once."""
        each = [Belief(*beliefs.of(row)) for row in range(beliefs.array.shape[2])]
        return stacked([self.observe(reading, belief) for belief in each], len(beliefs.places))

    def observer(self) -> Observer:
        """The observer in a filter's process: the sensor itself, where no memory is needed."""
        return self

    def model(self) -> Observer:
        """How the fuser observes: the sensor itself where a reading says all there is to say, else an observer."""
        return self.observer()

    def snapshot(self, belief: Belief, at_ns: int) -> bytes | None:  # noqa: ARG002
        """The calibration in a belief that is stored for the next run; None where there is none."""
        return None

    def restore(self, kept: bytes, now_ns: int) -> Observed:  # noqa: ARG002
        """A stored calibration as an observation beside the prior. Raises ValueError with the reason if it is refused."""
        raise ValueError("this kind of sensor stores no calibration")

    def notices(self) -> list[Notice]:
        """None: a sensor by itself has no memory."""
        return []

    def restarted(self) -> None:
        """Do nothing: a sensor by itself has no memory."""

    @property
    def gating(self) -> str | None:
        """None: a sensor by itself judges no reading."""
        return None

    @property
    def refused(self) -> str | None:
        """None: a sensor by itself judges no reading."""
        return None

    def source(self, world: World | None, from_s: float) -> Source:
        """The source that the train file names: a recording, for any kind of sensor, or the one that the kind opens."""
        if self.options.source != "recording":
            return self.open(world, from_s)
        if self.options.recording is None:
            raise ValueError(f"{self.unit}: `recording` is required with `source: recording`")
        return CsvSource(self.options.recording, BY_NAME[self.stream].message, from_s)

    def needed(self, world: World | None) -> World:
        """The world of a simulated sensor. Raises ValueError where there is none."""
        if world is None:
            raise ValueError(f"{self.unit}: a {self.kind} has no source without a simulated world")
        return world

    @abstractmethod
    def open(self, world: World | None, from_s: float) -> Source:
        """The readings from scenario time `from_s` on. Raises ValueError where the sensor has no such source."""
