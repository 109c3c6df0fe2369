"""What a train file says of a satellite receiver."""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import Field, model_validator

from milepost.recordings.gnss_log import GnssLog
from milepost_schemas.reading import Solution

from ..base import SensorOptions
from .fix_monitor import FixLimits
from .receiver import ReceiverOptions
from .simulated import Options, SimulatedGnss, Std


class MonitorOptions(Options):
    """Limits of `fix_monitor`, which says what each means."""

    coasting_s: Std = 5.0
    proof_s: Annotated[float, Field(ge=0.0)] = 6.0
    jump_sigmas: Std = 5.0
    max_acceleration_mps2: Std = 3.0
    course_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 20.0
    alone_above: Annotated[int, Field(ge=0)] = 10
    least: Annotated[int, Field(ge=0)] = 4
    poor_factor: Annotated[float, Field(ge=1.0)] = 2.0


class GnssOptions(SensorOptions):
    """`position_std_m`: standard deviation of one axis by solution; a solution that is not listed does not count.

    `offset_std_m`: the same of the slow part (atmosphere, multipath) with `offset_time_s`; the private state.
    `trust_stated_std`: take the fix's own standard deviation where the receiver states one. `speed_std_mps`: of its speed;
    without it its speed only checks its positions. `cross_track_limit_m`: a fix farther from the track cannot be this
    train's, nor can fixes whose mean is farther than half of it.
    """

    recording: GnssLog | None = None
    receiver: ReceiverOptions | None = None
    simulated: SimulatedGnss = Field(default_factory=SimulatedGnss)
    monitor: MonitorOptions = Field(default_factory=MonitorOptions)
    rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 2.5
    position_std_m: dict[str, Std] = Field(default_factory=lambda: {"rtk_fixed": 0.1})
    offset_std_m: dict[str, Std] = Field(default_factory=dict)
    offset_time_s: Std = 60.0
    trust_stated_std: bool = False
    speed_std_mps: Std | None = None
    cross_track_limit_m: Std = 10.0

    @model_validator(mode="after")
    def _known_solutions(self) -> GnssOptions:
        wanted = {**self.offset_std_m}
        if self.source == "simulation":
            wanted[self.simulated.solution] = 0.0
            wanted |= {self.simulated.recovering: 0.0} if self.simulated.recovery_s else {}
        known = get_args(Solution)
        for solution in self.position_std_m:
            if solution not in known:
                raise ValueError(f"position_std_m: must be one of {', '.join(known)}, not {solution}")
        for solution in wanted:
            if solution not in self.position_std_m:
                raise ValueError(f"position_std_m: {solution} is missing")
        return self

    @property
    def limits(self) -> FixLimits:
        """The monitor's limits."""
        return FixLimits(cross_track_m=self.cross_track_limit_m, **self.monitor.model_dump())
