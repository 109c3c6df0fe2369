"""Options of a loop: what device and filter believe of it, and how the simulated one is really laid."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, Field, model_validator

from milepost.recordings.options import STRICT

from ..pulses import PulseOptions
from .count import Faults

Pitch = Annotated[float, Field(ge=1e-3)]
PitchStd = Annotated[float, Field(gt=0.0)]
Probability = Annotated[float, Field(ge=0.0, le=0.1)]
Length = Annotated[float, Field(gt=0.0)]
# no pitch, as laid, is off by more than this many standard deviations
SIGMAS = 5.0
# the probability of more misses in a row than a bound allows for
NEVER = 1e-6


class Laid(NamedTuple):
    """A loop as laid along the track: pitch and its standard deviation, missed crossings, joints."""

    pitch_m: float
    pitch_std_m: float
    missed_probability: float
    joint_every_m: float | None
    joint_length_m: float


class SimulatedLoopOptions(BaseModel):
    """How the simulated loop is really laid; what is not given is as the filter believes."""

    model_config = STRICT

    pitch_m: Pitch | None = None
    pitch_std_m: PitchStd | None = None
    missed_probability: Probability | None = None
    joint_every_m: Length | None = None
    joint_length_m: Length | None = None


class InductionLoopOptions(PulseOptions):
    """`pitch_std_m`: how far each pitch, as laid, is off its nominal length (one standard deviation).

    2.24 mm on 0.1 m makes 0.1 (m/s)² over 10 ms at 20 m/s, which is source A's figure, and 0.3 m rms after 2 km.
    `phase_s`: when, after each whole period, the pulses are read out.
    `missed_probability`: of each crossing. Joints without crossings, `joint_length_m` long, lie at each multiple of
    `joint_every_m`. `antennas: 2`: a second one `antenna_spacing_m` behind the first bridges them.
    `simulated`: how the simulated loop is really laid, where that differs from what the filter believes.
    """

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    phase_s: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    pitch_m: Pitch = 0.1
    pitch_std_m: PitchStd = 0.00224
    missed_probability: Probability = 0.0
    joint_every_m: Length | None = None
    joint_length_m: Length = 1.0
    antennas: Literal[1, 2] = 1
    antenna_spacing_m: Length = 2.0
    simulated: SimulatedLoopOptions = Field(default_factory=SimulatedLoopOptions)

    @model_validator(mode="after")
    def _one_antenna_is_always_over_the_loop(self) -> InductionLoopOptions:
        for where, loop in (("", self.believed), ("simulated: ", self.laid)):
            every, length = loop.joint_every_m, loop.joint_length_m
            if every is None:
                continue
            if length >= 0.5 * every:
                raise ValueError(f"{where}joint_length_m must be less than half of joint_every_m")
            if self.antennas == 2 and not length < self.antenna_spacing_m < every - length:
                raise ValueError(f"{where}antenna_spacing_m must be such that both antennas are never over a joint at once")
        return self

    @property
    def believed(self) -> Laid:
        """The loop as device and filter believe it to be."""
        return Laid(self.pitch_m, self.pitch_std_m, self.missed_probability, self.joint_every_m, self.joint_length_m)

    @property
    def laid(self) -> Laid:
        """The loop that the simulated antennas cross."""
        given = self.simulated.model_dump(exclude_none=True)
        return self.believed._replace(**given)

    @property
    def faults(self) -> Faults | None:
        """What can make a reading's count of pitches too low; None where nothing can."""
        bare = self.joint_every_m is not None and self.antennas == 1
        if self.missed_probability == 0.0 and not bare:
            return None
        every = self.joint_every_m if bare else None
        return Faults(
            self.missed_probability,
            round(self.joint_length_m / self.pitch_m),
            0.0 if every is None else self.pitch_m / every,
        )

    @property
    def longest_gap_m(self) -> float:
        """The longest distance without a pulse: a pitch as laid, the most misses in a row, and a joint."""
        pitch_m, faults = self.pitch_m + SIGMAS * self.pitch_std_m, self.faults
        if faults is None:
            return pitch_m
        misses = math.ceil(math.log(NEVER) / math.log(faults.missed)) if faults.missed > 0.0 else 0
        return pitch_m + misses * self.pitch_m + (self.joint_length_m if faults.joint_probability > 0.0 else 0.0)
