"""Simulated GNSS receiver: white noise, a slow offset, multipath, tunnels."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, Field, model_validator

from milepost.recordings.measured import Measured
from milepost.recordings.options import STRICT
from milepost.simulation.noise import MarkovNoise, UniformNoise, WhiteNoise
from milepost.track.earth import moved
from milepost.track.line import Line
from milepost_schemas.reading import Solution

from ..base import World
from ..periodic import PeriodicSource

Std = Annotated[float, Field(gt=0.0)]


class Options(BaseModel):
    """Options are read strictly."""

    model_config = STRICT


class Wandering(Options):
    """A standard deviation that is uniform in its logarithm between two bounds and changes with `time_constant_s`."""

    least_m: Std
    most_m: Std
    time_constant_s: Std

    @model_validator(mode="after")
    def _ordered(self) -> Wandering:
        if self.most_m < self.least_m:
            raise ValueError("most_m is below least_m")
        return self


class Outliers(Options):
    """Multipath: with this probability a fix's error is so many times as large."""

    probability: Annotated[float, Field(ge=0.0, le=1.0)]
    factor: Annotated[float, Field(ge=1.0)]


class SimulatedGnss(Options):
    """What the sky and the receiver are; what the filter believes of them is in the options beside `simulated`.

    `solution`: under an open sky; `recovering`: for `recovery_s` after a tunnel. `wandering` takes the place of the
    solution's white standard deviation. `states`: which standard deviation the receiver states, its datasheet's or the
    true one of each fix. `satellites`: their mean number.
    """

    solution: Solution = "rtk_fixed"
    recovering: Solution = "single"
    recovery_s: Annotated[float, Field(ge=0.0)] = 0.0
    wandering: Wandering | None = None
    outliers: Outliers | None = None
    states: Literal["nothing", "datasheet", "truth"] = "datasheet"
    satellites: Annotated[int, Field(ge=0, le=60)] = 16


class Figures(NamedTuple):
    """A receiver's figures: by solution the white and the slow standard deviation of each axis; the latter's time; of speed."""

    white_std_m: dict[str, float]
    offset_std_m: dict[str, float]
    offset_time_s: float
    speed_std_mps: float | None


class SimulatedReceiver(PeriodicSource):
    """A fix is the truth moved east and north, each by white noise and by a first-order Markov offset.

    On each axis e = σ w + σ_o o, w white, o the Markov process of unit variance; multipath multiplies σ. The component
    along the track has the same variances whatever the heading. Speed errs by white noise along and across the track.
    """

    def __init__(self, unit: str, rate_hz: float, figures: Figures, simulated: SimulatedGnss, world: World, from_s: float):
        super().__init__(1.0 / rate_hz, from_s, world.motion.end_s)
        if world.line.track is None:
            raise ValueError(f"{unit}: a simulated receiver needs a line with geometry")
        self._motion, self._line, self._track = world.motion, world.line, world.line.track
        self._figures, self._simulated = figures, simulated
        seed, step = world.seed, self.period_s
        self._white = [WhiteNoise(seed, f"{unit}.{axis}") for axis in ("east", "north", "along", "across")]
        self._offset = [MarkovNoise(seed, f"{unit}.offset.{axis}", step, figures.offset_time_s) for axis in ("east", "north")]
        self._sky = MarkovNoise(seed, f"{unit}.satellites", step, 60.0)
        wandering = simulated.wandering
        self._sigma = MarkovNoise(seed, f"{unit}.sigma", step, wandering.time_constant_s if wandering else 1.0)
        self._chance = UniformNoise(seed, f"{unit}.multipath")

    def sample(self, index: int, t_s: float) -> Measured | None:
        s, v, _ = self._motion.at(t_s)
        if self._line.in_tunnel(s):
            return None
        solution = self._solution(s, t_s)
        white, stated = self._stds(index, solution)
        slow = self._figures.offset_std_m.get(solution, 0.0)
        east, north = (
            white * noise[index] + slow * offset[index] for noise, offset in zip(self._white[:2], self._offset, strict=True)
        )
        latitude, longitude = moved(*self._track.locate(s), east, north)
        satellites = max(0, round(self._simulated.satellites + 1.5 * self._sky[index]))
        fields: dict[str, Any] = {
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "solution": solution,
            "satellites": satellites,
            # of a sky without obstacles: 0.75 with 16 satellites, 1.5 with 4
            "hdop": 3.0 / math.sqrt(max(satellites, 1)),
        }
        if stated is not None:
            fields["horizontal_std_m"] = stated
        return Measured(t_s, fields | self._velocity(index, s, v))

    def _solution(self, position_m: float, t_s: float) -> str:
        simulated = self._simulated
        if simulated.recovery_s and left_a_tunnel(
            self._line, self._motion.at(max(0.0, t_s - simulated.recovery_s))[0], position_m
        ):
            return simulated.recovering
        return simulated.solution

    def _stds(self, index: int, solution: str) -> tuple[float, float | None]:
        """The true white standard deviation of a fix and the one that the receiver states."""
        datasheet = self._figures.white_std_m[solution]
        true, simulated = datasheet, self._simulated
        if simulated.wandering is not None:
            least, most = simulated.wandering.least_m, simulated.wandering.most_m
            true = least * (most / least) ** (0.5 * math.erfc(-self._sigma[index] / math.sqrt(2.0)))
        if simulated.outliers is not None and self._chance[index] < simulated.outliers.probability:
            true *= simulated.outliers.factor
        return true, {"nothing": None, "datasheet": datasheet, "truth": true}[simulated.states]

    def _velocity(self, index: int, position_m: float, speed_mps: float) -> dict[str, float]:
        std = self._figures.speed_std_mps
        if std is None:
            return {}
        along, across = speed_mps + std * self._white[2][index], std * self._white[3][index]
        course = self._track.heading_deg(position_m) + math.degrees(math.atan2(across, along))
        return {"speed_mps": math.hypot(along, across), "speed_std_mps": std, "course_deg": course % 360.0}


def left_a_tunnel(line: Line, from_m: float, to_m: float) -> bool:
    """Whether a tunnel's end, in the direction of travel, lies between two positions."""
    low, high = min(from_m, to_m), max(from_m, to_m)
    return any(low < (end if to_m >= from_m else begin) <= high for begin, end in line.tunnels)
